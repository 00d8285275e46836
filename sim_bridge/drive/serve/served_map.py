"""The live map of a served world: its vehicles are the bridge's, their companions are not."""

from __future__ import annotations

from dataclasses import asdict

from mission.common.problems import MissionError
from mission.schema.kinds import FaultKind
from sim_bridge.drive.faults import Faults
from sim_bridge.drive.links.hub import Say
from sim_bridge.drive.live.live import ages_s, fault_of, yaws_deg
from sim_bridge.drive.live.map import Map
from sim_bridge.drive.serve.server import Server
from sim_bridge.judge.recording import Recorder
from sim_bridge.judge.tick import Tick
from sim_bridge.world.strikes import strike

CONTROLS = ("radio", "wind")  # what happens in the air; companions and the clock belong to others


class ServedMap:
    """Between a Server and its Map. `step` after each of the server's."""

    def __init__(self, map_: Map, server: Server, say: Say) -> None:
        self.map = map_
        self._server = server
        self._say = say
        self._mission = server.world.mission  # with what viewers have done by now
        self._recorder = Recorder()  # for its rows; a server keeps none
        self._faults = Faults(())

    def step(self, now_s: float) -> None:
        """Ten times a second of simulated time: a row out, wishes in. `now_s`: wall time."""
        world = self._server.world
        if not self.map.due(world.now_s):
            return
        tick = self._server.tick(now_s)
        self.map.row(self._recorder.row(tick), yaws_deg(world), ages_s(tick))
        for asked in self.map.asked():
            try:
                fault = {**fault_of(asked, tick.leader(tick.answered), world), "at_s": world.now_s}
                self._mission = self._mission.with_faults([fault], place="the map")
                self._faults.add(self._mission.sim.faults[-1])
            except (ValueError, MissionError) as error:
                self.map.event(world.now_s, f"not done: {error}")
        self._apply(tick)

    def _apply(self, tick: Tick) -> None:
        world = self._server.world
        phase, leader = tick.phase(tick.answered), tick.leader(tick.answered)
        began, ended = self._faults.advance(world.now_s, alive=world.vehicles, phase=phase, leader=leader)
        if not began and not ended:
            return
        world.radio.cut_off = self._faults.cut_off
        strike(world, FaultKind.WIND, self._faults.in_force(FaultKind.WIND))
        for event in began:
            self.map.fault(asdict(event))
        for text in (*[event.begins() for event in began], *[event.ends() for event in ended]):
            self.map.event(world.now_s, text)
            self._say(text)

"""The page's end of a flight: settings in, messages for its view out, and what a viewer asks for in between."""

from __future__ import annotations

import json
import time
from typing import Any, Final

from docs.website.world.feed import Feed
from docs.website.world.flight import PageFlight
from docs.website.world.settings import Settings
from mission.common.problems import MissionError
from sim_bridge.drive.live.pace import Pace

CONTROLS: Final = ("pause", "resume", "step", "speed", "kill")
EVERY_TICKS: Final = 2  # 10 Hz
FACTOR: Final = 2.0  # times real time, at first


class Here:
    """One flight at a time. All texts are JSON."""

    def __init__(self) -> None:
        self._flight: PageFlight | None = None
        self._feed: Feed | None = None
        self._pace = Pace(None)
        self._told: list[dict[str, Any]] = []
        self._over = False
        self._busy_s = 0.0  # of wall time, in ticks
        self._paced: dict[str, Any] = {}

    def begin(self, settings: str) -> str:
        """Begin a flight: the first message of its view, or {"wrong": why}."""
        try:
            wanted = Settings.read(json.loads(settings))
            flight = PageFlight(wanted.mission())
        except (ValueError, MissionError) as error:
            return json.dumps({"wrong": str(error)})
        title = f"{wanted.size} vehicles, {wanted.density_per_ha:g} trees/ha, seed {wanted.seed}"
        self._flight, self._feed = flight, Feed(flight, title)
        self._pace = Pace(FACTOR)
        self._pace.watched = True
        self._pace.want(FACTOR)
        self._told, self._over, self._busy_s = [], False, 0.0
        self._paced = self._pace_now()
        return json.dumps(self._feed.first(CONTROLS, self._paced))

    def turn(self, slice_s: float) -> str:
        """Fly what is due, for at most `slice_s` of wall time.

        {"wait_s": until the next is due, "view": a message for the view or null, "figures": of the flight}
        """
        flight, feed = self._flight, self._feed
        if flight is None or feed is None:
            return json.dumps({"wait_s": 1.0, "view": None, "figures": None})
        rows, until_s, wait_s = [], time.monotonic() + slice_s, 0.0
        while not self._over and (wait_s := self._pace.wait_s(flight.world.now_s)) <= 0.0:
            began_s = time.monotonic()
            flight.tick()
            ended_s = time.monotonic()
            self._busy_s += ended_s - began_s
            self._told += feed.events()
            if flight.ticks % EVERY_TICKS == 0 or flight.ended or self._pace.paused:
                rows.append(feed.row())
            self._over = flight.ended is not None
            if ended_s >= until_s:
                break
        view = self._message(rows)
        return json.dumps({"wait_s": 1.0 if self._over else wait_s, "view": view or None, "figures": self._figures()})

    def ask(self, wish: str) -> None:
        """A viewer's: as docs/reference/live.md has them."""
        flight = self._flight
        asked = json.loads(wish)
        if flight is None or self._over:
            return
        try:
            match asked.get("do"):
                case "pause" | "resume" as word:
                    self._pace.pause(word == "pause")
                case "step":
                    self._pace.step()
                case "speed":
                    self._pace.want(asked.get("factor"))
                case "kill":
                    vehicle = asked.get("vehicle") or flight.leader
                    if vehicle is None:
                        raise ValueError("no vehicle leads now")
                    flight.kill(vehicle)
                    self._tell("fault", f"companion of vehicle {vehicle} killed", [vehicle])
        except ValueError as error:
            self._tell("text", f"not done: {error}", [])

    def _tell(self, kind: str, text: str, vehicles: list[int]) -> None:
        assert self._flight is not None
        now_s = round(self._flight.world.now_s, 2)
        self._told.append({"time_s": now_s, "kind": kind, "vehicles": vehicles, "text": text})

    def _message(self, rows: list[dict[str, Any]]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        if rows:
            found["rows"] = rows
        if self._told:
            found["events"], self._told = self._told, []
        if (pace := self._pace_now()) != self._paced:
            found["pace"] = self._paced = pace
        if rows and self._over:
            found["over"] = self._verdict()
        return found

    def _pace_now(self) -> dict[str, Any]:
        return {"paused": self._pace.paused, "factor": self._pace.factor}

    def _verdict(self) -> dict[str, Any]:
        flight, feed = self._flight, self._feed
        assert flight is not None
        assert feed is not None
        arrived = flight.ended is not None and flight.ended.startswith("coverage")
        words = [
            f"{len(flight.last.alive)} of {flight.mission.swarm.size} companions around the tree"
            if arrived
            else f"not around the tree: {flight.ended}",
            f"least separation {feed.least_separation_m:.2f} m",
            f"run into something: {feed.touched or 'none'}",
        ]
        verdict = {"text": ", ".join(words), "succeeded": arrived and not feed.touched}
        return {"verdict": verdict, "limits": [], "figures": {}, "ended": flight.ended, "report": None}

    def _figures(self) -> dict[str, Any]:
        flight = self._flight
        assert flight is not None
        return {
            "ticks": flight.ticks,
            "time_s": round(flight.last.time_s, 2),
            "leader": flight.leader,
            "kills": flight.kills,
            "ended": flight.ended,
            "trace": flight.trace.hexdigest(),
            "speed": round(flight.last.time_s / self._busy_s, 2) if self._busy_s > 0.0 else None,
        }

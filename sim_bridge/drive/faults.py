"""Simulated faults: how they are written on a command line, when they strike, and which are in force."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Any

from companion.core.model.states import SwarmPhase
from companion.records.record import BASE_ID
from mission.cli.main import EXIT_BAD_FILE
from mission.common.problems import printable
from mission.document.model import Mission
from mission.schema.fault_kinds import FORMS, PARAMETERS, Needs
from mission.schema.faults import Fault, FaultKind, FaultPhase, Lie
from sim_bridge.errors import StartError
from sim_bridge.judge import run_folder
from sim_bridge.judge.fault_events import FILE_NAME, LEADER, FaultEvent, numbers
from sim_bridge.judge.progress import Progress
from sim_bridge.options.fault_forms import GRAMMAR, OPTIONS

ENDING = (FaultKind.KILL, FaultKind.RESTART)  # they end companions
_NUMBER = r"-?[0-9]{1,12}(?:\.[0-9]{1,12})?"
_TEXT = re.compile(
    rf"(?P<vehicles>{LEADER}|[0-9]{{1,4}}(?:,[0-9]{{1,4}})*)@"
    rf"(?:(?P<phase>{'|'.join(FaultPhase)})(?:\+(?P<after>{_NUMBER}))?|(?P<at>{_NUMBER}))"
    rf"(?::(?P<lie>{'|'.join(Lie)}))?(?P<numbers>(?::{_NUMBER})*)"
)


def with_options(mission: Mission, options: Mapping[FaultKind, Sequence[str]]) -> Mission:
    """`mission` with the faults of the command line besides its own.

    StartError for one that cannot be read, MissionError for one that this mission cannot have; both name it.
    """
    for kind, texts in options.items():
        for text in texts:
            try:
                fault = parsed(kind, text)
            except ValueError as error:
                raise StartError(f"--{kind.value} {printable(text)}: {error}", EXIT_BAD_FILE) from None
            mission = mission.with_faults([fault], place=f"--{kind.value} {text}")
    return mission


def parsed(kind: FaultKind, text: str) -> dict[str, Any]:
    """An option's text as a table of [[sim.faults]]. ValueError says what it must look like."""
    forms, example, _ = OPTIONS[kind]
    found, lies = _TEXT.fullmatch(text), FORMS[kind].lies
    colons = 0 if found is None else found["numbers"].count(":") + lies
    if found is None or (found["lie"] is not None) is not lies or colons not in [form.count(":") for form in forms]:
        of_lies = f" LIE: {', '.join(Lie)}." if lies else ""
        form = f"must be {' or '.join(forms)}, as {example}"
        raise ValueError(f"{form}. {GRAMMAR}{of_lies} Numbers: of 12 digits at most, and no exponent.")
    values = map(float, found["numbers"].split(":")[1:])
    return {
        "kind": kind.value,
        "vehicles": None if found["vehicles"] == LEADER else [int(k) for k in found["vehicles"].split(",")],
        "at_s": float(found["at"] or found["after"] or 0.0),
        "phase": found["phase"],
        **({"lie": found["lie"]} if lies else {}),
        **{name: _next_parameter(name, values) for name in FORMS[kind].parameters},
        "for_s": next(values, None),
    }


def spelled(fault: Fault) -> str:
    """As the option is written: "kill leader@transit+5"."""
    vehicles = LEADER if fault.vehicles is None else ",".join(map(str, fault.vehicles))
    when = _plain(fault.at_s) if fault.phase is None else fault.phase.value
    if fault.phase is not None and fault.at_s:
        when += f"+{_plain(fault.at_s)}"
    texts = [_plain(value) for value in (*numbers(fault), fault.for_s) if value is not None]
    lie = [] if fault.lie is None else [fault.lie.value]
    return f"{fault.kind.value} {':'.join([f'{vehicles}@{when}', *lie, *texts])}"


def _next_parameter(name: str, values: Iterator[float]) -> float | list[float]:
    """The next numbers, of this parameter."""
    return [next(values), next(values)] if PARAMETERS[name].level else next(values)


def _plain(value: float) -> str:
    """Without an exponent, and all its digits."""
    return f"{value:.12f}".rstrip("0").rstrip(".")


class Faults:
    """The faults of one flight: what waits, what is in force, what has happened. `advance` in every tick."""

    def __init__(
        self, faults: Iterable[Fault], immune: Mapping[FaultKind, frozenset[int]] = MappingProxyType({})
    ) -> None:
        """`immune`: by kind, vehicles that it cannot strike."""
        self._immune = immune
        self.happened: list[FaultEvent] = []
        self._waiting = list(faults)
        self._in_force: list[FaultEvent] = []
        self._in_vain: list[Fault] = []
        self._phases_s: dict[str, float] = {}  # when each began

    def add(self, fault: Fault) -> None:
        """One more that waits for its time. ValueError for one that can strike none of its vehicles."""
        if fault.vehicles is not None and self._immune.get(fault.kind, frozenset()).issuperset(fault.vehicles):
            raise ValueError(f"{spelled(fault)}: can strike none of these")
        self._waiting.append(fault)

    def advance(
        self, now_s: float, *, alive: Collection[int], phase: SwarmPhase, leader: int | None
    ) -> tuple[list[FaultEvent], list[FaultEvent]]:
        """Faults that begin now, and faults that end. `alive`: the vehicles whose companions have not ended."""
        living = set(alive)
        ended = [event for event in self._in_force if event.until_s is not None and event.until_s <= now_s]
        self._in_force = [event for event in self._in_force if event not in ended]
        ended = [event for event in ended if living.intersection(event.vehicles) or _needs_no_companion(event.kind)]
        self._phases_s.setdefault(phase.name.lower(), now_s)
        began: list[FaultEvent] = []
        waiting: list[Fault] = []
        for fault in self._waiting:
            since_s = 0.0 if fault.phase is None else self._phases_s.get(fault.phase.value, math.inf)
            acting = leader if leader in living else None
            if now_s < since_s + fault.at_s or (fault.vehicles is None and acting is None):
                waiting.append(fault)
                continue
            there = {k for k in fault.vehicles or (acting,) if k is not None}
            there -= self._immune.get(fault.kind, frozenset())
            if not FORMS[fault.kind].of_vehicle:  # whose companion may have ended
                there &= living
            if not there:
                self._in_vain.append(fault)
                continue
            began.append(_apply(fault, tuple(sorted(there)), now_s))
            if fault.kind in ENDING:
                living -= there
        self._waiting = waiting
        self._in_force += [event for event in began if event.kind is not FaultKind.KILL]
        self.happened += began
        return began, ended

    def lift(self) -> list[FaultEvent]:
        """End all that is in force; nothing more happens."""
        ended, self._in_force = self._in_force, []
        self._in_vain += self._waiting
        self._waiting = []
        return ended

    @property
    def stopped(self) -> frozenset[int]:
        """Vehicles whose companions are stopped."""
        return frozenset(k for event in self._of(FaultKind.STOP) for k in event.vehicles)

    @property
    def cut_off(self) -> tuple[frozenset[int], ...]:
        """Groups of vehicles whose radios reach only one another."""
        return tuple(frozenset(event.vehicles) for event in self._of(FaultKind.PARTITION))

    @property
    def cut_links(self) -> frozenset[tuple[int, int]]:
        """Sender and receiver of each link between a vehicle and the base station that is cut."""
        apart = [k for event in self._of(FaultKind.BASE_LOST) for k in event.vehicles]
        return frozenset(chain([(k, BASE_ID) for k in apart], [(BASE_ID, k) for k in apart]))

    @property
    def late_s(self) -> dict[int, float]:
        """By how much the telemetry of these is late: the longest delay of those in force."""
        found: dict[int, float] = {}
        for event in self._of(FaultKind.LATE):
            for k in event.vehicles:
                found[k] = max(found.get(k, 0.0), event.late_s or 0.0)
        return found

    @property
    def blind(self) -> frozenset[int]:
        """Vehicles whose obstacle sensors tell nothing."""
        return frozenset(k for event in self._of(FaultKind.BLIND) for k in event.vehicles)

    def in_force(self, kind: FaultKind) -> dict[int, tuple[float, ...]]:
        """The vehicles that a kind strikes now, by id, with its numbers: those of the one that began last."""
        return {k: event.numbers for event in self._of(kind) for k in event.vehicles}

    @property
    def lies(self) -> dict[int, Lie]:
        """The lie of each insider, by id."""
        return {k: event.lie for event in self._of(FaultKind.INSIDER) if event.lie for k in event.vehicles}

    def never(self) -> list[Fault]:
        """Faults that did not happen: their time did not come, or their vehicles had no companion left."""
        return [*self._in_vain, *self._waiting]

    def _of(self, kind: FaultKind) -> list[FaultEvent]:
        return [event for event in self._in_force if event.kind is kind]


def _apply(fault: Fault, vehicles: tuple[int, ...], now_s: float) -> FaultEvent:
    until_s = None if fault.for_s is None else now_s + fault.for_s
    parameters = {name: getattr(fault, name) for name in FORMS[fault.kind].parameters}
    return FaultEvent(fault.kind, vehicles, now_s, until_s, spelled(fault), **parameters, lie=fault.lie)


def _needs_no_companion(kind: FaultKind) -> bool:
    """It ends for a vehicle that has none, too."""
    return FORMS[kind].of_vehicle or kind is FaultKind.RESTART


def immune_of(mission: Mission, *, still_air: bool = False) -> dict[FaultKind, frozenset[int]]:
    """Vehicles that kinds of faults cannot strike: those without GNSS, by any of GNSS; in still air all, by wind."""
    without = frozenset(k for k in range(1, mission.swarm.size + 1) if not mission.has_satellites(k))
    immune = {kind: without for kind, form in FORMS.items() if form.needs is Needs.SATELLITES}
    return immune | {FaultKind.WIND: frozenset(range(1, mission.swarm.size + 1))} if still_air else immune


def keep_faults(faults: Faults, now_s: float, folder: Path, progress: Progress) -> None:
    """At the end of a flight: say what never happened, and write all into `folder`; no file where there is no fault."""
    for fault in faults.never():
        progress.event(now_s, f"fault that never happened: {spelled(fault)}")
    rows = [asdict(event) for event in faults.happened]
    rows += [{"kind": fault.kind.value, "asked": spelled(fault), "at_s": None} for fault in faults.never()]
    if rows:
        figures = (json.dumps(rows, indent=2) + "\n").encode()
        run_folder.keep_file(folder / FILE_NAME, figures, partial(progress.event, now_s))

"""Events of a flight, moment by moment: faults, elections with their reason, phases, contacts, texts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from companion.core.model.states import SwarmPhase
from sim_bridge.judge.export.telemetry import AUTOPILOT, Telemetry
from sim_bridge.judge.fault_events import SILENCING, FaultEvent
from sim_bridge.judge.metrics import Bools, acting_leader, swarm_phase
from sim_bridge.judge.metrics.pairs import Pairs, closest
from sim_bridge.judge.recording import Recording
from sim_bridge.judge.tick import OBSTACLES, TOUCHED

REPEATED_S = 5.0  # the same words from another vehicle within this time are one event
REASON_S = 5.0  # what was said so long before an election may be its reason
FAULT = "fault: "  # as people read of one; here its kind says so
SEVERITIES = ("emergency", "alert", "critical", "error", "warning", "notice", "info", "debug")


class Event(NamedTuple):
    """One moment."""

    time_s: float
    kind: str  # fault, lead, phase, lost, contact, closest, parted, text, end
    vehicles: tuple[int, ...]
    text: str
    severity: str = ""  # of a text

    def as_dict(self) -> dict[str, Any]:
        """As a replay holds it."""
        reported = {
            "time_s": round(self.time_s, 2),
            "kind": self.kind,
            "vehicles": list(self.vehicles),
            "text": self.text,
        }
        return reported | ({"severity": self.severity} if self.severity else {})


def events(
    recording: Recording,
    faults: Sequence[FaultEvent],
    telemetry: Mapping[int, Telemetry],
    *,
    connected: Bools,
    pairs: Pairs,
    ended: str | None,
) -> list[Event]:
    """In the order of time. `connected` (T,), `pairs`: of the same ticks as `recording`."""
    found = [
        *_faults(faults),
        *elections(recording, faults, telemetry),
        *phases(recording),
        *_losses(recording, faults),
        *_closeness(recording, pairs),
        *_partings(recording, connected),
        *_texts(telemetry),
    ]
    if ended is not None and len(recording.time_s):
        found.append(Event(float(recording.time_s[-1]), "end", (), ended))
    return sorted(found, key=lambda event: event.time_s)


def _faults(faults: Iterable[FaultEvent]) -> Iterator[Event]:
    for fault in faults:
        yield Event(fault.at_s, "fault", fault.vehicles, fault.begins().removeprefix(FAULT))
        if fault.until_s is not None:
            yield Event(fault.until_s, "fault", fault.vehicles, fault.ends())


def elections(
    recording: Recording, faults: Sequence[FaultEvent], telemetry: Mapping[int, Telemetry]
) -> Iterator[Event]:
    """Each change of the acting leader, and why."""
    leader = acting_leader(recording)
    led = np.flatnonzero(leader > 0)
    before = 0
    for row in led:
        now = int(leader[row])
        if now != before:
            time_s = float(recording.time_s[row])
            why = reason(recording, int(row), before, faults, telemetry)
            yield Event(time_s, "lead", (now,), f"vehicle {now} leads: {why}")
        before = now


def reason(
    recording: Recording, row: int, before: int, faults: Sequence[FaultEvent], telemetry: Mapping[int, Telemetry]
) -> str:
    """Reason why the lead passes in `row` from the vehicle `before` (0: none led) to another."""
    if before == 0:
        return "first election"
    time_s = float(recording.time_s[row])
    hit = [
        f for f in faults if before in f.vehicles and f.at_s <= time_s and (f.until_s or time_s) >= time_s - REASON_S
    ]
    if hit:
        return f"{hit[-1].begins().removeprefix(FAULT)} at {hit[-1].at_s:g} s"
    touched = OBSTACLES.get(TOUCHED[recording.touched[row, before - 1]])
    if touched is not None:
        return f"leader {before} ran into {touched}"
    if not recording.agent_alive[row, before - 1]:
        return f"the companion of leader {before} does not answer"
    lost = f"leader {before} lost"
    for k, reported in telemetry.items():
        if any(text == lost and time_s - REASON_S <= at_s <= time_s + 1.0 for at_s, _, _, text in reported.texts):
            return f"vehicle {k} had no news of leader {before}"
    said = [(at_s, text) for at_s, _, severity, text in telemetry[before].texts if severity <= 4] if telemetry else []
    last = [text for at_s, text in said if time_s - REASON_S <= at_s <= time_s]
    return f"leader {before} gave the lead up" + (f": {last[-1]}" if last else "")


def phases(recording: Recording) -> Iterator[Event]:
    """Each change of the swarm's phase."""
    phase = swarm_phase(recording)
    for row in np.flatnonzero(np.diff(phase, prepend=-1)):
        if phase[row] >= 0:
            yield Event(float(recording.time_s[row]), "phase", (), SwarmPhase(int(phase[row])).name.lower())


def _losses(recording: Recording, faults: Sequence[FaultEvent]) -> Iterator[Event]:
    """Vehicles that ran into something, and companions that fell silent though no fault silenced them."""
    silenced = {k for f in faults if f.kind in SILENCING for k in f.vehicles}
    for column in range(recording.agent_alive.shape[1]):
        hits = np.flatnonzero(recording.touched[:, column])
        silent = np.flatnonzero(recording.agent_alive[:-1, column] & ~recording.agent_alive[1:, column]) + 1
        if hits.size:
            what = OBSTACLES[TOUCHED[recording.touched[hits[0], column]]]
            text = f"vehicle {column + 1} has run into {what}"
            yield Event(float(recording.time_s[hits[0]]), "contact", (column + 1,), text)
        elif silent.size and column + 1 not in silenced:
            text = f"companion {column + 1} does not answer any more"
            yield Event(float(recording.time_s[silent[0]]), "lost", (column + 1,), text)


def _closeness(recording: Recording, pairs: Pairs) -> Iterator[Event]:
    """Events of the flight's closest approach, and of each time that two vehicles touched."""
    for tick, pair in pairs.touches.tolist():
        one, other = pairs.ids(pair)
        yield Event(float(recording.time_s[tick]), "contact", (one, other), f"vehicles {one} and {other} touch")
    who, at_s = closest(recording, pairs)
    if at_s is not None:
        text = f"closest of the flight: {who[0]} and {who[1]}, {pairs.separation_m.min():.1f} m apart"
        yield Event(at_s, "closest", who, text)


def _partings(recording: Recording, connected: Bools) -> Iterator[Event]:
    phase = swarm_phase(recording)
    apart = ~connected & (phase >= SwarmPhase.TRANSIT) & (phase <= SwarmPhase.COVERAGE)
    for row in np.flatnonzero(np.diff(apart.astype(np.int8), prepend=0)):
        text = "network partition: the swarm is split" if apart[row] else "network partition over"
        yield Event(float(recording.time_s[row]), "parted", (), text)


def _texts(telemetry: Mapping[int, Telemetry]) -> Iterator[Event]:
    """Texts of companions and autopilots; the same words of several vehicles at a time once."""
    reported = sorted((text, k) for k, one in telemetry.items() for text in one.texts)
    said_s: dict[str, float] = {}
    for (at_s, component, severity, text), vehicle in reported:
        if at_s - said_s.get(text, -np.inf) > REPEATED_S:
            who = f"vehicle {vehicle}" + (" autopilot" if component == AUTOPILOT else "")
            yield Event(at_s, "text", (vehicle,), f"{who}: {text}", SEVERITIES[min(max(severity, 0), 7)])
        said_s[text] = at_s

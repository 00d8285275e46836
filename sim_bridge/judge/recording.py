"""Ground truth of one flight, sampled once a tick: what every figure about a flight is computed from."""

from __future__ import annotations

import hashlib
import io
import os
import struct
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import IO, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_bridge.judge.tick import TOUCHED, Tick

FRAME_HEADER_BYTES: Final = 10  # MAVLink 2
FRAME_CRC_BYTES: Final = 2
KEPT_TICKS: Final = 1200  # rows in memory: a minute of flight


_TOUCHED: Final = ", ".join([f"{k} {what or 'nothing'}" for k, what in enumerate(TOUCHED)])


class About(NamedTuple):
    """One array of a recording, for people."""

    shape: str  # of T ticks and n vehicles
    unit: str
    meaning: str


ABOUT: Final[dict[str, About]] = {
    "time_s": About("(T,)", "s", "Simulated time at the end of the tick; on the wall clock, since the flight began."),
    "pos_ned_m": About("(T, n, 3)", "m", "True position, north, east, down about the mission's origin."),
    "vel_ned_mps": About("(T, n, 3)", "m/s", "True velocity, north, east, down."),
    "on_ground": About("(T, n)", "", "Touches the ground with its legs."),
    "armed": About("(T, n)", "", "Its autopilot is armed."),
    "agent_alive": About("(T, n)", "", "Its companion answered in this tick, and it has run into nothing by then."),
    "touched": About("(T, n)", "", f"What it has run into by then: {_TOUCHED}."),
    "range_m": About("(T, n)", "m", "Radio range in use."),
    "phase": About("(T, n)", "", "SWARM_PHASE that its last beacon announced; -1 before the first."),
    "acting": About("(T, n)", "", "Its last beacon claims an established lead, and its companion has answered since."),
    "leader": About("(T, n)", "", "Id of the leader that its last beacon names; 0: none."),
}


@dataclass(frozen=True, slots=True)
class Recording:
    """Arrays over T ticks and n vehicles (vehicle id k in column k-1): see ABOUT."""

    time_s: NDArray[np.float64]
    pos_ned_m: NDArray[np.float64]
    vel_ned_mps: NDArray[np.float64]
    on_ground: NDArray[np.bool_]
    armed: NDArray[np.bool_]
    agent_alive: NDArray[np.bool_]
    touched: NDArray[np.int8]
    range_m: NDArray[np.float64]
    phase: NDArray[np.int8]
    acting: NDArray[np.bool_]
    leader: NDArray[np.int16]


class Recorder:
    """Keeps what a recording is made of. `add` every tick, in the order of time.

    Rows become arrays, KEPT_TICKS at a time, and go to a file without a name: a flight may take hours.
    """

    def __init__(self, folder: Path | None = None) -> None:
        """`folder`: on whose disk the file is; None: there is none, and arrays are kept in memory."""
        self._rows: list[tuple[Any, ...]] = []
        self._last: tuple[Any, ...] | None = None
        self._arrays: list[Recording] = []  # of earlier ticks that no file has: there is none, or its disk is full
        self._folder = folder
        self._file: IO[bytes] | None = None
        self._filed = 0  # recordings in it
        self._silent_s: dict[int, float] = {}  # when each companion did not answer last

    def add(self, tick: Tick) -> None:
        """One row."""
        self._last = self.row(tick)
        self._rows.append(self._last)
        if len(self._rows) == KEPT_TICKS:
            self._arrays.append(assembled(self._rows))
            self._rows = []
            self._file_arrays()

    def _file_arrays(self) -> None:
        """Move the arrays to the file, in their order; those that it does not take stay."""
        if self._folder is None:
            return
        try:
            if self._file is None:
                # Unbuffered: what a full disk has not taken would wait in a buffer, and fail whatever comes next
                self._file = tempfile.TemporaryFile(dir=self._folder, buffering=0)  # noqa: SIM115  it outlives this
            while self._arrays:
                packed = io.BytesIO()
                for name in COLUMNS:
                    np.save(packed, getattr(self._arrays[0], name), allow_pickle=False)
                end = self._file.seek(0, os.SEEK_END)
                try:
                    _write_all(self._file, packed.getbuffer())
                except OSError:
                    self._file.truncate(end)
                    raise
                self._arrays.pop(0)
                self._filed += 1
        except OSError:
            return  # tried again with the next

    def row(self, tick: Tick) -> tuple[Any, ...]:
        """Row that `assembled` takes, and `add` keeps."""
        ids = range(1, len(tick.pos_ned_m) + 1)
        answering = frozenset(tick.answered)
        answered = [k in answering for k in ids]
        self._silent_s.update((k, tick.time_s) for k in ids if k not in answering)
        said = [tick.said.get(k) for k in ids]
        return (
            tick.time_s,
            tick.pos_ned_m,
            tick.vel_ned_mps,
            tick.on_ground,
            tick.armed,
            answered,
            [TOUCHED.index(what) for what in tick.touched],
            tick.range_m,
            [-1 if beacon is None else beacon.swarm_phase for beacon in said],
            [self._acts(k, tick) for k in ids],
            [0 if beacon is None else beacon.leader for beacon in said],
        )

    def _acts(self, vehicle_id: int, tick: Tick) -> bool:
        """Its last beacon claims an established lead. What one said before its companion stalled is no claim."""
        said = tick.said.get(vehicle_id)
        if said is None or said.acting_leader != vehicle_id:
            return False
        return tick.said_s[vehicle_id] >= self._silent_s.get(vehicle_id, 0.0)

    @property
    def last(self) -> tuple[Any, ...]:
        """The row of the tick that was added last, as `assembled` takes it. IndexError before the first."""
        if self._last is None:
            raise IndexError("no tick has been added")
        return self._last

    def recording(self) -> Recording:
        """All ticks so far. The file is read back, and closed."""
        if self._file is not None:
            self._file.seek(0)
            filed = [
                Recording(**{name: np.load(self._file, allow_pickle=False) for name in COLUMNS})
                for _ in range(self._filed)
            ]
            self._arrays = [joined([*filed, *self._arrays])]
            self._file.close()
            self._file, self._filed = None, 0
        rows = [assembled(self._rows)] if self._rows or not self._arrays else []
        return joined([*self._arrays, *rows])


def _write_all(file: IO[bytes], data: memoryview) -> None:
    """`data` into an unbuffered file, which may take less at a time, as the last that a disk has room for. OSError."""
    while data:
        written = file.write(data)  # in a line of its own: compiled, a call within a slice is made twice
        data = data[written:]


def joined(parts: Sequence[Recording]) -> Recording:
    """Recordings of one flight, one after the other."""
    return Recording(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in COLUMNS})


def assembled(rows: Iterable[Sequence[Any]]) -> Recording:
    """The recording of ticks: for each its values in the order of COLUMNS."""
    columns = list(zip(*rows, strict=True)) or [()] * len(COLUMNS)
    return Recording(
        **{name: np.array(column, dtype) for (name, dtype), column in zip(COLUMNS.items(), columns, strict=True)}
    )


class Trace:
    """A running SHA-256 of what happened in lockstep: two flights with the same digest were the same to the bit."""

    def __init__(self) -> None:
        self._sha256 = hashlib.sha256()

    def add(self, tick: Tick) -> None:
        """Time, true states, modes and beacons of one tick."""
        states = zip(tick.pos_ned_m, tick.vel_ned_mps, strict=True)
        numbers = [tick.time_s, *chain.from_iterable(chain.from_iterable(states))]
        self._sha256.update(struct.pack(f"<{len(numbers)}d", *numbers))
        modes = zip(tick.mode, tick.armed, strict=True)
        self._sha256.update("".join([f"{mode}{armed:d}" for mode, armed in modes]).encode())
        for vehicle_id, frames in sorted(tick.frames.items()):
            for frame in frames:
                # Without the header's sequence number: it also counts what was sent before the flight began.
                self._sha256.update(bytes([vehicle_id]) + frame[FRAME_HEADER_BYTES:-FRAME_CRC_BYTES])

    def hexdigest(self) -> str:
        """Of all ticks so far."""
        return self._sha256.hexdigest()


COLUMNS: dict[str, Any] = {
    "time_s": np.float64,
    "pos_ned_m": np.float64,
    "vel_ned_mps": np.float64,
    "on_ground": np.bool_,
    "armed": np.bool_,
    "agent_alive": np.bool_,
    "touched": np.int8,
    "range_m": np.float64,
    "phase": np.int8,
    "acting": np.bool_,
    "leader": np.int16,
}

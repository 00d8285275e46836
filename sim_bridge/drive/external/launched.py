"""Programs that `sim-bridge fly --launch` starts: external autopilots."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

from mission.cli.main import EXIT_ENVIRONMENT
from sim_bridge.drive.children import end, fate, start
from sim_bridge.errors import StartError


class Launched:
    """The programs of --launch, one for each vehicle, each with its log, autopilot-K.log.

    Each works in a folder of its own, autopilot-K, for what an autopilot keeps (eeprom.bin, parameters, logs). A
    program that is named by a relative path is looked for from here.
    """

    def __init__(self) -> None:
        self._children: dict[int, subprocess.Popen[bytes]] = {}
        self._logs: dict[int, Path] = {}
        self._ended: set[int] = set()

    def start_all(self, commands: Mapping[int, Sequence[str]], logs: Path) -> None:
        """One for each vehicle, with its words; `logs` is made. StartError."""
        logs.mkdir()
        for vehicle_id, command in commands.items():
            self._start(vehicle_id, command, logs)

    def _start(self, vehicle_id: int, command: Sequence[str], logs: Path) -> None:
        program = str(Path(command[0]).absolute()) if "/" in command[0] else command[0]
        self._logs[vehicle_id] = log = logs / f"autopilot-{vehicle_id}.log"
        folder = logs / f"autopilot-{vehicle_id}"
        folder.mkdir()
        try:
            with log.open("wb") as out:
                self._children[vehicle_id] = start(
                    [program, *command[1:]], stdout=out, stderr=subprocess.STDOUT, folder=folder
                )
        except OSError as error:
            raise StartError(f"--launch: {command[0]}: {error.strerror}", EXIT_ENVIRONMENT) from None

    def died(self) -> list[str]:
        """Autopilots that have ended since the last call, in words."""
        said = []
        for vehicle_id, child in self._children.items():
            how = None if vehicle_id in self._ended else fate(child)
            if how is not None:
                self._ended.add(vehicle_id)
                said.append(f"launched autopilot {vehicle_id}: {how}; its log: {self._logs[vehicle_id]}")
        return said

    def close(self) -> None:
        """End all, with what they have started."""
        end(list(self._children.values()))

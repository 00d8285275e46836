"""The command line's options about autopilots that somebody else runs."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass

from mission.cli.main import EXIT_BAD_FILE
from sim_bridge.drive.links.router import PORT_FIELD, Url, Way
from sim_bridge.errors import StartError

_FIELD = re.compile(r"\{\w+\}")


@dataclass(frozen=True, slots=True)
class ExternalAutopilots:
    """Address of external autopilots, and the command that launches them."""

    url: Url
    launch: str | None = None
    first_port: int = 0  # 0: free ones
    black_box: bool = False  # each companion keeps one

    def __post_init__(self) -> None:
        """StartError when it cannot be meant."""
        if self.url.way is Way.OUT and self.url.port is None and not self.first_port and self.launch is None:
            raise StartError(f"--autopilots udpout with {PORT_FIELD} wants --first-port, or --launch", EXIT_BAD_FILE)
        if self.launch is not None:
            self.command(vehicle_id=1, port=1)

    def command(self, vehicle_id: int, port: int) -> list[str]:
        """The words of --launch for one vehicle. StartError when they cannot be told apart."""
        try:
            words = shlex.split(self.launch or "")
        except ValueError as error:
            raise StartError(f"--launch: {error}", EXIT_BAD_FILE) from None
        if not words:
            raise StartError("--launch: no command", EXIT_BAD_FILE)
        values = {"{index}": vehicle_id - 1, "{sysid}": vehicle_id, PORT_FIELD: port}

        def filled_in(field: re.Match[str]) -> str:
            if field[0] not in values:
                raise StartError(f"--launch: {field[0]}: must be one of {', '.join(values)}", EXIT_BAD_FILE)
            return str(values[field[0]])

        return [_FIELD.sub(filled_in, word) for word in words]

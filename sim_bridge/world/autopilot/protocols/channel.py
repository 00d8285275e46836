"""State of one link of an autopilot, and what goes on in it over more than one transmission."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

from companion.mavlink.autopilot_link.signing import LinkSigning
from sim_bridge.world.autopilot.protocols.links import Link, Port
from sim_bridge.world.autopilot.protocols.parameters import ParameterTable
from sim_bridge.world.autopilot.protocols.streams import StreamTable

PARAMETERS_PER_TRANSMIT: Final = 16  # autopilots spread a list out; so do we


@dataclass(slots=True)
class Channel:
    """One link's state."""

    link: Link
    port: Port
    streams: StreamTable
    next_parameter: int | None = None  # of a PARAM_REQUEST_LIST under way


def continue_parameters(channel: Channel, parameters: ParameterTable) -> None:
    """Send the next parameters of the list under way."""
    first = channel.next_parameter or 0
    names = parameters.names[first : first + PARAMETERS_PER_TRANSMIT]
    for name in names:
        channel.port.send(parameters.message(name))
    after = first + len(names)
    channel.next_parameter = after if after < len(parameters.names) else None


def set_up_signing(channels: Iterable[Channel], setup: Any) -> None:
    """Take SETUP_SIGNING: from now on all links sign, and refuse frames without the key. Zeros: no more."""
    key, timestamp = bytes(setup.secret_key), setup.initial_timestamp
    is_off = not any(key) and timestamp == 0
    for number, channel in enumerate(channels):
        channel.port.signing = None if is_off else LinkSigning(key, timestamp=timestamp, link_id=number)

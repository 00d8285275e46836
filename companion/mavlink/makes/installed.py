"""Makes of installed packages: entry points of the group `understory.makes`, each a `Make`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, MutableMapping
from typing import Final

from companion.core.model.states import AutopilotTraits, FlightMode, Request
from companion.mavlink.makes.make import REQUESTS, Altitude, Make
from mission.common import entry_points
from mission.common.entry_points import EntryPointError

GROUP: Final = "understory.makes"
STEERED: Final = (FlightMode.OFFBOARD, FlightMode.HOLD, FlightMode.LAND)  # that a companion must tell apart
KINDS: Final[Mapping[type, tuple[str, ...]]] = {
    str: ("key", "name", "ready_about", "id_parameter", "serial_parameters"),
    int: ("autopilot", "ready_ekf_flags"),
    bool: ("takes_odometry",),
    Mapping: ("modes", "mode_names", "streams_hz", "reception_hz"),
    tuple: ("canopy_rules", "satellite_rules", "aids", "height_aids", "odometry_aids"),
    AutopilotTraits: ("traits",),
}  # of the fields of a Make
TRIED: Final = Altitude(amsl_m=500.0, above_home_m=10.0)


def load_makes(known: MutableMapping[str, Make]) -> None:
    """Adds those of installed packages to `known`, once. EntryPointError: one is no make, or is there already."""
    for name in entry_points.installed_names(GROUP):
        found = entry_points.find_installed(GROUP, name)
        assert found is not None
        make = found.load()
        if known.get(name) is make:
            continue
        for wrong in wrongs_of(make, name, known):
            raise EntryPointError(f"{found.title}: {wrong}")
        known[name] = make


def wrongs_of(make: object, name: str, known: Mapping[str, Make]) -> Iterator[str]:
    """Wrongs of an entry against a `Make` that flies beside those that are known."""
    if not isinstance(make, Make):
        yield f"is of type {type(make).__name__}: must be a companion.mavlink.makes.make.Make"
        return
    yield from _wrong_fields(make)
    if make.key != name:
        yield f"key = {make.key!r}: must be the entry point's name, {name!r}"
    for other in known.values():
        if other.key == make.key or other.autopilot == make.autopilot:
            yield f"key = {make.key!r}, autopilot = {make.autopilot}: {other.name} has the same"
    for mode in STEERED:
        if mode not in make.modes.values():
            yield f"modes: has no {mode.name}"
    for request in Request:
        try:
            command, parameters = make.command(request, TRIED)
        except Exception as error:  # noqa: BLE001  the package's own, which is told
            yield f"command({request.name}): {type(error).__name__}: {error}"
            continue
        if REQUESTS.get(command) is not request or len(parameters) > 7:
            wanted = next(command for command, of in REQUESTS.items() if of is request)
            yield f"command({request.name}) = {command}, {parameters}: must be {wanted}, with 7 numbers at most"


def _wrong_fields(make: Make) -> Iterator[str]:
    for kind, names in KINDS.items():
        for name in names:
            value = getattr(make, name)
            if not isinstance(value, kind):
                yield f"{name} = {value!r}: must be of type {kind.__name__}"
    for name in ("fence_rules", "odometry_rules", "command"):
        if not callable(getattr(make, name)):
            yield f"{name}: must be a function"

"""`--sensor NAME=URL` of `companion`, and the options of an earlier version that mean the same.

What a sensor is takes long to load: nothing does before such an option is used.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from typing import Any

from companion.shell.urls import AUTOPILOT_SCHEMES, Url, UrlError, parse_url
from mission.common.entry_points import TITLE_MAX_CHARS, EntryPointError
from mission.common.problems import printable

OLD_OPTIONS = {"--obstacles": "obstacles", "--ranges": "ranges"}  # until 0.3
LIST = "help"


class SensorAction(argparse.Action):
    """Adds one link to `sensors`: name -> URL. `const`: the name, of an option that has no other."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: str | Sequence[Any] | None,
        option: str | None = None,
    ) -> None:
        """Take one option; a wrong one ends the program, as argparse does."""
        from companion.sensors.table import SENSORS

        text = str(values)
        if text == LIST:
            print("\n".join(_list_sensors()))
            parser.exit()
        name, _, url = (self.const, "", text) if self.const else text.partition("=")
        if self.const:
            print(f"{parser.prog}: {option} URL is deprecated: use --sensor {name}=URL", file=sys.stderr)
        if name not in SENSORS:
            self._load_installed(name, text)
        links: dict[str, Url] = getattr(namespace, self.dest)
        if name in links:
            raise argparse.ArgumentError(self, f"{name} is given twice")
        try:
            setattr(namespace, self.dest, {**links, name: parse_url(url, AUTOPILOT_SCHEMES)})
        except UrlError as error:
            raise argparse.ArgumentError(self, str(error)) from None

    def _load_installed(self, name: str, text: str) -> None:
        """A sensor of an installed package, before its link is opened; a wrong one ends the program."""
        from companion.sensors.installed import installed_names, load_sensor
        from companion.sensors.table import SENSORS

        names = installed_names()
        if name not in names:
            allowed = f"NAME=URL, NAME one of {', '.join([*SENSORS, *names])}"
            raise argparse.ArgumentError(self, f"{printable(text)!r}: must be {allowed}")
        try:
            load_sensor(name)
        except EntryPointError as error:
            raise argparse.ArgumentError(self, printable(str(error), TITLE_MAX_CHARS)) from None


def _list_sensors() -> Iterator[str]:
    """Ours, then those of installed packages; of one that cannot be loaded, why."""
    from companion.sensors.installed import installed_names, load_sensor
    from companion.sensors.table import SENSORS

    yield from (f"{name}: {kind.HELP}" for name, kind in SENSORS.items())
    for name in installed_names():
        try:
            yield f"{name}: {load_sensor(name).HELP}"
        except EntryPointError as error:
            yield printable(str(error), TITLE_MAX_CHARS)


def add_sensor_options(parser: argparse.ArgumentParser, about: str) -> None:
    """`arguments.sensors`, a dict of links by the sensor's name."""
    names = f"`--sensor {LIST}` lists the names"
    parser.add_argument(
        "--sensor", action=SensorAction, dest="sensors", default={}, metavar="NAME=URL", help=f"{about}; {names}"
    )
    for option, name in OLD_OPTIONS.items():
        parser.add_argument(
            option,
            action=SensorAction,
            dest="sensors",
            const=name,
            default={},
            metavar="URL",
            help=f"deprecated: --sensor {name}=URL",
        )

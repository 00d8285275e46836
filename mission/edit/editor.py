"""A mission under edit: its draft, what there is to say of it, and what the page draws of it."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from mission.check.findings import Findings, check_document
from mission.check.summary import describe, describe_airtime, summarise
from mission.common.problems import MissionError, Problem
from mission.document.load import parse_document
from mission.document.model import Mission
from mission.edit.beginning import flight_height_m, lowest_crown_m, put_stems, top_m
from mission.edit.draft import Draft
from mission.edit.fields import describe_fields, values_of
from mission.edit.ground import Ground, stem_files
from mission.edit.toml_text import Change
from mission.rules.flight_rules import placement_radius_m, trunk_clearance_m
from mission.schema.sim import RadioTrunks, Sim
from mission.schema.tables import MissionTables
from mission.stems.stem_map import read_stems

_SHOWN: Final = ("route", "swarm", "fence", "coverage", "radio", "separation", "sensing", "forest", "origin", "sim")


class Editor:
    """All that the page asks for. Not for two threads at once."""

    def __init__(self, draft: Draft) -> None:
        self.draft = draft
        self.ground = Ground(draft.path.parent)
        self._state: tuple[int, dict[str, Any]] | None = None  # of a revision
        self._tables: MissionTables | None = None  # the last whose tables are each valid by itself

    def describe(self) -> dict[str, Any]:
        """State of the page. It changes with `revision`, or with the files on the disk."""
        draft = self.draft
        files = stem_files(draft.path.parent)
        disk = draft.on_disk()
        if self._state is None or self._state[0] != draft.revision:
            self._state = draft.revision, self._check()
        return {
            "file": draft.path.name,
            "folder": str(draft.path.parent),
            "revision": draft.revision,
            "is_saved": draft.is_saved,
            "can_undo": draft.can_undo,
            "can_redo": draft.can_redo,
            "has_lost_comments": draft.has_lost_comments,
            "disk": disk.value,
            "stem_files": files,
            "groups": describe_fields(),
            "stand": self.ground.id,
            "no_stand": self.ground.why_not,
            **self._state[1],
        }

    def change(self, changes: Sequence[Change]) -> None:
        """ChangeError: none of `changes` is made."""
        self.draft.change(changes)

    def look_again(self) -> None:
        """The next `describe` checks anew: files beside the mission may have changed."""
        self._state = None

    def stem_file(self) -> Path | None:
        """The stem map that the mission flies in, if it is there."""
        forest = tomllib.loads(self.draft.text).get("forest")
        name = forest.get("file") if isinstance(forest, dict) else None
        if not isinstance(name, str) or Path(name).name != name:
            return None
        path = self.draft.path.parent / name
        return path if path.is_file() else None

    def take_stems(self, name: str, data: bytes | None) -> None:
        """Flies in the stem map `name` beside the mission; `data`: written there first. MissionError, ChangeError."""
        folder = self.draft.path.parent
        if data is not None:
            put_stems(name, data, folder)
        stems = read_stems(folder / name)
        changes = [Change(do="set", path=("forest", "file"), value=name)]
        changes += [Change(do="remove", path=("forest", "stand"))]
        values = tomllib.loads(self.draft.text)
        if stems.origin is not None and "origin" not in values:
            degrees = {"lat_deg": round(stems.origin.lat_deg, 7), "lon_deg": round(stems.origin.lon_deg, 7), "alt_m": 0}
            changes += [Change(do="set", path=("origin", key), value=value) for key, value in degrees.items()]
        if "fence" not in values:
            top = top_m(lowest_crown_m(stems))
            changes += [Change(do="set", path=("fence", "altitude_max_m"), value=top)]
        if "sensing" not in values:
            changes += [Change(do="set", path=("sensing", "range_m"), value=8.0)]
        self.draft.change(changes)

    def _stem_notes(self, mission: Mission) -> tuple[str, ...]:
        """The notes of its stem map: what was read of it, and what not."""
        file = self.stem_file()
        if file is None:
            return ()
        origin = None if mission.origin is None else mission.origin.wgs84
        return tuple(f"{file.name}: {note}" for note in self.ground.read_stem_map(file, origin=origin).notes)

    def _check(self) -> dict[str, Any]:
        path, text = self.draft.path, self.draft.text
        values = tomllib.loads(text)
        found: Findings | None = None
        problems: tuple[Problem, ...] = ()
        try:
            document = parse_document(text, path)
            values = document.values  # with the points of trees that it names
            found = check_document(document, path, self.ground.read_stem_map)
        except MissionError as error:
            problems = error.problems
        self.ground.draw(values, None if found is None else found.stand)
        shown: dict[str, Any] = {
            "values": {key: values.get(key) for key in _SHOWN},
            "fields": values_of(values),
            "problems": [_describe(problem) for problem in problems],
            "beyond": [] if found is None else [_describe(problem) for problem in found.beyond],
            "notes": [] if found is None else [*self._stem_notes(found.mission), *found.notes],
            "summary": "" if found is None else _summary(found.mission, path),
            "flight_height_m": flight_height_m(float(_number(values_of(values)["fence.altitude_max_m"], 30.0))),
        }
        self._tables = _tables(values) or self._tables
        if self._tables is not None:
            shown["start"] = _start(self._tables)
            shown["attenuation"] = _attenuation(self._tables.sim)
        return {"start": None, "attenuation": 1.0, **shown}


def _tables(values: dict[str, Any]) -> MissionTables | None:
    """The mission's tables, whatever they have against each other, and with some d1 and d2 where these are missing."""
    route = values.get("route")
    anywhere = {"d1_enu_m": (0.0, 0.0, 8.0), "d2_enu_m": (0.0, 0.0, 8.0), "vel_leader_mps": 1.0}
    try:
        return MissionTables.model_validate(
            {**values, "route": {**anywhere, **(route if isinstance(route, dict) else {})}}
        )
    except ValidationError:
        return None


def _describe(problem: Problem) -> dict[str, Any]:
    return {**asdict(problem), "text": str(problem)}


def _summary(mission: Mission, path: Path) -> str:
    figures = summarise(path.name, mission)
    return f"{describe(figures).partition(': ok: ')[2]}; {describe_airtime(figures)}"


def _start(mission: MissionTables) -> dict[str, float]:
    """About d1: what starting points take, and how far trees keep from them, m."""
    radius_m = placement_radius_m(mission)
    return {"radius_m": radius_m, "clear_m": radius_m + trunk_clearance_m(mission)}


def _attenuation(sim: Sim) -> float:
    """Share of a link's range that a trunk on it leaves."""
    if sim.radio_trunks is RadioTrunks.DISC:
        return 1.0
    return 0.0 if sim.radio_trunks is RadioTrunks.CUT else 10.0 ** (-sim.radio_trunk_db / 20.0)


def _number(value: object, otherwise: float) -> float:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else otherwise

"""A study's file: which missions, laws, backends, parameters and seeds, and the cases that they cross to."""

from __future__ import annotations

import hashlib
import itertools
import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from mission.check import LineOf, validated
from mission.load import load_document
from mission.model import Integer, Mission, Text
from mission.problems import MissionError, Problem, shown
from sim_bridge.study.law import LAWS, law_module, law_params

MAX_CASES = 100_000
OURS = "ours"
Tables = dict[str, dict[str, Any]]


class Backend(StrEnum):
    """What flies the law."""

    POINT_MASS = "point-mass"  # the law alone, over arrays of point masses
    AGENTS = "agents"  # the whole stack in lockstep (agents, codec, radio, autopilots) on point masses
    JSBSIM = "jsbsim"  # the same on JSBSim quadrotors


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)


class Run(_Table):
    """One law on one backend over the cross of everything else. What stands here goes before the study's own."""

    name: Annotated[Text, Field(min_length=1, max_length=60, description="For people: heads its rows.")]
    law: Annotated[Text, Field(max_length=60, description="Movement law.")] = OURS
    backend: Annotated[Backend, Field(description="What flies it.")] = Backend.POINT_MASS
    missions: Annotated[tuple[Text, ...], Field(max_length=100, description="Mission files, from this file.")] = ()
    seeds: Annotated[Integer | None, Field(ge=1, le=100_000, description="How many.")] = None
    set: Annotated[Tables, Field(description="Mission keys, as a mission has them.")] = {}
    cross: Annotated[Tables, Field(description="Mission keys, each with an array of values.")] = {}
    params: Annotated[dict[str, Any], Field(description="The law's parameters.")] = {}
    cross_params: Annotated[dict[str, Any], Field(description="The law's parameters, each with an array.")] = {}


class Study(_Table):
    """A study."""

    model_config = ConfigDict(title="Understory study")

    schema_version: Integer = Field(alias="schema", ge=1, le=1, description="Version of this layout.", examples=[1])
    name: Annotated[Text, Field(max_length=80, description="For people.")] = ""
    missions: Annotated[tuple[Text, ...], Field(max_length=100, description="Mission files, from this file.")] = ()
    seeds: Annotated[Integer, Field(ge=1, le=100_000, description="How many, for every case.")] = 1
    first_seed: Annotated[Integer, Field(ge=0, le=2**31, description="The seeds count up from here.")] = 1
    cross: Annotated[Tables, Field(description="Mission keys, each with an array of values.")] = {}
    run: Annotated[tuple[Run, ...], Field(min_length=1, max_length=100, description="What flies.")]


@dataclass(frozen=True, slots=True)
class Case:
    """One flight of a study."""

    key: str  # hash of all that decides the flight
    run: str
    law: str
    backend: Backend
    mission: Mission  # with size, seed and all keys set
    params: BaseModel
    settings: Mapping[str, Any]  # what was crossed: mission file, mission keys, law parameters

    def identity(self) -> dict[str, Any]:
        """The first columns of its row."""
        return {
            "key": self.key,
            "run": self.run,
            "law": self.law,
            "backend": self.backend.value,
            "n": self.mission.swarm.size,
            "seed": self.mission.sim.seed,
            "settings": dict(self.settings),
        }


@dataclass(frozen=True, slots=True)
class LoadedStudy:
    """A checked study file."""

    study: Study
    cases: tuple[Case, ...]


def load_study(path: str | os.PathLike[str]) -> LoadedStudy:
    """The study in the TOML file `path`; MissionError with what is wrong, and where."""
    values, place, line_of = load_document(path)
    study = validated(Study, values, place, line_of)
    cases = tuple(_Reader(study, Path(path).parent, place, line_of).cases())
    return LoadedStudy(study, tuple({case.key: case for case in cases}.values()))


class _Reader:
    """Crosses a study to cases, and knows the lines for what is refused on the way."""

    def __init__(self, study: Study, folder: Path, place: str, line_of: LineOf) -> None:
        self._study, self._folder, self._place, self._line_of = study, folder, place, line_of
        self._documents: dict[str, dict[str, Any]] = {}
        self._count = 0

    def cases(self) -> Iterator[Case]:
        for index, run in enumerate(self._study.run):
            yield from self._run(index, run)

    def _run(self, index: int, run: Run) -> Iterator[Case]:
        at: tuple[str | int, ...] = ("run", index)
        if run.law not in LAWS:
            raise self._refused((*at, "law"), run.law, f"must be one of {', '.join(LAWS)}")
        if run.backend is not Backend.POINT_MASS and run.law != OURS:
            raise self._refused((*at, "law"), run.law, f'must be "{OURS}" where backend = "{run.backend}"')
        missions = run.missions or self._study.missions
        if not missions:
            raise self._refused((*at, "missions"), None, "missing here and in the study: name a mission file")
        mission_axes = [*self._axes(self._study.cross, ("cross",)), *self._axes(run.cross, (*at, "cross"))]
        given = {name for name, _, _ in mission_axes}
        for name, _, path in mission_axes:
            if [other for other, _, _ in mission_axes].count(name) > 1:
                raise self._refused(path, None, "crossed twice: in the study and in the run")
        param_axes = [(k, v, (*at, "cross_params", k)) for k, v in run.cross_params.items()]
        for key, choices, path in param_axes:
            self._check_choices(path, choices)
            if key in run.params:
                raise self._refused(path, choices, "also in params: choose one")
        for file in missions:
            for chosen in itertools.product(*(choices for _, choices, _ in mission_axes)):
                changes = dict(zip([name for name, _, _ in mission_axes], chosen, strict=True))
                for table, keys in run.set.items():
                    if not isinstance(keys, dict):
                        raise self._refused((*at, "set", table), keys, "must be a table of mission keys")
                    changes |= {(table, key): value for key, value in keys.items() if (table, key) not in given}
                mission = self._mission(file, changes, at)
                for picked in itertools.product(*(choices for _, choices, _ in param_axes)):
                    swept = dict(zip([key for key, _, _ in param_axes], picked, strict=True))
                    yield from self._seeds(run, at, file, missions, mission, changes, swept)

    def _seeds(
        self,
        run: Run,
        at: tuple[str | int, ...],
        file: str,
        missions: tuple[str, ...],
        mission: Mission,
        changes: Mapping[tuple[str, str], Any],
        swept: Mapping[str, Any],
    ) -> Iterator[Case]:
        def line_of(path: tuple[str | int, ...]) -> int | None:
            inner = "cross_params" if path and path[0] in swept else "params"
            return self._line_of((*at, inner, *path))

        params = law_params(run.law, {**run.params, **swept}, self._place, line_of)
        settings = {"mission": Path(file).stem} if len(missions) > 1 else {}
        settings |= {f"{table}.{key}": value for (table, key), value in changes.items()}
        settings |= {f"params.{key}": value for key, value in swept.items()}
        first = self._study.first_seed
        for seed in range(first, first + (run.seeds or self._study.seeds)):
            self._count += 1
            if self._count > MAX_CASES:
                raise self._refused(at, None, f"more than {MAX_CASES} flights in all")
            flown = mission.with_seed(seed)
            yield Case(_key(run, flown, params), run.name, run.law, run.backend, flown, params, settings)

    def _axes(
        self, tables: Tables, at: tuple[str | int, ...]
    ) -> list[tuple[tuple[str, str], list[Any], tuple[str | int, ...]]]:
        axes = []
        for table, keys in tables.items():
            if not isinstance(keys, dict):
                raise self._refused((*at, table), keys, "must be a table of mission keys, as swarm.size = [4, 8]")
            for key, choices in keys.items():
                path = (*at, table, key)
                self._check_choices(path, choices)
                axes.append(((table, key), choices, path))
        return axes

    def _check_choices(self, path: tuple[str | int, ...], choices: Any) -> None:
        if not isinstance(choices, list) or not choices:
            raise self._refused(path, choices, "must be an array of at least one value")

    def _mission(self, file: str, changes: Mapping[tuple[str, str], Any], at: tuple[str | int, ...]) -> Mission:
        if file not in self._documents:
            values, place, line_of = load_document(self._folder / file)
            validated(Mission, values, place, line_of)
            self._documents[file] = values
        values = {**self._documents[file]}
        for (table, key), value in changes.items():
            values[table] = {**values.get(table, {}), key: value}

        def line_of_change(path: tuple[str | int, ...]) -> int | None:
            for root in ((*at, "cross"), (*at, "set"), ("cross",)):
                line = self._line_of((*root, *path[:2]))
                if path[:2] in changes and line != self._line_of(root[:-1]):
                    return line
            return self._line_of(at)

        return validated(Mission, values, self._place, line_of_change)

    def _refused(self, path: tuple[str | int, ...], value: Any, message: str) -> MissionError:
        text = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in path).removeprefix(".")
        told = "" if value is None else shown(value)
        return MissionError([Problem(self._place, self._line_of(path), text, told, message)])


def _key(run: Run, mission: Mission, params: BaseModel) -> str:
    """Equal for equal flights of a run, whatever else the study holds."""
    what = [run.name, run.law, run.backend, mission.model_dump(mode="json"), params.model_dump(mode="json")]
    return hashlib.sha256(json.dumps(what, sort_keys=True).encode()).hexdigest()[:16]


def batches(cases: tuple[Case, ...], size: int) -> Iterator[tuple[Case, ...]]:
    """Cases that one worker flies at once: point masses by up to `size` seeds of the same case, others alone."""
    alike: dict[str, list[Case]] = {}
    for case in cases:
        if case.backend is Backend.POINT_MASS:
            unseeded = case.mission.model_dump_json(exclude={"sim": {"seed"}})
            together = json.dumps([case.run, case.law, unseeded, case.params.model_dump_json()])
        else:
            together = case.key
        alike.setdefault(together, []).append(case)
    for group in alike.values():
        for start in range(0, len(group), size):
            yield tuple(group[start : start + size])


__all__ = ["Backend", "Case", "LoadedStudy", "Run", "Study", "batches", "law_module", "load_study"]

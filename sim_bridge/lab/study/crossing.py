"""Crosses the runs of a study of flights to cases; MissionError with the line of what is refused."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel

from mission.common.problems import MissionError, Problem, dotted, shown
from mission.document import simulator
from mission.document.load import load_document
from mission.document.model import Estimates, Mission, Sim
from mission.schema.check import LineOf, validated
from mission.schema.kinds import FaultKind, SensorClass
from sim_bridge.drive.entrant.installed import installed_names
from sim_bridge.drive.entrant.law import LawError, find_law, load_law
from sim_bridge.drive.entrant.stages import Entrant
from sim_bridge.lab.study.case import Backend, MissionCase
from sim_bridge.lab.study.law import LAWS, law_module, law_params
from sim_bridge.lab.study.results.figures import FLIGHT
from sim_bridge.lab.study.results.must import STATISTICS
from sim_bridge.lab.study.spec import ESTIMATES, OURS, SEED, Run, Study, Tables

MAX_CASES = 100_000
CALM = Sim()
AIR = ("wind_mps", "turbulence_mps")  # in which no point mass flies
ERRORS = ("estimates", "velocity_bias_mps", "climb_bias_mps", "estimate_delay_s", "drag")  # that a law alone has not
ERRORS_AMONG_TREES = ("position_noise_m", "velocity_noise_mps")  # that it has among trees
LIMITABLE = {figure.name: figure for figure in FLIGHT}  # what a run may set limits to


class _Axis(NamedTuple):
    """A key with the values that it takes in turn."""

    key: Any  # a mission's ("swarm", "size"), or a law's "separation_m"
    choices: list[Any]
    path: tuple[str | int, ...]


class _Crossed(NamedTuple):
    """Missions, axes and seeds that a run crosses to."""

    missions: list[tuple[str, tuple[str | int, ...]]]  # each with its place in the study
    fixed: dict[tuple[str, str], Any]
    mission_axes: list[_Axis]
    param_axes: list[_Axis]
    seeds: int
    entrant: Entrant

    def flights(self) -> int:
        """Number of flights."""
        axes = (*self.mission_axes, *self.param_axes)
        return len(self.missions) * math.prod(len(axis.choices) for axis in axes) * self.seeds


class Reader:
    """Crosses a study to cases, and knows the lines for what is refused on the way."""

    def __init__(self, study: Study, folder: Path, place: str, line_of: LineOf, most_seeds: int | None = None) -> None:
        self._most_seeds = most_seeds or MAX_CASES
        self._study, self._folder, self._place, self._line_of = study, folder, place, line_of
        self._documents: dict[str, dict[str, Any]] = {}

    def cases(self) -> Iterator[MissionCase]:
        """Every flight of the study. MissionError."""
        crossed = [self._crossed(index, run) for index, run in enumerate(self._study.run)]
        total = 0
        for index, found in enumerate(crossed):  # before any mission is built, which takes a while
            total += found.flights()
            if total > MAX_CASES:
                raise self._refused(("run", index), None, f"{total} flights up to here: at most {MAX_CASES} in all")
        for index, (run, found) in enumerate(zip(self._study.run, crossed, strict=True)):
            yield from self._run(run, ("run", index), found)

    def _crossed(self, index: int, run: Run) -> _Crossed:
        at: tuple[str | int, ...] = ("run", index)
        if run.backend is Backend.ESTIMATOR:
            raise self._refused(
                (*at, "backend"), run.backend, "flies no missions: its studies are files with localise = 1"
            )
        entrant = self._entrant(run, at)
        self._check_must(run, at)
        named, where = (run.missions, at) if run.missions else (self._study.missions, ())
        missions = [(file, (*where, "missions", number)) for number, file in enumerate(named)]
        if not missions:
            raise self._refused((*at, "missions"), None, "missing here and in the study: name a mission file")
        fixed = {key: value for key, value, _ in self._keys(run.set, (*at, "set"))}
        own = self._axes(run.cross, (*at, "cross"))
        for axis in own:
            if axis.key in fixed:
                raise self._refused(axis.path, axis.choices, "also in set: choose one")
        shared = [axis for axis in self._axes(self._study.cross, ("cross",)) if axis.key not in fixed]
        for axis in own:
            if axis.key in [other.key for other in shared]:
                raise self._refused(axis.path, None, "crossed twice: in the study and in the run")
        param_axes = [_Axis(k, v, (*at, "cross_params", k)) for k, v in run.cross_params.items()]
        for axis in param_axes:
            self._check_choices(axis.path, axis.choices)
            if axis.key in run.params:
                raise self._refused(axis.path, axis.choices, "also in params: choose one")
        return _Crossed(
            missions, fixed, [*shared, *own], param_axes, min(self._most_seeds, run.seeds or self._study.seeds), entrant
        )

    def _entrant(self, run: Run, at: tuple[str | int, ...]) -> Entrant:
        """The entrant that its agents fly."""
        if run.backend is Backend.POINT_MASS:
            if run.law not in LAWS:
                raise self._refused((*at, "law"), run.law, f"must be one of {', '.join(LAWS)}")
            if not run.safety_filter:
                raise self._refused((*at, "safety_filter"), False, "must be true: agents and jsbsim fly without")
        elif run.law.endswith(".py") or run.law in installed_names():
            for key in ("params", "cross_params"):
                if getattr(run, key):
                    raise self._refused((*at, key), None, "a law of its own file or package has none")
            try:
                law = find_law(run.law, self._folder)
                load_law(law)
            except LawError as error:
                raise self._refused((*at, "law"), run.law, str(error)) from None
            return Entrant(law, run.safety_filter)
        elif run.law != OURS:
            named = "".join(f', "{name}"' for name in installed_names())
            must = f'must be "{OURS}"{named} where backend = "{run.backend}", or the file of a law (*.py)'
            raise self._refused((*at, "law"), run.law, must)
        return Entrant(None, run.safety_filter)

    def _run(self, run: Run, at: tuple[str | int, ...], crossed: _Crossed) -> Iterator[MissionCase]:
        for file, named_at in crossed.missions:
            name = {"mission": Path(file).stem} if len(crossed.missions) > 1 else {}
            for chosen in _combined(crossed.mission_axes):
                changes = chosen | crossed.fixed
                if run.backend is not Backend.POINT_MASS and not self._says(ESTIMATES, file, named_at, changes):
                    changes |= {ESTIMATES: Estimates.RECORDED.value}
                mission = self._mission(file, named_at, changes, at)
                if mission.forest.file is not None:
                    must = "has a stem map: studies fly stands that are grown, [forest.stand]"
                    raise self._refused(named_at, file, must)
                self._check_law(run, mission, file, at)
                self._check_unflown(run, mission, file, at)
                if run.backend is Backend.POINT_MASS and mission.flies_by_ranges:
                    must = f"flies with GNSS on all, and {file} does not: must be agents or jsbsim"
                    raise self._refused((*at, "backend"), run.backend, must)
                for lacks, said in (("faults", mission.sim.faults), ("stops", mission.route.stops)):
                    if run.backend is Backend.POINT_MASS and said:
                        must = f"flies no {lacks}, and {file} has some: must be agents or jsbsim"
                        raise self._refused((*at, "backend"), run.backend, must)
                if run.backend is not Backend.POINT_MASS:
                    simulator.check(mission, f"{self._place}: {dotted(at)}: {file}")
                for swept in _combined(crossed.param_axes):
                    settings = name | {f"{table}.{key}": value for (table, key), value in changes.items()}
                    settings |= {f"params.{key}": value for key, value in swept.items()}
                    yield from self._seeds(run, at, mission, settings, swept, crossed)

    def _check_must(self, run: Run, at: tuple[str | int, ...]) -> None:
        for figure, limits in run.must.items():
            if figure not in LIMITABLE:
                raise self._refused((*at, "must", figure), None, f"must be one of {', '.join(LIMITABLE)}")
            for statistic in limits:
                if statistic not in STATISTICS:
                    wrong = f"must be one of {', '.join(STATISTICS)}"
                    raise self._refused((*at, "must", figure, statistic), None, wrong)

    def _check_law(self, run: Run, mission: Mission, file: str, at: tuple[str | int, ...]) -> None:
        among_trees = mission.sensing is not None
        if run.gusts_mps and (run.backend is not Backend.POINT_MASS or not among_trees):
            why = f"point masses among trees alone have them, and {file} has no [sensing]"
            if run.backend is not Backend.POINT_MASS:
                why = 'point masses among trees alone have them: use sim.turbulence_mps with backend = "jsbsim"'
            raise self._refused((*at, "gusts_mps"), run.gusts_mps, why)
        if run.backend is not Backend.POINT_MASS:
            return
        if mission.sensing is not None and mission.sensing.sensor is not SensorClass.SECTORS:
            why = f"flies by sectors alone, and {file} has another sensing.sensor"
            raise self._refused((*at, "backend"), run.backend.value, why)
        if run.law == OURS:
            return
        module = law_module(run.law)
        if among_trees and not hasattr(module, "stage"):
            raise self._refused((*at, "law"), run.law, f"passes no trees, and {file} has [sensing]")
        if not among_trees and hasattr(module, "stage"):
            raise self._refused((*at, "law"), run.law, f"is for trees that are seen, and {file} has no [sensing]")

    def _check_unflown(self, run: Run, mission: Mission, file: str, at: tuple[str | int, ...]) -> None:
        """Refuses errors and wind that the backend would leave out without a word."""
        sim = mission.sim
        unflown: list[str] = []
        if run.backend is not Backend.JSBSIM:
            unflown += [key for key in AIR if getattr(sim, key) != getattr(CALM, key)]
            unflown += ["faults of wind"] if any(fault.kind is FaultKind.WIND for fault in sim.faults) else []
        must = "jsbsim" if unflown else "agents or jsbsim"
        if run.backend is Backend.POINT_MASS:
            errors = ERRORS if mission.sensing is not None else (*ERRORS, *ERRORS_AMONG_TREES)
            unflown += [key for key in errors if getattr(sim, key) not in (None, 0.0, getattr(CALM, key))]
        if unflown:
            told = ", ".join(key if " " in key else f"sim.{key}" for key in unflown)
            raise self._refused(
                (*at, "backend"), run.backend.value, f"flies without {told}, which {file} has: must be {must}"
            )

    def _seeds(
        self,
        run: Run,
        at: tuple[str | int, ...],
        mission: Mission,
        settings: Mapping[str, Any],
        swept: Mapping[str, Any],
        crossed: _Crossed,
    ) -> Iterator[MissionCase]:
        def line_of(path: tuple[str | int, ...]) -> int | None:
            inner = "cross_params" if path and path[0] in swept else "params"
            return self._line_of((*at, inner, *path))

        entrant = crossed.entrant
        law = run.law if entrant.law is None else OURS  # whose parameters it has
        params = law_params(law, {**run.params, **swept}, self._place, line_of)
        if run.gusts_mps:
            settings = {**settings, "gusts_mps": run.gusts_mps}
        first = self._study.first_seed
        for seed in range(first, first + crossed.seeds):
            flown = mission.with_seed(seed)
            key = _key(run, flown, params, entrant)
            yield MissionCase(
                key=key,
                run=run.name,
                law=run.law if entrant.law is None else entrant.name,
                backend=run.backend,
                n=flown.swarm.size,
                seed=seed,
                settings=settings,
                mission=flown,
                params=params,
                gusts_mps=run.gusts_mps,
                entrant=entrant,
            )

    def _keys(
        self, tables: Tables, at: tuple[str | int, ...]
    ) -> Iterator[tuple[tuple[str, str], Any, tuple[str | int, ...]]]:
        """Each mission key in `tables` with what stands there, and where."""
        for table, keys in tables.items():
            if not isinstance(keys, dict):
                raise self._refused((*at, table), keys, "must be a table of mission keys, as swarm.size")
            for key, value in keys.items():
                if (table, key) == SEED:
                    raise self._refused((*at, table, key), value, "the seeds of a study are `seeds` and `first_seed`")
                yield (table, key), value, (*at, table, key)

    def _axes(self, tables: Tables, at: tuple[str | int, ...]) -> list[_Axis]:
        axes = [_Axis(*found) for found in self._keys(tables, at)]
        for axis in axes:
            self._check_choices(axis.path, axis.choices)
        return axes

    def _check_choices(self, path: tuple[str | int, ...], choices: Any) -> None:
        if not isinstance(choices, list) or not choices:
            raise self._refused(path, choices, "must be an array of at least one value")

    def _says(
        self,
        key: tuple[str, str],
        file: str,
        named_at: tuple[str | int, ...],
        changes: Mapping[tuple[str, str], Any],
    ) -> bool:
        """True where the study or the mission file says what `key` is."""
        table, name = key
        return key in changes or name in self._document(file, named_at).get(table, {})

    def _document(self, file: str, named_at: tuple[str | int, ...]) -> dict[str, Any]:
        """A mission file's values, a mission by themselves."""
        if file not in self._documents:
            try:
                values, place, line_of = load_document(self._folder / file)
            except MissionError as error:
                if error.problems[0].line is not None:
                    raise
                raise self._refused(named_at, file, str(error)) from None  # there is no such file, or no reading it
            validated(Mission, values, place, line_of)
            self._documents[file] = values
        return self._documents[file]

    def _mission(
        self,
        file: str,
        named_at: tuple[str | int, ...],
        changes: Mapping[tuple[str, str], Any],
        at: tuple[str | int, ...],
    ) -> Mission:
        values = {**self._document(file, named_at)}
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
        value_text = "" if value is None else shown(value)
        return MissionError([Problem(self._place, self._line_of(path), text, value_text, message)])


def _combined(axes: list[_Axis]) -> Iterator[dict[Any, Any]]:
    keys = [axis.key for axis in axes]
    for chosen in itertools.product(*(axis.choices for axis in axes)):
        yield dict(zip(keys, chosen, strict=True))


def _key(run: Run, mission: Mission, params: BaseModel, entrant: Entrant) -> str:
    """Equal for equal flights of a run, whatever else the study holds."""
    what: list[Any] = [run.name, run.law, run.backend, mission.model_dump(mode="json"), params.model_dump(mode="json")]
    if run.gusts_mps:
        what.append(run.gusts_mps)
    if not entrant.is_ours:
        what.append(entrant.figures())
    return hashlib.sha256(json.dumps(what, sort_keys=True).encode()).hexdigest()[:16]

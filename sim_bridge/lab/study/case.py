"""One flight of a study, whatever flies it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Protocol

from pydantic import BaseModel

from mission.document.model import Mission
from sim_bridge.drive.entrant.stages import BY_OURS, Entrant


class Backend(StrEnum):
    """Backend of a run: see `backends`."""

    POINT_MASS = "point-mass"  # the law alone, over arrays of point masses
    AGENTS = "agents"  # the whole stack in lockstep (agents, codec, radio, autopilots) on point masses
    JSBSIM = "jsbsim"  # the same on JSBSim quadrotors
    ESTIMATOR = "estimator"  # the relative filter on simulated measurements of a flight


@dataclass(frozen=True, slots=True)
class Case:
    """One flight of a study."""

    key: str  # hash of all that decides the flight
    run: str
    law: str
    backend: Backend
    n: int
    seed: int
    settings: Mapping[str, Any]  # what was crossed: mission file, mission keys, law parameters

    def identity(self) -> dict[str, Any]:
        """The first columns of its row."""
        return {
            "key": self.key,
            "run": self.run,
            "law": self.law,
            "backend": self.backend.value,
            "n": self.n,
            "seed": self.seed,
            "settings": dict(self.settings),
        }


@dataclass(frozen=True, slots=True)
class MissionCase(Case):
    """A mission that is flown by a law."""

    mission: Mission  # with size, seed and all keys set
    params: BaseModel
    gusts_mps: float = 0.0
    entrant: Entrant = BY_OURS  # what agents fly in place of ours


class Run(Protocol):
    """Run of a study, of whichever kind."""

    @property
    def name(self) -> str:
        """For people: heads its rows."""

    @property
    def must(self) -> Mapping[str, Mapping[str, float]]:
        """Limits of each of its cases."""


class Study(Protocol):
    """Study, of whichever kind."""

    @property
    def name(self) -> str:
        """For people."""

    @property
    def run(self) -> Sequence[Run]:
        """Its runs."""


@dataclass(frozen=True, slots=True)
class LoadedStudy:
    """A checked study file."""

    study: Study
    cases: tuple[Case, ...]

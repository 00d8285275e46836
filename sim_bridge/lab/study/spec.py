"""Study files of flights: missions, laws, backends, parameters, seeds and limits, run by run."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from mission.schema.fields import Integer, Number, Text
from sim_bridge.lab.study.case import Backend

OURS = "ours"
SEED = ("sim", "seed")
ESTIMATES = ("sim", "estimates")  # recorded, where autopilots fly and neither the study nor the mission says it
Tables = dict[str, dict[str, Any]]


class Table(BaseModel):
    """Base of the tables of a study file."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)


class Run(Table):
    """One law on one backend over the cross of everything else. What stands here goes before the study's own.

    A key in `set` is not crossed by the study's `cross`.
    """

    name: Annotated[
        Text, Field(min_length=1, max_length=60, description="For people: heads its rows. No two runs have one.")
    ]
    law: Annotated[
        Text,
        Field(
            max_length=200,
            description="Movement law: one of those below, or a file (`*.py`, from this file) or the name of an "
            "installed law that agents and jsbsim fly, see [fly your own law](../how-to/fly-your-own-law.md).",
        ),
    ] = OURS
    backend: Annotated[Backend, Field(description="What flies it.")] = Backend.POINT_MASS
    safety_filter: Annotated[
        bool,
        Field(strict=True, description="False: agents and jsbsim fly what the law desires, within the speed limits."),
    ] = True
    missions: Annotated[tuple[Text, ...], Field(max_length=100, description="Mission files, from this file.")] = ()
    seeds: Annotated[Integer | None, Field(ge=1, le=100_000, description="How many.")] = None
    set: Annotated[Tables, Field(description="Mission keys, as a mission has them.")] = {}
    cross: Annotated[Tables, Field(description="Mission keys, each with an array of values.")] = {}
    params: Annotated[dict[str, Any], Field(description="The law's parameters.")] = {}
    cross_params: Annotated[dict[str, Any], Field(description="The law's parameters, each with an array.")] = {}
    gusts_mps: Annotated[
        Number,
        Field(
            ge=0.0,
            le=5.0,
            description="Of point masses among trees: what an autopilot does not hold against, rms on each level axis.",
        ),
    ] = 0.0
    must: Annotated[
        dict[str, dict[str, Number]],
        Field(
            description="What each of its cases must reach: figure = { mean, worst, p95 }, any of them; p95 is what "
            "95 % of the seeds keep. Of a figure that is to be large these are the least, of others the most. A flight "
            "that lacks a figure misses mean and worst, unless it did not arrive and the run limits `arrived`."
        ),
    ] = {}


class Study(Table):
    """A study."""

    model_config = ConfigDict(title="Understory study")

    schema_version: Integer = Field(alias="schema", ge=1, le=1, description="Version of this layout.", examples=[1])
    name: Annotated[Text, Field(max_length=80, description="For people.")] = ""
    missions: Annotated[tuple[Text, ...], Field(max_length=100, description="Mission files, from this file.")] = ()
    seeds: Annotated[Integer, Field(ge=1, le=100_000, description="How many, for every case.")] = 1
    first_seed: Annotated[Integer, Field(ge=0, le=2**31, description="The seeds count up from here.")] = 1
    cross: Annotated[Tables, Field(description="Mission keys, each with an array of values.")] = {}
    run: Annotated[tuple[Run, ...], Field(min_length=1, max_length=100, description="What flies.")]

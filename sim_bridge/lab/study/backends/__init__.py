"""Backends fly the cases of a study: one class for each backend, behind the interface of `base`."""

from __future__ import annotations

from typing import Any, Final

from sim_bridge.lab.study.backends.agents import AgentsBackend
from sim_bridge.lab.study.backends.base import FlightBackend
from sim_bridge.lab.study.backends.estimator import EstimatorBackend
from sim_bridge.lab.study.backends.point_mass import PointMassBackend
from sim_bridge.lab.study.case import Backend

__all__ = ["BACKENDS", "AgentsBackend", "FlightBackend"]

BACKENDS: Final[dict[Backend, FlightBackend[Any]]] = {
    Backend.POINT_MASS: PointMassBackend(),
    Backend.AGENTS: AgentsBackend(on_jsbsim=False),
    Backend.JSBSIM: AgentsBackend(on_jsbsim=True),
    Backend.ESTIMATOR: EstimatorBackend(),
}

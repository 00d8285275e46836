"""The interface between the study engine and what flies its cases."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, Generic, TypeVar

from sim_bridge.lab.study.case import Case

CaseT = TypeVar("CaseT", bound=Case)


class FlightBackend(ABC, Generic[CaseT]):
    """Flies cases to figures. It runs in worker processes, and on other machines: it keeps caches, no state."""

    always: ClassVar[str] = "arrived"  # a figure that each of its flights has

    @abstractmethod
    def fly(self, cases: Sequence[CaseT]) -> list[dict[str, Any]]:
        """The figures of each case, in their order; all have the same `batch_key`."""

    @abstractmethod
    def estimate_cost(self, case: CaseT) -> float:
        """Duration of computing a flight, relative to others: for the time left."""

    def batch_key(self, case: CaseT) -> str:
        """Cases with the same key are flown at once, by one worker."""
        return case.key

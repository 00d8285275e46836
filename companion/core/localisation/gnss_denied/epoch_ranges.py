"""The ranges of an epoch by pair: what all ranges of a pair agree on, that it is farther apart, may be a trunk between.

What comes round a trunk is late by the same for as long as the trunk stands between. Of one range 0.3 m is three
sigmas, and hardly to be told from noise; of the mean of an epoch's, where trunks that two have seen tell the distance
to centimetres, it is more. So ranges lose weight together, by their mean, and on the late side only.
"""

from __future__ import annotations

from typing import Final, final

from companion.core.localisation.gnss_denied.error_state import Errors, ErrorStateCovariance

LATE: Final = 2.5  # sigmas of the mean: beyond, the weight falls with the fourth power

_Innovation = tuple[float, float, float, float]  # direction north, east; longer than thought, m; weight, 1/m2


@final
class EpochRanges:
    """Of one filter. Slots are those of `ErrorStateCovariance`."""

    __slots__ = ("_by_pair", "_errors")

    def __init__(self, errors: Errors) -> None:
        self._errors: Final = errors
        self._by_pair: dict[tuple[int, int], list[_Innovation]] = {}

    def add(self, slots: tuple[int, int], innovation: _Innovation, joint: ErrorStateCovariance) -> None:
        """One range that counts by itself."""
        if self._errors.mean_range_m is None:
            u_n, u_e, off_m, weight = innovation
            joint.add_range(slots[0], slots[1], u_n, u_e, off_m, weight)
        else:
            self._by_pair.setdefault(slots, []).append(innovation)

    def reckon_in(self, joint: ErrorStateCovariance) -> None:
        """Hands over those that were kept, and begins anew."""
        for (a, b), innovations in self._by_pair.items():
            keep = self._keep_late(a, b, innovations, joint)
            for u_n, u_e, off_m, weight in innovations:
                joint.add_range(a, b, u_n, u_e, off_m, keep * weight)
        self._by_pair.clear()

    def _keep_late(self, a: int, b: int, innovations: list[_Innovation], joint: ErrorStateCovariance) -> float:
        """The share of their weight that they keep."""
        u_n, u_e, _, _ = innovations[-1]
        common_m = self._errors.mean_range_m or 0.0
        mean_m = sum([off_m for _, _, off_m, _ in innovations]) / len(innovations)
        variance = self._errors.range_m**2 / len(innovations) + common_m * common_m
        variance += joint.range_variance(a, b, u_n, u_e)
        if mean_m <= 0.0 or mean_m * mean_m <= LATE * LATE * variance:
            return 1.0
        return (LATE * LATE * variance / (mean_m * mean_m)) ** 2

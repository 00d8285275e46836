"""Tracked trunks: axes of stems that stand still, each with its covariance and its own small filter.

Positions are those of the own odometry, as scans correct it (`scan_odometry`). A trunk is good, and corrects the pose,
after GOOD_SIGHTINGS over GOOD_S that agree; what moves never is good for long.
"""

from __future__ import annotations

import math
from typing import Final, final

from companion.core.perception.landmarks.stem_clusters import Stem

GATE_CHI2: Final = 12.0
AMBIGUOUS_CHI2: Final = 4.0  # a second trunk this near to a stem: neither is taken
NEAR_M: Final = 1.2  # no stem is compared with a trunk farther off
GOOD_SIGHTINGS: Final = 4
GOOD_S: Final = 0.5
GOOD_CHI2: Final = 4.0  # of its sightings, lately
MOVED_M: Final = 0.2  # and two sigmas from where it was first seen: what has gone farther begins to stand still anew
CHI2_FOLLOW: Final = 0.2  # of a new sighting in that
WANDERS_M2_PER_S: Final = 0.02 * 0.02  # the side that is seen goes round
RADIUS_FOLLOW: Final = 0.1
UNSEEN_S: Final = 6.0  # until it is forgotten
UNPROVEN_S: Final = 0.5  # and one that is not good: what moves leaves a trail of them
TRACKS_MAX: Final = 192  # twice the stems of a turn: those that were passed are kept for UNSEEN_S


@final
class Trunk:
    """One track. Metres north and east in the frame of the own odometry; covariance of the axis."""

    __slots__ = (
        "born_east_m",
        "born_north_m",
        "born_s",
        "born_sd_m",
        "chi2",
        "east_m",
        "ee_m2",
        "ne_m2",
        "nn_m2",
        "north_m",
        "radius_m",
        "seen_s",
        "sightings",
    )

    def __init__(
        self, north_m: float, east_m: float, covariance: tuple[float, float, float], radius_m: float, now_s: float
    ) -> None:
        self.north_m = self.born_north_m = north_m
        self.east_m = self.born_east_m = east_m
        self.nn_m2, self.ne_m2, self.ee_m2 = covariance
        self.radius_m = radius_m
        self.born_s = now_s
        self.born_sd_m: Final = math.sqrt(max(covariance[0], covariance[2]))
        self.seen_s = now_s
        self.sightings = 1
        self.chi2 = 0.0

    @property
    def is_good(self) -> bool:
        """It stands still, as far as its sightings tell."""
        is_proven = self.sightings >= GOOD_SIGHTINGS and self.seen_s - self.born_s >= GOOD_S - 1e-6
        return is_proven and self.chi2 < GOOD_CHI2

    def note_sighting(self, chi2: float, now_s: float) -> None:
        """After its position was updated."""
        self.seen_s = now_s
        self.sightings += 1
        self.chi2 += max(CHI2_FOLLOW, 1.0 / self.sightings) * (chi2 - self.chi2)
        n, e = self.north_m - self.born_north_m, self.east_m - self.born_east_m
        moved_m = MOVED_M + 2.0 * self.born_sd_m
        if n * n + e * e > moved_m * moved_m:
            self.born_north_m, self.born_east_m = self.north_m, self.east_m
            self.born_s, self.sightings = now_s, 1


@final
class Sighting:
    """A stem as it was placed, and the trunk that it is taken for; None: a new one, or nobody's."""

    __slots__ = ("chi2", "covariance", "east_m", "is_ambiguous", "north_m", "stem", "trunk")

    def __init__(self, stem: Stem) -> None:
        """As the pose had it when it was seen."""
        self.stem: Final = stem
        self.trunk: Trunk | None = None
        self.chi2 = math.inf
        self.is_ambiguous = False
        self.north_m = self.east_m = 0.0
        self.covariance = (0.0, 0.0, 0.0)
        self.place_stem(0.0, (0.0, 0.0), stem.radius_m)

    def moves_m_per_rad(self, turned_rad: float, radius_m: float) -> tuple[float, float]:
        """By how much its axis moves when the pose turns clockwise: across its bearing."""
        away_m, bearing_rad = self.stem.surface_m + radius_m, self.stem.bearing_rad + turned_rad
        return -away_m * math.sin(bearing_rad), away_m * math.cos(bearing_rad)

    def place_stem(self, turned_rad: float, shift: tuple[float, float], radius_m: float) -> None:
        """Places its axis, of a pose turned and moved by so much since; the covariance is of that scan alone."""
        stem = self.stem
        north, east = math.cos(stem.bearing_rad + turned_rad), math.sin(stem.bearing_rad + turned_rad)
        away_m = stem.surface_m + radius_m
        self.north_m = stem.eye_north_m + shift[0] + north * away_m
        self.east_m = stem.eye_east_m + shift[1] + east * away_m
        along, across = stem.along_sd_m * stem.along_sd_m, stem.across_sd_m * stem.across_sd_m
        self.covariance = (
            along * north * north + across * east * east,
            (along - across) * north * east,
            along * east * east + across * north * north,
        )


@final
class TrunkTracks:
    """One vehicle's."""

    __slots__ = ("_tracked_s", "trunks")

    def __init__(self) -> None:
        self.trunks: list[Trunk] = []
        self._tracked_s = 0.0

    def match_stem(self, sighting: Sighting, pose_m2: tuple[float, float, float]) -> None:
        """Finds the trunk that a stem is. `pose_m2`: covariance of the stem's place by the pose's errors."""
        best: Trunk | None = None
        least = second = math.inf
        nn, ne, ee = sighting.covariance
        nn, ne, ee = nn + pose_m2[0], ne + pose_m2[1], ee + pose_m2[2]
        for trunk in self.trunks:
            dn, de = sighting.north_m - trunk.north_m, sighting.east_m - trunk.east_m
            if dn * dn + de * de > NEAR_M * NEAR_M:
                continue
            chi2 = chi2_of(dn, de, nn + trunk.nn_m2, ne + trunk.ne_m2, ee + trunk.ee_m2)
            if chi2 < least:
                best, least, second = trunk, chi2, least
            elif chi2 < second:
                second = chi2
        sighting.is_ambiguous = second < AMBIGUOUS_CHI2
        if best is not None and least < GATE_CHI2 and not sighting.is_ambiguous:
            sighting.trunk, sighting.chi2 = best, least

    def update_trunk(self, sighting: Sighting, now_s: float) -> None:
        """A trunk is where it was, and where it is seen now; a stem that is no trunk's begins one."""
        nn, ne, ee = sighting.covariance
        trunk = sighting.trunk
        if trunk is None:
            if not sighting.is_ambiguous and len(self.trunks) < TRACKS_MAX and not self._is_beside(sighting):
                self.trunks.append(
                    Trunk(sighting.north_m, sighting.east_m, (nn, ne, ee), sighting.stem.radius_m, now_s)
                )
            return
        s_nn, s_ne, s_ee = trunk.nn_m2 + nn, trunk.ne_m2 + ne, trunk.ee_m2 + ee
        det = s_nn * s_ee - s_ne * s_ne
        dn, de = sighting.north_m - trunk.north_m, sighting.east_m - trunk.east_m
        # The gain: its covariance times the inverse of both
        p_nn, p_ne, p_ee = trunk.nn_m2, trunk.ne_m2, trunk.ee_m2
        k_nn, k_ne = (p_nn * s_ee - p_ne * s_ne) / det, (p_ne * s_nn - p_nn * s_ne) / det
        k_en, k_ee = (p_ne * s_ee - p_ee * s_ne) / det, (p_ee * s_nn - p_ne * s_ne) / det
        trunk.north_m += k_nn * dn + k_ne * de
        trunk.east_m += k_en * dn + k_ee * de
        trunk.nn_m2 = p_nn - k_nn * p_nn - k_ne * p_ne
        trunk.ne_m2 = p_ne - k_nn * p_ne - k_ne * p_ee
        trunk.ee_m2 = p_ee - k_en * p_ne - k_ee * p_ee
        if not sighting.stem.is_hidden:
            trunk.radius_m += RADIUS_FOLLOW * (sighting.stem.radius_m - trunk.radius_m)
        trunk.note_sighting(sighting.chi2, now_s)

    def forget(self, now_s: float) -> None:
        """Drops those unseen for UNSEEN_S; the others are known a little less well."""
        wanders_m2 = WANDERS_M2_PER_S * max(0.0, min(1.0, now_s - self._tracked_s))
        self._tracked_s = now_s
        self.trunks = [
            trunk for trunk in self.trunks if now_s - trunk.seen_s <= (UNSEEN_S if trunk.is_good else UNPROVEN_S)
        ]
        for trunk in self.trunks:
            trunk.nn_m2 += wanders_m2
            trunk.ee_m2 += wanders_m2

    def turn_about(self, north_m: float, east_m: float, turn_rad: float) -> None:
        """All positions, about a place; clockwise."""
        for trunk in self.trunks:
            trunk.north_m, trunk.east_m = turned_about(north_m, east_m, (trunk.north_m, trunk.east_m), turn_rad)
            trunk.born_north_m, trunk.born_east_m = turned_about(
                north_m, east_m, (trunk.born_north_m, trunk.born_east_m), turn_rad
            )

    def _is_beside(self, sighting: Sighting) -> bool:
        """True near a track: two of one trunk would both be ambiguous for ever."""
        beside_m = sighting.stem.radius_m + 0.3
        for trunk in self.trunks:
            dn, de = sighting.north_m - trunk.north_m, sighting.east_m - trunk.east_m
            if dn * dn + de * de < beside_m * beside_m:
                return True
        return False


def turned_about(north_m: float, east_m: float, place: tuple[float, float], turn_rad: float) -> tuple[float, float]:
    """A place, turned clockwise about another."""
    cos, sin = math.cos(turn_rad), math.sin(turn_rad)
    n, e = place[0] - north_m, place[1] - east_m
    return north_m + cos * n - sin * e, east_m + sin * n + cos * e


def chi2_of(dn: float, de: float, nn: float, ne: float, ee: float) -> float:
    """Squared distance in sigmas, by a covariance."""
    det = nn * ee - ne * ne
    return (ee * dn * dn - 2.0 * ne * dn * de + nn * de * de) / det if det > 0.0 else math.inf

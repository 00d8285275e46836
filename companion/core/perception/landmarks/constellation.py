"""Aligns a constellation of trunks that a neighbour tells with the own remembered ones: its place and turn from here.

Pairs of a told and a known trunk vote for a shift, at each degree of turn about where the neighbour is thought to be;
the best votes are refined by least squares. One that is accepted has matched so many trunks as none of strangers does,
and clearly more than any other place; what is left to chance the caller excludes by two in a row that agree.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, final

from companion.core.model.beacon import ToldTrunk

SHIFT_M: Final = 3.0  # searched, about where the neighbour is thought to be
TURNS: Final = 8  # searched to either side of the turn that is thought, each of
TURN_RAD: Final = math.radians(1.0)
VOTE_M: Final = 0.4
MATCH_M: Final = 0.35  # of a told trunk to a known one, at last
DIAMETERS_M: Final = 0.15  # by which two sightings of one trunk part at most
PAIRS_MAX: Final = 96  # of a turn; more are a thicket
TRIES: Final = 8  # votes that are refined
VOTES_SHARE: Final = 0.5  # of the best one's matches: with fewer votes no other place matches SECOND_SHARE of them
FITS: Final = 4  # of each, one upon the other
LEAST: Final = 6  # trunks matched
LEAST_WIDE: Final = 7  # where the place was uncertain before
SECOND_SHARE: Final = 0.8  # of them, that another place may match
OVERLAP_SHARE: Final = 0.4  # of the trunks that both should know: of a thicket more are known
BESIDE_M: Final = 4.0
ANOTHER_M: Final = 0.7  # what is nearer is the same place
TURN_SD_MAX_RAD: Final = math.radians(1.0)
TRUNK_SD_M: Final = 0.08  # of two sightings of a trunk against each other, at best, an axis

Level = tuple[float, float]  # north, east, m
_Pair = tuple[float, float, float, float]  # told north, east; known north, east


@final
class Alignment:
    """Rigid motion of a told frame into the own one: `there` is `here`, its axes are turned clockwise by `turn_rad`.

    At this place, the matched trunks' middle, errors of place and turn are independent.
    """

    __slots__ = ("here", "matched", "position_sd_m", "there", "turn_rad", "turn_sd_rad")

    def __init__(
        self, there: Level, here: Level, turn_rad: float, *, position_sd_m: float, turn_sd_rad: float, matched: int
    ) -> None:
        """Standard deviations: of the place on each axis."""
        self.there: Final = there
        self.here: Final = here
        self.turn_rad: Final = turn_rad
        self.position_sd_m: Final = position_sd_m
        self.turn_sd_rad: Final = turn_sd_rad
        self.matched: Final = matched

    def place(self, there: Level) -> Level:
        """A told place in the own frame."""
        n, e = turned(self.turn_rad, there[0] - self.there[0], there[1] - self.there[1])
        return self.here[0] + n, self.here[1] + e


def align(
    told: Sequence[ToldTrunk], known: Sequence[ToldTrunk], place: Level, turn_rad: float, *, is_wide: bool
) -> Alignment | None:
    """The alignment of told trunks with known ones; None: there is none to rely on.

    `told`: about the neighbour, the nearest first, in its axes; `known`: about this vehicle, in the own. `place` and
    `turn_rad`: as the neighbour is thought to be, in these; `is_wide`: that is uncertain.
    """
    least = LEAST_WIDE if is_wide else LEAST
    if min(len(told), len(known)) < least:
        return None
    best: Alignment | None = None
    second = 0
    found: list[Alignment] = []
    for votes, _, start in _vote(told, known, place, turn_rad):
        if len(found) >= TRIES or (best is not None and -votes < VOTES_SHARE * best.matched):
            break
        if is_one_of(start, found):
            continue
        fit = refine(told, known, start)
        if fit is not None:
            found.append(fit)
            if best is None or fit.matched > best.matched:
                best = fit
    if best is None:
        return None
    for fit in found:
        if not is_one_of(fit, [best]):
            second = max(second, fit.matched)
    overlap = count_expected(told, known, best)
    is_unique = second <= SECOND_SHARE * best.matched
    is_complete = best.matched >= OVERLAP_SHARE * overlap
    at = best.place((0.0, 0.0))
    is_near = math.hypot(at[0] - place[0], at[1] - place[1]) <= SHIFT_M + ANOTHER_M
    return best if best.matched >= least and is_unique and is_complete and is_near and is_sharp(best) else None


def is_sharp(fit: Alignment) -> bool:
    return fit.turn_sd_rad < TURN_SD_MAX_RAD


def _vote(
    told: Sequence[ToldTrunk], known: Sequence[ToldTrunk], place: Level, turn_rad: float
) -> list[tuple[int, float, Alignment]]:
    """Shifts and turns with how many trunks vote for each, the most first; then those turned least."""
    middle = (sum([one[0] for one in told]) / len(told), sum([one[1] for one in told]) / len(told))
    votes: list[tuple[int, float, Alignment]] = []
    pairs = _find_near(told, known, place, turn_rad)
    for step in range(-TURNS, TURNS + 1):
        at_rad = turn_rad + step * TURN_RAD
        shifts = _find_shifts(pairs, at_rad)
        n, e = turned(at_rad, middle[0], middle[1])
        for k in range(len(shifts)):
            count = _count_votes(shifts, k)
            if count >= LEAST - 1:
                here = (place[0] + n + shifts[k][1], place[1] + e + shifts[k][2])
                start = Alignment(middle, here, at_rad, position_sd_m=0.0, turn_sd_rad=0.0, matched=count)
                votes.append((-count, abs(step) + 0.001 * k, start))
    votes.sort(key=_rank_of)
    return votes


def _rank_of(vote: tuple[int, float, Alignment]) -> tuple[int, float]:
    return vote[0], vote[1]


def _find_near(
    told: Sequence[ToldTrunk], known: Sequence[ToldTrunk], place: Level, turn_rad: float
) -> list[tuple[int, _Pair]]:
    """Pairs of trunks as thick as each other that any turn within those searched may bring near, by told ones."""
    pairs: list[tuple[int, _Pair]] = []
    for k in range(len(told)):
        north_m, east_m, diameter_m = told[k]
        n, e = turned(turn_rad, north_m, east_m)
        reach_m = SHIFT_M + TURNS * TURN_RAD * math.hypot(north_m, east_m)
        for one in known:
            dn, de = one[0] - place[0] - n, one[1] - place[1] - e
            if dn * dn + de * de <= reach_m * reach_m and abs(one[2] - diameter_m) <= DIAMETERS_M:
                pairs.append((k, (north_m, east_m, one[0] - place[0], one[1] - place[1])))
    return pairs


def _find_shifts(pairs: Sequence[tuple[int, _Pair]], turn_rad: float) -> list[tuple[int, float, float]]:
    """Of each pair of trunks near to each other: which told one, and how far the known one is from it."""
    shifts: list[tuple[int, float, float]] = []
    cos, sin = math.cos(turn_rad), math.sin(turn_rad)
    for k, (north_m, east_m, known_n, known_e) in pairs:
        dn, de = known_n - (cos * north_m - sin * east_m), known_e - (sin * north_m + cos * east_m)
        if dn * dn + de * de <= SHIFT_M * SHIFT_M:
            shifts.append((k, dn, de))
            if len(shifts) >= PAIRS_MAX:
                break
    return shifts


def _count_votes(shifts: Sequence[tuple[int, float, float]], chosen: int) -> int:
    """Told trunks, each once, that are shifted as this one."""
    _, north_m, east_m = shifts[chosen]
    count, last = 0, -1
    for k, dn, de in shifts:
        n, e = dn - north_m, de - east_m
        if k != last and n * n + e * e <= VOTE_M * VOTE_M:
            count, last = count + 1, k
    return count


def refine(told: Sequence[ToldTrunk], known: Sequence[ToldTrunk], start: Alignment) -> Alignment | None:
    """By least squares over the trunks that match; None: too few."""
    fit, reach_m = start, VOTE_M + MATCH_M
    for _ in range(FITS):
        pairs = _match(told, known, fit, reach_m)
        if len(pairs) < LEAST - 1:
            return None
        fit, reach_m = _fit(pairs), MATCH_M
    return fit


def _match(told: Sequence[ToldTrunk], known: Sequence[ToldTrunk], fit: Alignment, reach_m: float) -> list[_Pair]:
    """Each known trunk with the nearest told one of those whose nearest it is."""
    nearest: dict[int, tuple[float, int]] = {}
    for k in range(len(told)):
        n, e = fit.place((told[k][0], told[k][1]))
        best, least = -1, reach_m * reach_m
        for j in range(len(known)):
            dn, de = known[j][0] - n, known[j][1] - e
            if dn * dn + de * de <= least and abs(known[j][2] - told[k][2]) <= DIAMETERS_M:
                best, least = j, dn * dn + de * de
        if best >= 0 and (best not in nearest or least < nearest[best][0]):
            nearest[best] = (least, k)
    return [(told[k][0], told[k][1], known[j][0], known[j][1]) for j, (_, k) in nearest.items()]


def _fit(pairs: Sequence[_Pair]) -> Alignment:
    """The rigid motion of least squares, about the middles of both."""
    count = len(pairs)
    t_n, t_e = sum([p[0] for p in pairs]) / count, sum([p[1] for p in pairs]) / count
    k_n, k_e = sum([p[2] for p in pairs]) / count, sum([p[3] for p in pairs]) / count
    along = across = square = 0.0
    for a_n, a_e, b_n, b_e in pairs:
        a_n, a_e, b_n, b_e = a_n - t_n, a_e - t_e, b_n - k_n, b_e - k_e
        along += a_n * b_n + a_e * b_e
        across += a_n * b_e - a_e * b_n
        square += a_n * a_n + a_e * a_e
    turn_rad = math.atan2(across, along)
    rest = 0.0
    for a_n, a_e, b_n, b_e in pairs:
        n, e = turned(turn_rad, a_n - t_n, a_e - t_e)
        rest += (b_n - k_n - n) ** 2 + (b_e - k_e - e) ** 2
    sd_m = max(TRUNK_SD_M, math.sqrt(rest / max(1, 2 * count - 3)))
    turn_sd_rad = sd_m / math.sqrt(square) if square > 0.0 else math.inf
    position_sd_m = sd_m / math.sqrt(count)
    return Alignment(
        (t_n, t_e), (k_n, k_e), turn_rad, position_sd_m=position_sd_m, turn_sd_rad=turn_sd_rad, matched=count
    )


def is_one_of(fit: Alignment, found: Sequence[Alignment]) -> bool:
    for other in found:
        n, e = other.place(fit.there)
        if math.hypot(fit.here[0] - n, fit.here[1] - e) < ANOTHER_M:
            return True
    return False


def count_expected(told: Sequence[ToldTrunk], known: Sequence[ToldTrunk], fit: Alignment) -> int:
    """Known trunks beside those told: who has seen these has mostly seen them."""
    places = [fit.place((one[0], one[1])) for one in told]
    count = 0
    for one in known:
        for n, e in places:
            if math.hypot(one[0] - n, one[1] - e) <= BESIDE_M:
                count += 1
                break
    return count


def turned(by_rad: float, north: float, east: float) -> Level:
    """A level vector, turned clockwise."""
    c, s = math.cos(by_rad), math.sin(by_rad)
    return c * north - s * east, s * north + c * east

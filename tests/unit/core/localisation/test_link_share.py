"""The share of a neighbour's beacons that arrives, and the silence after which it is not heard any more."""

from __future__ import annotations

import heapq
import random
from collections.abc import Callable

import pytest

from companion.core.localisation.link_share import ALL, SILENCE_MAX_S, WINDOW, LinkShare, periods_of_silence

PERIOD_S, STALE_S = 0.1, 0.5


class Link:
    """Beacons of one neighbour over a drawn radio; `silences`: how often it counted as silent, though it spoke."""

    def __init__(
        self, loss: float, delay_s: Callable[[random.Random], float] = lambda _rng: 0.0, *, seed: int = 1
    ) -> None:
        self.measured, self.silences, self.longest_s = LinkShare(PERIOD_S, STALE_S), 0, 0.0
        self._loss, self._delay_s, self._rng = loss, delay_s, random.Random(seed)
        self._under_way: list[tuple[float, float]] = []
        self._sent, self._heard_s, self._newest_s, self._silent = 0, 0.0, -1.0, False

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / PERIOD_S)):
            now_s = PERIOD_S * self._sent
            self._sent += 1
            if self._rng.random() >= self._loss:
                heapq.heappush(self._under_way, (now_s + self._delay_s(self._rng), now_s))
            while self._under_way and self._under_way[0][0] <= now_s + 1e-9:
                _, made_s = heapq.heappop(self._under_way)
                self.measured.record(made_s, now_s - made_s, now_s)
                if made_s > self._newest_s:
                    self._newest_s, self._heard_s, self._silent = made_s, now_s, False
            self.longest_s = max(self.longest_s, now_s - self._heard_s)
            if now_s - self._heard_s > self.measured.stale_s + 1e-9 and not self._silent:
                self._silent, self.silences = True, self.silences + 1


@pytest.mark.parametrize("loss", [0.0, 0.1, 0.2, 0.4, 0.6])
def test_share_of_beacons_that_arrive_is_measured(loss: float) -> None:
    found = []
    for seed in range(20):
        link = Link(loss, seed=seed)
        link.run(30.0)
        found.append(link.measured.share)
    assert sum(found) / len(found) == pytest.approx(1.0 - loss, abs=0.04)


def test_by_a_good_radio_all_is_as_if_nothing_were_measured() -> None:
    for delay_s in (0.0, 0.3):
        link = Link(0.0, lambda _rng, delay_s=delay_s: delay_s)
        for _ in range(100):
            link.run(0.5)
            assert link.measured.stale_s == STALE_S


def test_a_bad_radio_seldom_makes_a_neighbour_silent_that_speaks() -> None:
    """By 0.5 s it would be about one in 17 s at 40 % loss: 1,200 in the six hours."""
    silences = {}
    for loss in (0.2, 0.3, 0.4):
        link = Link(loss)
        link.run(6 * 3600.0)
        silences[loss] = link.silences
    assert max(silences.values()) <= 6, silences


def test_uneven_delays_are_waited_for() -> None:
    """Every two seconds all beacons of 0.8 s come together: nothing is lost, and yet nothing comes for as long."""
    link, stale_s = LinkShare(PERIOD_S, STALE_S), []
    for second in range(0, 20, 2):
        for k in range(20):
            made_s = second + PERIOD_S * k
            now_s = max(made_s, second + 0.8)
            link.record(made_s, now_s - made_s, now_s)
        stale_s.append(link.stale_s)
    assert link.share == 1.0
    assert min(stale_s) >= 0.8


def test_overtaken_beacons_count_as_arrived() -> None:
    link = Link(0.2, lambda rng: rng.uniform(0.0, 0.4))
    link.run(600.0)
    assert link.silences == 0
    assert link.measured.share == pytest.approx(0.8, abs=0.15)


@pytest.mark.parametrize("loss", [0.5, 0.8, 0.95])
def test_silence_is_noticed_within_a_bound_whatever_is_lost(loss: float) -> None:
    link = Link(loss, lambda rng: rng.uniform(0.0, 2.0))
    for _ in range(200):
        link.run(1.0)
        assert STALE_S <= link.measured.stale_s <= SILENCE_MAX_S


def test_losses_in_a_row_that_make_a_silence_are_fewer_the_better_the_link() -> None:
    found = [periods_of_silence(arrived) for arrived in range(1, WINDOW + 1)]
    assert found == sorted(found, reverse=True)
    assert [periods_of_silence(round(share * WINDOW)) for share in (0.6, 0.9, 0.95)] == [16, 6, 5]


def test_a_cut_is_no_loss_of_beacons() -> None:
    link = LinkShare(PERIOD_S, STALE_S)
    for k in range(100):
        link.record(PERIOD_S * k, 0.0, PERIOD_S * k)
    for k in range(400, 420):
        link.record(PERIOD_S * k, 0.0, PERIOD_S * k)
    assert link.share == 1.0
    assert link.stale_s == STALE_S


def test_a_sender_that_began_anew_is_measured_on() -> None:
    link = LinkShare(PERIOD_S, STALE_S)
    for k in range(100):
        link.record(500.0 + PERIOD_S * k, 0.0, PERIOD_S * k)
    for k in range(100):
        link.record(0.2 * k, 0.0, 10.0 + 0.2 * k)  # every second one
    assert link.share == pytest.approx(0.5, abs=0.05)


def test_beacons_sent_before_their_time_hide_no_loss_and_make_none() -> None:
    link = LinkShare(PERIOD_S, STALE_S)
    for k in range(200):
        for early_s in (0.0, PERIOD_S / 2.0):
            link.record(PERIOD_S * k + early_s, 0.0, PERIOD_S * k + early_s)
    assert link.share == 1.0


def test_arbitrary_stamps_keep_it_bounded() -> None:
    rng, link = random.Random(3), LinkShare(PERIOD_S, STALE_S)
    for k in range(5000):
        link.record(rng.choice([rng.uniform(-1e9, 1e9), PERIOD_S * k]), rng.uniform(0.0, 1.0), PERIOD_S * k)
        assert 0.0 <= link.share <= 1.0
        assert link._arrived <= ALL
        assert STALE_S <= link.stale_s <= SILENCE_MAX_S

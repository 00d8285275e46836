"""Orders of the operator's key in a black box: each is checked again, by the public key, and needs no other."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from companion.journal.channels import Channel
from companion.journal.reading import Flight, find_flights
from companion.journal.recorder import files_of
from companion.journal.replay import Replayed, replay_flight
from companion.journal.segments import DirectWriter
from companion.keys.crypto import public_key
from companion.mavlink.orders.book import OrderBook
from companion.mavlink.orders.order import OrderKind
from tests.unit.journal.journal_kit import MISSION, START, Messages, forge, recorder_of, sealed_anew
from tests.unit.mavlink.endpoint_kit import FLOWING, HOME, ME, TICK_S, heartbeat, packed, position
from tests.unit.mavlink.orders_kit import DIGEST, OPERATOR_SEED, VEHICLE_SEED, Disk, frame, order
from tests.unit.mavlink.signing_kit import guard

BOOT = 4711
SIZE = MISSION.swarm.size
STARTED = order(OrderKind.START, 10, boots={ME: BOOT}, size=SIZE)


def book_of(disk: Disk) -> OrderBook:
    return OrderBook(
        operator=public_key(OPERATOR_SEED), digest=DIGEST, me=ME, size=SIZE, boot=BOOT, marks=disk, kept=disk.kept
    )


def ordered(folder: Path, disk: Disk, *, airborne: bool = False) -> Flight:
    """By tick: START at 5, a forged one at 10, HOLD at 15, an older START at 20, ABORT at 25 onto a full disk."""
    recorder, _ = recorder_of(
        DirectWriter(files_of(folder, START, waits_for_disk=False)), guard=guard(ME), orders=book_of(disk)
    )
    came = {
        5: STARTED,
        10: order(OrderKind.ABORT, 11, seed=VEHICLE_SEED, size=SIZE),
        15: order(OrderKind.HOLD, 12, boots={ME: BOOT}, size=SIZE),
        20: order(OrderKind.START, 9, boots={ME: BOOT}, size=SIZE),
        25: order(OrderKind.ABORT, 13, boots={ME: BOOT}, size=SIZE),
    }
    landed = FLOWING[1] if not airborne else type(FLOWING[1])(0, 2)
    for k in range(40):
        now_s = 10.0 + k * TICK_S
        if k % 20 == 0:
            recorder.from_autopilot(packed(HOME, heartbeat(), *FLOWING[:1], landed, *FLOWING[2:]), now_s)
        recorder.from_autopilot(packed(position(1.0, boot_ms=1000 + 50 * k)), now_s)
        if k in came:
            recorder.from_peers(frame(came[k]), now_s)
        disk.is_full = k >= 24
        recorder.tick(now_s)
    recorder.close("ended")
    (flight,) = find_flights(folder)
    return flight


def said_in(replayed: Flight) -> list[str]:
    found: list[str] = []
    replay_flight(replayed, show=lambda body, _since_s: found.extend(say["text"] for say in body["said"]))
    return found


def test_orders_are_obeyed_and_refused_again(tmp_path: Path) -> None:
    flight = ordered(tmp_path, Disk())
    replayed = replay_flight(flight)
    assert (replayed.difference, replayed.same, replayed.is_same) == ([], 40, True)
    said = said_in(flight)
    for text in ("order obeyed: START", "order obeyed: HOLD", "order obeyed: ABORT"):
        assert text in said
    assert "order refused: not of the operator's key" in said
    assert "order obeyed, but not written to the disk" in said
    assert replayed.summary.refused == {"order forged": 1, "order replayed": 1}


def test_what_was_seen_before_is_in_the_log_too(tmp_path: Path) -> None:
    """A companion that is started again in the air goes by what it had obeyed."""
    disk = Disk()
    ordered(tmp_path / "first", disk)
    assert disk.kept
    flight = ordered(tmp_path / "second", disk, airborne=True)
    replayed = replay_flight(flight)
    assert (replayed.difference, replayed.is_same) == ([], True)
    assert said_in(flight)[:3].count("order obeyed: HOLD") == 1  # the ABORT did not get to the disk


def change_start(change: Callable[[dict[str, Any]], None]) -> Callable[[Messages], Messages]:
    def changed(messages: Messages) -> Messages:
        body = json.loads(messages[0].data)
        assert messages[0].channel_id == Channel.START
        change(body)
        return sealed_anew([replace(messages[0], data=json.dumps(body).encode()), *messages[1:]])

    return changed


def changed_replay(flight: Flight, change: Callable[[dict[str, Any]], None]) -> Replayed:
    assert replay_flight(flight).is_same
    forge(flight.segments[1], change_start(change))
    return replay_flight(flight)


def test_an_order_counts_by_its_key_in_a_replay_too(tmp_path: Path) -> None:
    """With another operator's public key it is not obeyed: the decision is made again, not taken from the log."""

    def change(body: dict[str, Any]) -> None:
        body["orders"]["operator"] = public_key(VEHICLE_SEED).hex()

    replayed = changed_replay(ordered(tmp_path, Disk()), change)
    assert not replayed.breaks
    assert replayed.difference[0].startswith("tick 6, 0.250 s")


@pytest.mark.parametrize("orders", [{"operator": "no hex"}, {"operator": "00"}, {}, 7])
def test_a_book_that_cannot_be_opened_again_is_said(orders: Any, tmp_path: Path) -> None:
    replayed = changed_replay(ordered(tmp_path, Disk()), lambda body: body.update(orders=orders))
    assert replayed.stopped.startswith("its first entry makes no sense")


def test_the_disks_word_is_that_of_then(tmp_path: Path) -> None:
    flight = ordered(tmp_path, Disk())

    def take_out(messages: Messages) -> Messages:
        """The answers of the tick in which START came: the MAC of its frame, and the disk's."""
        at = [k for k, m in enumerate(messages) if m.channel_id == Channel.TICK][4]
        late = next(k for k in range(at, len(messages)) if messages[k].channel_id == Channel.VERDICTS)
        m = messages[late]
        return sealed_anew([*messages[:late], replace(m, data=m.data.replace(b"\1", b"\0")), *messages[late + 1 :]])

    assert replay_flight(flight).is_same
    forge(flight.segments[1], take_out)
    assert replay_flight(flight).difference[0].startswith("tick 6, 0.250 s")

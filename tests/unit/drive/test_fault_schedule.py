"""Simulated faults: how they are written, and when they strike."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.core.model.states import SwarmPhase
from companion.records.record import BASE_ID
from mission.schema.fault_kinds import FORMS, PARAMETERS, Lasts
from mission.schema.faults import Fault, FaultKind, FaultPhase, Lie
from sim_bridge.drive.faults import Faults, immune_of, parsed, spelled
from sim_bridge.drive.links.inbox import UNREAD_MAX_BYTES, Inbox
from sim_bridge.judge.fault_events import FaultEvent, silenced
from tests.unit.judge.metrics_kit import a_mission

ALL = (1, 2, 3, 4)


def fault(kind: str, **values: Any) -> Fault:
    return Fault.model_validate({"kind": kind, "at_s": 0.0, **values})


# --- as options -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "text", "wanted"),
    [
        ("kill", "leader@40", {"at_s": 40.0}),
        ("kill", "3@12.5", {"vehicles": (3,), "at_s": 12.5}),
        ("kill", "leader@transit", {"phase": "transit", "at_s": 0.0}),
        ("kill", "1,2@coverage+5", {"vehicles": (1, 2), "phase": "coverage", "at_s": 5.0}),
        ("stop", "2@30:3", {"vehicles": (2,), "at_s": 30.0, "for_s": 3.0}),
        ("partition", "1,2,3@60:100", {"vehicles": (1, 2, 3), "at_s": 60.0, "for_s": 100.0}),
        ("base-lost", "1,2@transit:60", {"vehicles": (1, 2), "phase": "transit", "at_s": 0.0, "for_s": 60.0}),
        ("wind", "1,2@40:4:-3", {"vehicles": (1, 2), "at_s": 40.0, "wind_mps": (4.0, -3.0)}),
        ("wind", "leader@transit:0:6.5:20", {"phase": "transit", "at_s": 0.0, "wind_mps": (0.0, 6.5), "for_s": 20.0}),
        ("blind", "2@40", {"vehicles": (2,), "at_s": 40.0}),
        ("blind", "leader@transit+5:1.5", {"phase": "transit", "at_s": 5.0, "for_s": 1.5}),
        ("late", "2@40:1.5", {"vehicles": (2,), "at_s": 40.0, "late_s": 1.5}),
        ("gnss-outage", "2@40:20", {"vehicles": (2,), "at_s": 40.0, "for_s": 20.0}),
        ("gnss-drift", "2@40:0.3:-1", {"vehicles": (2,), "at_s": 40.0, "drift_mps": (0.3, -1.0)}),
        ("position-jump", "2@40:6:-1", {"vehicles": (2,), "at_s": 40.0, "jump_m": (6.0, -1.0)}),
        ("position-freeze", "2@40:5", {"vehicles": (2,), "at_s": 40.0, "for_s": 5.0}),
        ("position-drift", "2@40:0.3:0", {"vehicles": (2,), "at_s": 40.0, "drift_mps": (0.3, 0.0)}),
        ("height-error", "2@40:10", {"vehicles": (2,), "at_s": 40.0, "height_m": 10.0}),
        ("motor", "leader@transit+5", {"phase": "transit", "at_s": 5.0}),
        (
            "scan-errors",
            "2@40:0.5:0.2:9",
            {"vehicles": (2,), "at_s": 40.0, "noise_m": 0.5, "delay_s": 0.2, "for_s": 9.0},
        ),
        ("range-errors", "2@40:-1:0.5", {"vehicles": (2,), "at_s": 40.0, "bias_m": -1.0, "noise_m": 0.5}),
        ("disk-full", "2@40:1.5", {"vehicles": (2,), "at_s": 40.0, "for_s": 1.5}),
        ("insider", "2@transit:push", {"vehicles": (2,), "phase": "transit", "at_s": 0.0, "lie": "push"}),
        ("insider", "leader@40:usurper:20", {"at_s": 40.0, "lie": "usurper", "for_s": 20.0}),
        (
            "late",
            "2@gather+1.5:1.5:20",
            {"vehicles": (2,), "phase": "gather", "at_s": 1.5, "late_s": 1.5, "for_s": 20.0},
        ),
    ],
)
def test_an_option_is_a_fault(kind: str, text: str, wanted: dict[str, Any]) -> None:
    found = Fault.model_validate(parsed(FaultKind(kind), text))
    assert found == fault(kind, **wanted)
    assert spelled(found) == f"{kind} {text}"


@given(
    st.sampled_from(list(FaultKind)),
    st.none() | st.lists(st.integers(1, 250), min_size=1, max_size=5, unique=True),
    st.none() | st.sampled_from(list(FaultPhase)),
    st.integers(0, 10**8),
    st.integers(1, 10**8),
    st.booleans(),
)
def test_what_is_spelled_is_read_back(
    kind: FaultKind, vehicles: list[int] | None, phase: FaultPhase | None, at_ms: int, for_ms: int, lasts: bool
) -> None:
    form = FORMS[kind]
    lasts = form.lasts is Lasts.ALWAYS or (form.lasts is Lasts.OPTIONAL and lasts)

    def numbers(name: str) -> Any:
        row = PARAMETERS[name]
        span_ms = round(1000 * row.most)
        return (
            ((for_ms % (span_ms + 1)) / 1e3, -(at_ms % (span_ms + 1)) / 1e3)
            if row.level
            else (for_ms % span_ms + 1) / 1e3
        )

    written = fault(
        kind.value,
        vehicles=vehicles,
        phase=phase,
        at_s=at_ms / 1e3,
        for_s=for_ms / 1e3 if lasts else None,
        **{name: numbers(name) for name in form.parameters},
        **({"lie": list(Lie)[at_ms % len(Lie)]} if form.lies else {}),
    )
    _, _, text = spelled(written).partition(" ")
    assert Fault.model_validate(parsed(kind, text)) == written


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        *[("kill", text) for text in ("", "@", "3", "3@", "@3", "x@3", "1,,2@3", "3@x", "3@nan", "3@1e3", "3@4:5")],
        *[("kill", text) for text in ("3@hover", "3@transit+", "3@+5", "3@transit+x", "\u0663@3", "leader,1@3")],
        *[("stop", text) for text in ("2@30", "2@30:", "2@30:x", "2@30:3:4")],
        *[("restart", text) for text in ("2@30", "2@30:", "2@30:3:4")],
        *[("late", text) for text in ("2@30", "2@30:1:2:3")],
        *[("insider", text) for text in ("2@30", "2@30:5", "2@30:gossip", "2@30:push:1:2")],
        ("kill", "3@4:push"),
        *[("blind", text) for text in ("2@30:", "2@30:1:2")],
        *[("wind", text) for text in ("2@30", "2@30:1", "2@30:1:2:3:4")],
        *[("motor", text) for text in ("2@30:1", "2@30:")],
        *[("scan-errors", text) for text in ("2@30", "2@30:1", "2@30:1:2:3:4")],
    ],
)
def test_what_cannot_be_read_is_told_what_it_must_look_like(kind: str, text: str) -> None:
    with pytest.raises(ValueError, match=r"^must be VEHICLES@WHEN.*, as .*@.*\. VEHICLES: leader .* WHEN: seconds"):
        parsed(FaultKind(kind), text)


def test_what_a_lie_and_a_number_may_be_is_told() -> None:
    with pytest.raises(ValueError, match=r"LIE: push, offset, .*orders, trunks\. Numbers: .*no exponent"):
        parsed(FaultKind.INSIDER, "2@30:gossip")
    with pytest.raises(ValueError, match="no exponent") as caught:
        parsed(FaultKind.GNSS_DRIFT, "2@40:1e9:0")
    assert "LIE" not in str(caught.value)


# --- when they strike -------------------------------------------------------------------------------------------------


def advanced(
    of: Faults,
    now_s: float,
    *,
    alive: Sequence[int] = ALL,
    phase: SwarmPhase = SwarmPhase.ASSEMBLE,
    leader: int | None = 1,
) -> tuple[list[str], list[str]]:
    began, ended = of.advance(now_s, alive=alive, phase=phase, leader=leader)
    return [event.begins() for event in began], [event.ends() for event in ended]


def test_a_fault_strikes_once_at_its_time() -> None:
    some = Faults([fault("kill", vehicles=[3], at_s=12.5)])
    assert advanced(some, 12.45) == ([], [])
    assert advanced(some, 12.5) == (["fault: vehicle 3 killed"], [])
    assert advanced(some, 12.55) == ([], [])
    assert some.happened == [FaultEvent(FaultKind.KILL, (3,), 12.5, asked="kill 3@12.5")]


def test_the_leader_is_who_acts_then_or_the_first_to_act_after() -> None:
    some = Faults([fault("kill", at_s=40.0)])
    assert advanced(some, 40.0, leader=None) == ([], [])
    assert advanced(some, 41.0, leader=2) == (["fault: leader 2 killed"], [])
    assert some.happened[0].vehicles == (2,)


def test_two_leaders_killed_at_once_are_two_leaders() -> None:
    some = Faults([fault("kill", at_s=40.0)] * 2)
    assert advanced(some, 40.0, leader=1) == (["fault: leader 1 killed"], [])
    # Its last beacon may still be what is known.
    assert advanced(some, 40.05, leader=1, alive=(2, 3, 4)) == ([], [])
    assert advanced(some, 42.0, leader=3, alive=(2, 3, 4)) == (["fault: leader 3 killed"], [])


def test_a_phase_counts_from_when_it_begins_and_may_be_over_by_then() -> None:
    some = Faults([fault("kill", vehicles=[2], phase="transit", at_s=5.0), fault("kill", vehicles=[3], phase="gather")])
    assert advanced(some, 10.0) == ([], [])
    assert advanced(some, 20.0, phase=SwarmPhase.GATHER) == (["fault: vehicle 3 killed"], [])
    assert advanced(some, 30.0, phase=SwarmPhase.TRANSIT) == ([], [])
    assert advanced(some, 34.95, phase=SwarmPhase.COVERAGE) == ([], [])
    assert advanced(some, 35.0, phase=SwarmPhase.COVERAGE) == (["fault: vehicle 2 killed"], [])


def test_a_stop_lasts_its_time() -> None:
    some = Faults([fault("stop", vehicles=[2], at_s=30.0, for_s=3.0)])
    assert some.stopped == frozenset()
    assert advanced(some, 30.0) == (["fault: vehicle 2 stopped for 3 s"], [])
    assert some.stopped == {2}
    assert advanced(some, 32.95) == ([], [])
    assert some.stopped == {2}
    assert advanced(some, 33.0) == ([], ["fault over: vehicle 2 resumes"])
    assert some.stopped == frozenset()


def test_one_that_is_killed_while_it_stands_still_does_not_go_on() -> None:
    some = Faults([fault("stop", vehicles=[2], at_s=30.0, for_s=3.0), fault("kill", vehicles=[2], at_s=31.0)])
    advanced(some, 30.0)
    advanced(some, 31.0)
    assert advanced(some, 33.0, alive=(1, 3, 4)) == ([], [])


def test_partitions_and_delays_overlap() -> None:
    some = Faults(
        [
            fault("partition", vehicles=[1, 2], at_s=0.0, for_s=10.0),
            fault("partition", vehicles=[2], at_s=5.0, for_s=10.0),
            fault("late", vehicles=[3], late_s=0.5),
            fault("late", vehicles=[3, 4], at_s=5.0, late_s=1.5, for_s=5.0),
        ]
    )
    advanced(some, 0.0)
    assert (some.cut_off, some.late_s) == (({1, 2},), {3: 0.5})
    advanced(some, 5.0)
    assert (some.cut_off, some.late_s) == (({1, 2}, {2}), {3: 1.5, 4: 1.5})
    advanced(some, 10.0)
    assert (some.cut_off, some.late_s) == (({2},), {3: 0.5})


def test_links_to_the_base_station_are_cut_both_ways_for_those_that_lost_it() -> None:
    lost = {"vehicles": [1, 3], "at_s": 5.0, "for_s": 10.0}
    some = Faults([fault("base-lost", **lost), fault("base-lost", **lost | {"vehicles": [3], "for_s": 20.0})])
    advanced(some, 0.0)
    assert some.cut_links == set()
    advanced(some, 5.0)
    assert some.cut_links == {(1, BASE_ID), (BASE_ID, 1), (3, BASE_ID), (BASE_ID, 3)}
    assert some.cut_off == ()
    advanced(some, 15.0)
    assert some.cut_links == {(3, BASE_ID), (BASE_ID, 3)}


def test_what_never_happened_is_known() -> None:
    late = fault("kill", vehicles=[1], at_s=99.0)
    nobody = fault("kill", vehicles=[4], at_s=1.0)
    some = Faults([late, nobody, fault("kill", vehicles=[1], at_s=1.0)])
    advanced(some, 1.0, alive=(1, 2, 3))
    assert some.never() == [nobody, late]


def test_all_is_lifted_for_good() -> None:
    some = Faults([fault("stop", vehicles=[2], for_s=50.0), fault("kill", vehicles=[1], at_s=9.0)])
    advanced(some, 0.0)
    assert [event.vehicles for event in some.lift()] == [(2,)]
    assert some.stopped == frozenset()
    assert advanced(some, 10.0) == ([], [])
    assert [spelled(never) for never in some.never()] == ["kill 1@9"]


def test_one_that_is_started_again_is_not_there_meanwhile_and_is_named_when_it_is() -> None:
    some = Faults([fault("restart", vehicles=[2], at_s=3.0, for_s=2.0), fault("kill", vehicles=[2], at_s=4.0)])
    assert advanced(some, 3.0) == (["fault: vehicle 2 killed, started again after 2 s"], [])
    assert advanced(some, 4.0, alive=(1, 3, 4)) == ([], [])
    assert silenced(some.happened, 4.0) == {2}
    assert advanced(some, 5.0, alive=(1, 3, 4)) == ([], ["fault over: vehicle 2 started again"])
    assert silenced(some.happened, 5.0) == frozenset()


def test_those_killed_or_standing_still_at_the_end_are_silenced_on_purpose() -> None:
    some = Faults([fault("kill", vehicles=[1], at_s=1.0), fault("stop", vehicles=[2], at_s=1.0, for_s=3.0)])
    assert silenced(some.happened, 1.0) == frozenset()
    advanced(some, 1.0)
    assert silenced(some.happened, 2.0) == {1, 2}
    some.lift()
    assert silenced(some.happened, 2.0) == {1, 2}
    assert silenced(some.happened, 4.0) == {1}


# --- what is on its way -----------------------------------------------------------------------------------------------


def test_telemetry_is_late_in_order_and_beacons_and_scans_are_not() -> None:
    inbox = Inbox()
    got = []
    for tick in range(8):
        late_s = 0.2 if 2 <= tick < 5 else 0.0
        inbox.put(b"%d" % tick, b"%d" % tick, b"s%d" % tick, 0.1 * tick, late_s)
        got.append(inbox.drain_links())
    assert [beacons for beacons, _, _ in got] == [b"%d" % tick for tick in range(8)]
    assert [scans for _, _, scans in got] == [b"s%d" % tick for tick in range(8)]
    assert [telemetry for _, telemetry, _ in got] == [b"0", b"1", b"", b"", b"2", b"3", b"456", b"7"]


def test_what_is_not_read_waits_in_order() -> None:
    inbox = Inbox()
    for tick in range(3):
        inbox.put(b"b%d" % tick, b"t%d" % tick, b"s%d" % tick, 0.1 * tick, 0.0)
    assert inbox.drain_links() == (b"b0b1b2", b"t0t1t2", b"s0s1s2")
    assert inbox.drain_links() == (b"", b"", b"")


def test_what_waits_is_bounded_and_the_newest_are_lost() -> None:
    inbox = Inbox()
    sent = [b"%03d" % (tick % 1000) * 100 for tick in range(2 * UNREAD_MAX_BYTES // 300)]
    for tick, data in enumerate(sent):
        inbox.put(data, data, data, 0.05 * tick, 0.0)
    most = b"".join(sent[: UNREAD_MAX_BYTES // 300])
    assert inbox.drain_links() == (most, most, most)


def test_all_that_can_be_late_has_room_on_its_way() -> None:
    inbox = Inbox()
    late_max_s = PARAMETERS["late_s"].most
    ticks = round(late_max_s * 20)
    for tick in range(ticks + 1):
        inbox.put(b"", b"%d," % tick, b"", 0.05 * tick, late_max_s)
    assert inbox.drain_links() == (b"", b"0,", b"")


def test_blind_vehicles_are_those_of_the_faults_in_force() -> None:
    some = Faults([fault("blind", vehicles=[2], at_s=1.0, for_s=2.0), fault("blind", vehicles=[3], at_s=2.0)])
    assert (advanced(some, 0.5), some.blind) == (([], []), frozenset())
    assert (advanced(some, 1.0), some.blind) == ((["fault: vehicle 2 blind for 2 s"], []), frozenset({2}))
    assert (advanced(some, 2.0), some.blind) == ((["fault: vehicle 3 blind"], []), frozenset({2, 3}))
    assert (advanced(some, 3.0), some.blind) == (([], ["fault over: vehicle 2 sees again"]), frozenset({3}))


def test_wind_blows_about_the_vehicles_named_whether_their_companions_live_or_not_and_the_last_wins() -> None:
    some = Faults(
        [
            fault("wind", vehicles=[1, 2], at_s=1.0, wind_mps=[3.0, 0.0]),
            fault("wind", vehicles=[2], at_s=2.0, wind_mps=[0.0, -6.0], for_s=5.0),
        ]
    )
    advanced(some, 0.5)
    assert some.in_force(FaultKind.WIND) == {}
    assert advanced(some, 1.0, alive=[1, 3]) == (["fault: wind about vehicles 1, 2: 3 m/s east, 0 m/s north"], [])
    assert some.in_force(FaultKind.WIND) == {1: (3.0, 0.0), 2: (3.0, 0.0)}
    advanced(some, 2.0, alive=[1, 3])
    assert some.in_force(FaultKind.WIND) == {1: (3.0, 0.0), 2: (0.0, -6.0)}
    assert advanced(some, 7.0, alive=[1, 3]) == ([], ["fault over: the wind about vehicle 2 is as before"])
    assert some.in_force(FaultKind.WIND) == {1: (3.0, 0.0), 2: (3.0, 0.0)}


def test_faults_of_satellites_strike_nobody_without_them() -> None:
    immune = {FaultKind.GNSS_OUTAGE: frozenset({2, 3, 4})}
    some = Faults([fault("gnss-outage", at_s=1.0), fault("gnss-outage", at_s=2.0)], immune)
    assert advanced(some, 1.0, leader=1) == (["fault: no satellites at leader 1"], [])
    assert advanced(some, 2.0, leader=3) == ([], [])
    assert len(some.never()) == 1


def test_wind_strikes_nobody_in_still_air() -> None:
    still = Faults(
        [fault("wind", vehicles=[1, 2], at_s=1.0, wind_mps=(3.0, 0.0))], immune_of(a_mission(), still_air=True)
    )
    assert advanced(still, 1.0) == ([], [])
    assert (still.happened, len(still.never())) == ([], 1)
    with pytest.raises(ValueError, match="wind 1,2@0:3:0: can strike none of these"):
        still.add(fault("wind", vehicles=[1, 2], wind_mps=(3.0, 0.0)))


def test_a_failed_motor_needs_no_companion_and_never_ends() -> None:
    some = Faults([fault("motor", vehicles=[2], at_s=1.0)])
    assert advanced(some, 1.0, alive=[1, 3]) == (["fault: a motor of vehicle 2 failed"], [])
    assert advanced(some, 500.0) == ([], [])
    assert some.in_force(FaultKind.MOTOR) == {2: ()}


@pytest.mark.parametrize("kind", FaultKind)
def test_each_kind_is_said_when_it_begins_and_when_it_is_over(kind: FaultKind) -> None:
    form = FORMS[kind]
    numbers = {name: (1.0, -1.0) if PARAMETERS[name].level else 0.5 for name in form.parameters}
    for_s = None if form.lasts is Lasts.NEVER else 3.0
    lie = {"lie": "push"} if form.lies else {}
    some = Faults([fault(kind.value, vehicles=[2], for_s=for_s, **numbers, **lie)])
    began, _ = advanced(some, 0.0)
    _, ended = advanced(some, 3.0)
    assert began[0].startswith("fault: ")
    assert "vehicle 2" in began[0]
    assert [text.startswith("fault over: ") for text in ended] == ([] if for_s is None else [True])

"""Fences: their geometry, their upload and download, and what each personality does at their edge."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import pytest

from companion.mavlink import dialect as mav
from mission.common.frames import LocalFrame, Wgs84
from mission.document.model import Personality
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.autopilot import Failsafe, Link, make_autopilot
from sim_bridge.world.autopilot.fence import Circle, Fence, FenceError, Polygon, fence_of

ORIGIN = Wgs84(47.3977, 8.5456, 488.0)
FRAME = LocalFrame(ORIGIN)
STEP_S = 0.05
FENCE, MISSION, ALL = 1, 0, 255
IN_POLYGON, OUT_POLYGON, IN_CIRCLE, OUT_CIRCLE = 5001, 5002, 5003, 5004
ACCEPTED, UNSUPPORTED, NO_SPACE, INVALID, INVALID_SEQUENCE, CANCELLED = 0, 3, 4, 5, 13, 15
SQUARE = ((-20.0, -20.0), (-20.0, 20.0), (20.0, 20.0), (20.0, -20.0))
personalities = pytest.mark.parametrize("personality", list(Personality))


def item(seq: int, command: int, point: tuple[float, float], param1: float, frame: int = 5) -> Any:
    at = FRAME.to_wgs84((*point, 0.0))
    return mav.MAVLink_mission_item_int_message(
        1, 1, seq, frame, command, 0, 1, param1, 0, 0, 0, round(at.lat_deg * 1e7), round(at.lon_deg * 1e7), 0, FENCE
    )


def polygon(points: Sequence[tuple[float, float]], command: int = IN_POLYGON) -> list[Any]:
    return [item(seq, command, point, len(points)) for seq, point in enumerate(points)]


class Client:
    """A ground station that speaks the mission protocol to one autopilot."""

    def __init__(self, personality: Personality, **parameters: float) -> None:
        self.body = PointMass((0.0, 0.0, 0.0), 0.0)
        self.autopilot = make_autopilot(personality, 1, self.body, FRAME, parameters=parameters)
        self.codec = mav.MAVLink(None, srcSystem=245, srcComponent=190)
        self.reader = mav.MAVLink(None)
        self.now_s = 0.0

    def ask(self, message: Any) -> list[Any]:
        """The answers, by MISSION_ messages."""
        self.autopilot.receive(Link.GROUND, message.pack(self.codec), self.now_s)
        return self.hear()

    def hear(self) -> list[Any]:
        data = b"".join(self.autopilot.transmit(Link.GROUND, self.now_s))
        return [m for m in self.reader.parse_buffer(data) or [] if m.get_type().startswith("MISSION_")]

    def upload(self, items: Sequence[Any]) -> int:
        """The result."""
        (answer,) = self.ask(mav.MAVLink_mission_count_message(1, 1, len(items), FENCE))
        for each in items:
            assert (answer.get_type(), answer.seq, answer.mission_type) == ("MISSION_REQUEST_INT", each.seq, FENCE)
            assert (answer.target_system, answer.target_component) == (245, 190)
            (answer,) = self.ask(each)
        assert (answer.get_type(), answer.mission_type) == ("MISSION_ACK", FENCE)
        return int(answer.type)

    def download(self) -> list[Any]:
        (count,) = self.ask(mav.MAVLink_mission_request_list_message(1, 1, FENCE))
        assert count.mission_type == FENCE
        return [self.ask(mav.MAVLink_mission_request_int_message(1, 1, k, FENCE))[0] for k in range(count.count)]

    def command(self, number: int, *params: float) -> None:
        padded = [*params, *[0.0] * (7 - len(params))]
        self.ask(mav.MAVLink_command_long_message(1, 1, number, 0, *padded))

    def fly(self, seconds: float, velocity: tuple[float, float, float] | None = None) -> None:
        for _ in range(round(seconds / STEP_S)):
            if velocity is not None:
                self.ask(
                    mav.MAVLink_set_position_target_local_ned_message(
                        0, 1, 1, 1, 0x5C7, 0, 0, 0, *velocity, 0, 0, 0, 0, 0
                    )
                )
            self.autopilot.update(self.now_s)
            self.body.step(STEP_S)
            self.now_s += STEP_S

    def airborne(self) -> None:
        """Steered, at about 5 m."""
        px4 = "COM_OF_LOSS_T" in self.autopilot.parameters
        self.fly(5.0 if px4 else 42.0)
        if not px4:
            self.command(176, 1.0, 4.0)
        self.command(400, 1.0)
        self.command(22, *[math.nan] * 6, ORIGIN.alt_m + 5.0) if px4 else self.command(22, *[0.0] * 6, 5.0)
        if px4:
            self.command(400, 1.0)
        self.fly(13.0)
        self.fly(0.5, (0.0, 0.0, 0.0))
        if px4:
            self.command(176, 1.0, 6.0)
        self.fly(0.5, (0.0, 0.0, 0.0))


# Geometry


@pytest.mark.parametrize(
    ("point", "inside"),
    [((0.0, 0.0), True), ((19.9, -19.9), True), ((20.1, 0.0), False), ((0.0, 30.0), False), ((-50.0, -50.0), False)],
)
def test_a_polygon_holds_what_is_inside(point: tuple[float, float], inside: bool) -> None:
    assert Polygon(SQUARE).holds(point) is inside
    assert Polygon(SQUARE[::-1]).holds(point) is inside


def test_a_polygon_with_a_notch() -> None:
    notched = Polygon(((0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (10.0, 10.0), (0.0, 20.0)))
    assert notched.holds((5.0, 5.0))
    assert not notched.holds((10.0, 15.0))


def test_inclusions_and_exclusions() -> None:
    west, east = Circle((0.0, -10.0), 12.0), Circle((0.0, 10.0), 12.0)
    fence = Fence((west, east), (Circle((0.0, 15.0), 2.0),))
    assert not fence.breached((0.0, 0.0, -5.0), within_all=True)
    assert fence.breached((0.0, -10.0, -5.0), within_all=True)
    assert not fence.breached((0.0, -10.0, -5.0), within_all=False)
    assert fence.breached((0.0, 15.0, -5.0), within_all=False)
    assert not Fence().breached((1e6, 0.0, 0.0), within_all=True)


@pytest.mark.parametrize(
    "items",
    [
        polygon(SQUARE[:2]),
        polygon(SQUARE)[:3],
        [*polygon(SQUARE)[:3], item(3, OUT_POLYGON, SQUARE[3], 4.0)],
        [item(0, IN_CIRCLE, (0.0, 0.0), 0.0)],
        [item(0, IN_CIRCLE, (0.0, 0.0), math.nan)],
        [item(0, IN_POLYGON, (0.0, 0.0), math.nan)],
        [item(0, 16, (0.0, 0.0), 0.0)],
        [item(0, IN_CIRCLE, (0.0, 0.0), 5.0, frame=2)],
        [mav.MAVLink_mission_item_int_message(1, 1, 0, 5, IN_CIRCLE, 0, 1, 5.0, 0, 0, 0, 2**31 - 1, 0, 0, FENCE)],
    ],
)
def test_items_that_make_no_fence(items: list[Any]) -> None:
    with pytest.raises(FenceError, match="item 0"):
        fence_of(items, FRAME)


# The protocol


@personalities
def test_a_fence_comes_back_exactly_as_it_was_uploaded(personality: Personality) -> None:
    client = Client(personality)
    items = [*polygon(SQUARE), item(4, OUT_CIRCLE, (5.0, 5.0), 2.5), item(5, 5000, (0.0, 0.0), 0.0)]
    assert client.upload(items) == ACCEPTED
    back = client.download()
    names = [name for name in mav.MAVLink_mission_item_int_message.fieldnames if not name.startswith("target")]
    assert [[getattr(m, n) for n in names] for m in back] == [[getattr(m, n) for n in names] for m in items]
    older = client.ask(mav.MAVLink_mission_request_message(1, 1, 4, FENCE))
    assert [m.get_type() for m in older] == ["MISSION_ITEM_INT"]


@personalities
@pytest.mark.parametrize("how", ["clear", "clear all", "none"])
def test_a_fence_is_cleared(personality: Personality, how: str) -> None:
    client = Client(personality)
    client.upload(polygon(SQUARE))
    kind = ALL if how == "clear all" else FENCE
    message = (
        mav.MAVLink_mission_count_message(1, 1, 0, FENCE)
        if how == "none"
        else mav.MAVLink_mission_clear_all_message(1, 1, kind)
    )
    (ack,) = client.ask(message)
    assert (ack.get_type(), ack.type, ack.mission_type) == ("MISSION_ACK", ACCEPTED, kind)
    assert client.download() == []


@personalities
def test_a_bad_fence_is_refused_and_the_old_one_kept(personality: Personality) -> None:
    client = Client(personality)
    client.upload(polygon(SQUARE))
    assert client.upload(polygon(SQUARE[:2])) == INVALID
    assert len(client.download()) == 4


@personalities
def test_missions_are_not_flown_and_plans_have_a_bound(personality: Personality) -> None:
    client = Client(personality)
    (ack,) = client.ask(mav.MAVLink_mission_count_message(1, 1, 3, MISSION))
    assert ack.type == UNSUPPORTED
    (ack,) = client.ask(mav.MAVLink_mission_count_message(1, 1, 5000, FENCE))
    assert ack.type == NO_SPACE
    (ack,) = client.ask(mav.MAVLink_mission_request_int_message(1, 1, 7, FENCE))
    assert ack.type == INVALID_SEQUENCE
    (count,) = client.ask(mav.MAVLink_mission_request_list_message(1, 1, MISSION))
    assert (count.count, count.mission_type) == (0, MISSION)


def test_a_lost_item_is_asked_for_again_and_then_given_up() -> None:
    client = Client(Personality.PX4)
    client.ask(mav.MAVLink_mission_count_message(1, 1, 4, FENCE))
    client.ask(polygon(SQUARE)[0])
    heard = []
    for _ in range(200):
        client.now_s += 0.1
        heard += client.hear()
    *asked, ack = heard
    assert [(m.get_type(), m.seq) for m in asked] == [("MISSION_REQUEST_INT", 1)] * 5
    assert ack.type == CANCELLED


def test_an_item_out_of_turn_is_asked_for_anew() -> None:
    client = Client(Personality.PX4)
    client.ask(mav.MAVLink_mission_count_message(1, 1, 4, FENCE))
    (again,) = client.ask(polygon(SQUARE)[2])
    assert (again.get_type(), again.seq) == ("MISSION_REQUEST_INT", 0)


# Its edge


@pytest.mark.parametrize(
    ("personality", "parameters", "mode"),
    [
        (Personality.PX4, {"GF_ACTION": 2}, "HOLD"),
        (Personality.PX4, {"GF_ACTION": 5}, "LAND"),
        (Personality.PX4, {"GF_ACTION": 0}, "OFFBOARD"),
        (Personality.ARDUPILOT, {"FENCE_ENABLE": 1, "FENCE_ACTION": 4}, "BRAKE"),
        (Personality.ARDUPILOT, {"FENCE_ENABLE": 1, "FENCE_ACTION": 2}, "LAND"),
        (Personality.ARDUPILOT, {"FENCE_ENABLE": 1, "FENCE_ACTION": 0}, "GUIDED"),
        (Personality.ARDUPILOT, {"FENCE_ENABLE": 1, "FENCE_TYPE": 3, "FENCE_ACTION": 4}, "GUIDED"),
        (Personality.ARDUPILOT, {"FENCE_ENABLE": 0, "FENCE_ACTION": 4}, "GUIDED"),
    ],
)
def test_at_the_edge_the_autopilot_does_what_its_parameter_says(
    personality: Personality, parameters: dict[str, float], mode: str
) -> None:
    client = Client(personality, **parameters)
    assert client.upload(polygon(SQUARE)) == ACCEPTED
    client.airborne()
    client.fly(5.0, (2.0, 0.0, 0.0))
    assert client.autopilot.snapshot.failsafe is None
    client.fly(8.0, (2.0, 0.0, 0.0))
    assert client.autopilot.snapshot.mode == mode
    acted = mode not in ("OFFBOARD", "GUIDED")
    assert (client.autopilot.snapshot.failsafe is Failsafe.GEOFENCE) is (acted or parameters.get("FENCE_ACTION") == 0)

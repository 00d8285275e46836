"""Records of other sensors: at their period, where the vehicle is, and what is missing is said and not recorded."""

from __future__ import annotations

import math

import pytest

from companion.mavlink.harvest import PayloadPlace
from companion.mavlink.sensor_source import PayloadValue
from companion.payload.recorder import AGAIN_S, PayloadRecorder, payload_of
from companion.payload.sample import PAYLOAD_KIND, PayloadSample, decode_sample
from tests.unit.core.core_kit import mission

ME = 2
LIGHT = "NAMED_VALUE_FLOAT.light"
WARMTH = "HYGROMETER_SENSOR.temperature"
FLOWN = mission(
    payload=[
        {"name": "light", "unit": "lx", "period_s": 2.0, "source": LIGHT},
        {"name": "warmth", "unit": "degC", "period_s": 5.0, "source": WARMTH},
    ]
)
PLACE = PayloadPlace(3.0, -4.0, 5.0, 1.0)


class Flown:
    """A recorder at 20 Hz, in the air unless said otherwise."""

    def __init__(self) -> None:
        self.recorder = PayloadRecorder(FLOWN, ME)
        self.texts: list[tuple[float, str]] = []

    def tick(
        self, now_s: float, *values: tuple[str, float], place: PayloadPlace | None = PLACE, airborne: bool = True
    ) -> list[PayloadSample]:
        told = [PayloadValue(*value) for value in values]
        found = self.recorder.take_records(told, place, now_s, airborne=airborne)
        self.texts += [(now_s, say.text) for say in self.recorder.take_says()]
        assert all(kind == PAYLOAD_KIND for kind, _ in found)
        samples = [decode_sample(body, ME) for _, body in found]
        assert None not in samples
        return [sample for sample in samples if sample is not None]


def test_a_value_is_recorded_with_its_place_and_the_error_of_that() -> None:
    assert Flown().tick(7.0, (LIGHT, 812.0)) == [PayloadSample(ME, "light", "lx", 812.0, 3.0, -4.0, 5.0, 1.0)]


def test_each_quantity_has_its_own_period() -> None:
    one = Flown()
    times = [(k * 0.5, one.tick(k * 0.5, (LIGHT, float(k)), (WARMTH, 20.0))) for k in range(41)]
    light = [(at, s.value) for at, found in times for s in found if s.name == "light"]
    assert light == [(float(2 * k), float(4 * k)) for k in range(11)]
    assert [at for at, found in times for s in found if s.name == "warmth"] == [0.0, 5.0, 10.0, 15.0, 20.0]


def test_a_sensor_slower_than_the_period_has_each_value_recorded_once() -> None:
    one = Flown()
    found = [one.tick(k * 0.05, *([(LIGHT, float(k))] if k % 50 == 0 else [])) for k in range(201)]
    assert [s.value for told in found for s in told if s.name == "light"] == [0.0, 50.0, 100.0, 150.0, 200.0]


def test_nothing_is_recorded_on_the_ground_or_said() -> None:
    one = Flown()
    assert [one.tick(float(k), (LIGHT, 1.0), airborne=False) for k in range(60)] == [[]] * 60
    assert one.texts == []


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e30])
def test_what_is_no_number_is_not_recorded_and_said_once(value: float) -> None:
    one = Flown()
    found = [one.tick(k * 0.05, (LIGHT, value), (WARMTH, 1.0)) for k in range(1, 90)]
    assert [sample.name for told in found for sample in told] == ["warmth"]
    assert [text for _, text in one.texts] == ["payload: light no number: not recorded"]


def test_what_is_not_heard_is_said_by_name_and_again_after_a_while() -> None:
    one = Flown()
    for k in range(round((AGAIN_S + 30.0) / 0.05)):
        one.tick(k * 0.05, (LIGHT, 1.0))
    said = [(round(at), text) for at, text in one.texts]
    assert said == [(15, "payload: warmth not heard: not recorded"), (75, "payload: warmth not heard: not recorded")]


def test_a_value_that_stops_coming_is_not_recorded_again() -> None:
    one = Flown()
    found = [one.tick(k * 0.05, *([(LIGHT, 5.0), (WARMTH, 9.0)] if k == 0 else [])) for k in range(400)]
    assert sum(map(len, found)) == 2
    assert [text for _, text in one.texts] == [
        "payload: light not heard: not recorded",
        "payload: warmth not heard: not recorded",
    ]


def test_without_a_position_nothing_is_recorded_and_that_is_said() -> None:
    one = Flown()
    assert one.tick(1.0, (LIGHT, 5.0), place=None) == []
    assert one.texts == [(1.0, "payload: position unknown: not recorded")]
    assert len(one.tick(1.05, (LIGHT, 5.0))) == 1


def test_words_fit_a_status_text() -> None:
    longest = mission(payload=[{"name": "a" * 16, "unit": "lx", "source": LIGHT}])
    one = Flown()
    one.recorder = PayloadRecorder(longest, ME)
    one.tick(0.0)
    one.tick(100.0)
    one.tick(200.0, (LIGHT, math.nan))
    assert len(one.texts) == 2
    assert all(len(text) <= 50 for _, text in one.texts)


def test_a_mission_without_payload_has_no_recorder() -> None:
    assert payload_of(mission(), ME) is None

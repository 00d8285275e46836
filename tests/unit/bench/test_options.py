"""Options of benches that cannot be are refused by name, before anything flies."""

from __future__ import annotations

import pytest

from tests.bench import own_motion, shared_trunks
from tests.bench.__main__ import main
from tests.bench.options import as_density

DENSITY = "argument --density: '{}': must be a number from 1 to 1500"


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        *(
            (f"{bench} --density {bad}", DENSITY.format(bad))
            for bench in ("own-motion", "trunks", "shared-trunks", "encounters", "layers")
            for bad in ("nan", "0", "5000", "many")
        ),
        ("own-motion --winding inf", "argument --winding: 'inf': must be a number from 0 to 5"),
        ("own-motion --lean-deg nan", "argument --lean-deg: 'nan': must be a number from -45 to 45"),
        ("own-motion --first-seed -1", "argument --first-seed: '-1': must be a whole number from 0 to 4294967295"),
        ("trunks --sensor foo", "argument --sensor: invalid choice: 'foo'"),
        ("trunks --estimates foo", "argument --estimates: invalid choice: 'foo'"),
        ("trunks --wind -1", "argument --wind: '-1': must be a number from 0 to 12"),
        ("shared-trunks --n 20", "argument --n: '20': must be a whole number from 1 to 12"),
        ("shared-trunks --loss 1", "argument --loss: '1': must be a number from 0 to 0.99"),
        ("shared-trunks --tries -3", "argument --tries: '-3': must be a whole number"),
        ("encounters --speed nan", "argument --speed: 'nan': must be a number from 0.1 to 10"),
        ("encounters --speed -1", "argument --speed: '-1': must be a number from 0.1 to 10"),
        ("setpoint-gaps --minutes nan", "argument --minutes: 'nan': must be a number from 0.1 to 600"),
    ],
)
def test_what_cannot_be_is_refused_by_its_name(asked: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(asked.split())
    assert ended.value.code == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("text", ["1", "1500"])
@pytest.mark.parametrize("n", [1, shared_trunks.MOST])
def test_what_is_allowed_makes_a_mission(text: str, n: int) -> None:
    for sensor in own_motion.SENSORS:
        assert own_motion.mission_of(as_density(text), sensor, 2**32 - 1).forest.stand
    for sensor in shared_trunks.SENSORS:
        flown = shared_trunks.mission_of(2**32 - 1, n, as_density(text), 0.99, sensor, shared_trunks.ALONE)
        assert flown.swarm.size == n

"""Files of returns: passes come back as they went, a torn end costs one, and a full disk is said and flown on with."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Final

import numpy as np
import pytest

from companion.cloud.returns import POINTS_MAX, StemReturns, decode_returns, encode_returns
from companion.cloud.returns_file import ReturnsFile
from companion.cloud.returns_log import WAITING_MAX, ReturnsLog
from companion.cloud.returns_reader import ReturnsFileError, read_returns
from companion.shell.records import open_returns
from tests.unit.cloud.cloud_kit import returns_at


def same(one: StemReturns, other: StemReturns) -> bool:
    keys = ("vehicle_id", "body", "first_s", "north_m", "east_m", "ground_up_m")
    return all(getattr(one, key) == getattr(other, key) for key in keys) and np.array_equal(one.points, other.points)


def written(path: Path, *passes: StemReturns) -> Path:
    assert ReturnsFile(path).write([encode_returns(one) for one in passes]) == ""
    return path


def test_passes_come_back_in_their_order_whoever_wrote_them_when(tmp_path: Path) -> None:
    passes = [returns_at(north_m=float(k), body=b"record") for k in range(5)]
    path = written(tmp_path / "a.returns", *passes[:2])
    written(path, *passes[2:])  # a companion that started again
    read, torn = read_returns(path)
    assert torn == 0
    assert len(read) == 5
    assert all(map(same, read, passes))


def test_a_torn_end_costs_one_pass_and_what_is_written_behind_it_is_whole(tmp_path: Path) -> None:
    path = written(tmp_path / "a.returns", *[returns_at(north_m=float(k)) for k in range(3)])
    whole = path.read_bytes()
    path.write_bytes(whole[:-40])
    written(path, returns_at(north_m=9.0))
    read, torn = read_returns(path)
    assert [one.north_m for one in read] == [0.0, 1.0, 9.0]
    assert torn == len(whole) // 3 - 40


@pytest.mark.parametrize("at", range(0, 400, 13))
def test_a_byte_that_has_changed_costs_no_more_than_its_pass(at: int, tmp_path: Path) -> None:
    path = written(tmp_path / "a.returns", *[returns_at(north_m=float(k)) for k in range(3)])
    data = bytearray(path.read_bytes())
    data[at % len(data)] ^= 0x55
    path.write_bytes(data)
    read, _ = read_returns(path)
    assert len(read) >= 2


def test_a_file_of_something_else_is_refused_by_name(tmp_path: Path) -> None:
    other = tmp_path / "mission.toml"
    other.write_text("schema = 1\n")
    with pytest.raises(ReturnsFileError, match=r"mission.toml: holds no returns of a survey"):
        read_returns(other)
    with pytest.raises(ReturnsFileError, match="No such file"):
        read_returns(tmp_path / "none")


def test_a_vehicle_that_measured_nothing_has_an_empty_file(tmp_path: Path) -> None:
    (tmp_path / "a.returns").write_bytes(b"")
    assert read_returns(tmp_path / "a.returns") == ([], 0)


def test_a_file_is_bounded_and_what_is_lost_is_counted(tmp_path: Path) -> None:
    file = ReturnsFile(tmp_path / "a.returns", bytes_max=700)
    one = encode_returns(returns_at())
    said = [file.write([one]) for _ in range(6)]
    kept = said.index("a.returns is full, at 0.000667572 MiB")
    assert said[:kept] == [""] * kept
    assert file.lost == 6 - kept > 0
    assert len(read_returns(tmp_path / "a.returns")[0]) == kept


def test_a_disk_that_takes_nothing_is_said_once_and_again_when_it_does(tmp_path: Path) -> None:
    folder = tmp_path / "none"
    with ExitStack() as opened:
        log, path = open_returns(folder / "records-1.db", opened, beside_loop=False)
        assert path == folder / "records-1.returns"
        one, lines = encode_returns(returns_at()), list[str]()
        for k in range(6):
            if k == 4:
                folder.mkdir()
            log.append([one])
            lines += log.take_lines()
        log.append([])
        lines += log.take_lines()
    assert lines == ["returns: No such file or directory: LOST", "returns: the disk takes them again"]
    assert len(read_returns(path)[0]) == 2


def test_a_file_of_records_of_that_name_is_left_alone(tmp_path: Path) -> None:
    with ExitStack() as opened:
        _, path = open_returns(tmp_path / "mine.returns", opened, beside_loop=False)
    assert path == tmp_path / "mine.returns.returns"


def test_what_waits_for_a_slow_disk_is_bounded() -> None:
    class Slow:
        def submit(self, piece: object) -> bool:
            return piece is None

        def take_outcome(self) -> str | None:
            return None

    log = ReturnsLog(Slow())
    for k in range(10):
        log.append([b"x"] * 100)
        assert len(log._waiting) <= min(WAITING_MAX, 100 * (k + 1))


def test_beside_the_loop_all_is_written_by_the_end(tmp_path: Path) -> None:
    one = encode_returns(returns_at())
    with ExitStack() as opened:
        log, path = open_returns(tmp_path / "records-1.db", opened, beside_loop=True)
        log.append([one, one])
    assert len(read_returns(path)[0]) == 2


def test_what_waits_at_the_end_for_a_lot_under_way_is_told_until_it_is_written() -> None:
    class Slow:
        taken: Final = list[bytes]()
        outcome: str | None = None
        is_free = True

        def submit(self, piece: Sequence[bytes]) -> bool:
            was_free, self.is_free = self.is_free, False
            self.taken.extend(piece if was_free else ())
            return was_free

        def take_outcome(self) -> str | None:
            outcome, self.outcome = self.outcome, None
            self.is_free |= outcome is not None
            return outcome

    slow = Slow()
    log = ReturnsLog(slow)
    log.append([b"a"])
    log.append([b"b"])
    assert log.finish() == 2
    slow.outcome = ""
    assert log.finish() == 1
    slow.outcome = ""
    assert log.finish() == 0
    assert slow.taken == [b"a", b"b"]


def test_more_points_than_a_pass_may_have_are_not_encoded() -> None:
    with pytest.raises(ValueError, match="must be at most 4096"):
        encode_returns(returns_at(n=POINTS_MAX + 1))
    assert decode_returns(encode_returns(returns_at(n=POINTS_MAX))) is not None

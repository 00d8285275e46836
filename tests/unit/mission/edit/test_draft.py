"""What stands in a mission's file is never lost: not by saving, not by others, not by a full disk."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from mission.common.problems import MissionError
from mission.document.load import load_mission
from mission.edit.draft import Draft, OnDisk, SaveError, open_draft
from mission.edit.toml_text import Change, ChangeError

TEXT = """\
schema = 1 # first
[route]
d1_enu_m = [0.0, 0.0, 8.0]
d2_enu_m = [130.0, 0.0, 8.0]
vel_leader_mps = 3.0
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "my.toml"
    path.write_text(TEXT)
    return path


def sized(size: int) -> list[Change]:
    return [Change(do="set", path=("swarm", "size"), value=size)]


def test_nothing_is_written_before_it_is_saved(file: Path) -> None:
    draft = open_draft(file)
    assert (draft.is_saved, draft.on_disk(), draft.text) == (True, OnDisk.SAME, TEXT)
    draft.change(sized(5))
    assert (draft.is_saved, file.read_text()) == (False, TEXT)
    draft.save()
    assert (draft.is_saved, draft.on_disk()) == (True, OnDisk.SAME)
    assert load_mission(file).swarm.size == 5
    assert file.read_text().startswith(TEXT)
    assert [entry.name for entry in file.parent.iterdir()] == ["my.toml"]


def test_undo_and_redo_go_over_all_texts(file: Path) -> None:
    draft = open_draft(file)
    for size in (3, 4, 5):
        draft.change(sized(size))
    texts = [draft.text]
    while draft.can_undo:
        draft.undo()
        texts.append(draft.text)
    assert (texts[-1], draft.is_saved) == (TEXT, True)
    for text in reversed(texts[:-1]):
        assert draft.can_redo
        draft.redo()
        assert draft.text == text
    assert not draft.can_redo
    draft.undo()
    draft.change(sized(9))
    assert not draft.can_redo


def test_each_step_has_a_revision_of_its_own(file: Path) -> None:
    draft = open_draft(file)
    seen = [draft.revision]
    for act in (lambda: draft.change(sized(3)), draft.undo, draft.redo, lambda: draft.change(sized(3))):
        act()
        seen.append(draft.revision)
    assert len(set(seen)) == len(seen)


def test_what_another_program_wrote_is_not_replaced_unasked_and_then_kept(file: Path) -> None:
    draft = open_draft(file)
    draft.change(sized(5))
    file.write_text(TEXT + "# theirs\n")
    assert draft.on_disk() is OnDisk.CHANGED
    with pytest.raises(SaveError, match="another program has changed it"):
        draft.save()
    assert file.read_text() == TEXT + "# theirs\n"
    kept = draft.save(over=True)
    assert kept is not None
    assert (kept.name, kept.read_text()) == ("my.other-1.toml", TEXT + "# theirs\n")
    assert load_mission(file).swarm.size == 5
    file.write_text(TEXT + "# again theirs\n")
    again = draft.save(over=True)
    assert again is not None
    assert again.name == "my.other-2.toml"


def test_a_file_that_has_come_meanwhile_is_not_replaced(tmp_path: Path) -> None:
    draft = Draft(tmp_path / "new.toml", TEXT, None)
    assert (draft.on_disk(), draft.is_saved) == (OnDisk.NEW, False)
    (tmp_path / "new.toml").write_text("schema = 1\n")
    with pytest.raises(SaveError):
        draft.save()
    assert (tmp_path / "new.toml").read_text() == "schema = 1\n"


def test_a_file_that_is_gone_is_written_again(file: Path) -> None:
    draft = open_draft(file)
    file.unlink()
    assert draft.on_disk() is OnDisk.GONE
    draft.save()
    assert file.read_text() == TEXT


def test_reload_takes_over_what_is_there_and_undo_brings_back_what_was(file: Path) -> None:
    draft = open_draft(file)
    draft.change(sized(5))
    mine = draft.text
    file.write_text(TEXT + "# theirs\n")
    draft.reload()
    assert (draft.text, draft.is_saved, draft.on_disk()) == (TEXT + "# theirs\n", True, OnDisk.SAME)
    draft.undo()
    assert (draft.text, draft.is_saved) == (mine, False)


@pytest.mark.parametrize("text", ["schema = ", "\udcff", "x = 1\n" * 20_000])
def test_what_cannot_be_read_is_not_taken_over(file: Path, text: str) -> None:
    draft = open_draft(file)
    file.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(MissionError):
        draft.reload()
    assert draft.text == TEXT
    assert draft.on_disk() is OnDisk.CHANGED
    with pytest.raises(MissionError):
        open_draft(file)


def test_permissions_and_links_stay(file: Path, tmp_path: Path) -> None:
    file.chmod(0o640)
    link = tmp_path / "link.toml"
    link.symlink_to(file)
    draft = open_draft(link)
    draft.change(sized(5))
    draft.save()
    assert link.is_symlink()
    assert file.stat().st_mode & 0o777 == 0o640
    assert load_mission(file).swarm.size == 5
    fresh = Draft(tmp_path / "fresh.toml", TEXT, None)
    fresh.save()
    mask = os.umask(0)
    os.umask(mask)
    assert (tmp_path / "fresh.toml").stat().st_mode & 0o777 == 0o666 & ~mask


def test_a_file_that_cannot_be_written_stays_as_it_was(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    draft = open_draft(file)
    draft.change(sized(5))

    def full(*_: object) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "write", full)
    with pytest.raises(SaveError, match="No space left"):
        draft.save()
    assert (file.read_text(), draft.is_saved) == (TEXT, False)
    assert [entry.name for entry in file.parent.iterdir()] == ["my.toml"]


def test_a_mission_that_no_file_could_hold_is_refused(file: Path) -> None:
    draft = open_draft(file)
    stops = [Change(do="insert", path=("route", "stops", 0), value={"pos_enu_m": [1.5, 2.5, 3.5]})] * 2000
    with pytest.raises(ChangeError, match="at most 64 KiB"):
        draft.change(stops)
    assert draft.text == TEXT

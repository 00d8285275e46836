"""A disk that loses power at any call: what is found there afterwards."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest


class PowerCutError(BaseException):
    """Nothing runs after it: what catches OSError does not see it."""


class Disk:
    """What a power cut leaves: of a file what was synchronised, of a folder's entries also what survives by chance.

    Real files below `root` take the calls; the call numbered `cut` does not happen any more.
    """

    CALLS = ("open", "write", "fsync", "replace", "rename", "unlink", "mkdir", "rmdir")

    def __init__(self, root: Path, cut: int) -> None:
        self.root = root
        self.cut = cut
        self.calls = 0
        self._data: dict[int, bytes] = {}  # inode -> what is written
        self._kept: dict[int, bytes] = {}  # inode -> what is synchronised
        self._held: list[int] = []  # files stay open: no inode is used again
        self._entries: dict[int, dict[str, int]] = {}  # a folder's inode -> what is synchronised
        for folder in (root, *(entry for entry in root.rglob("*") if entry.is_dir())):
            self._entries[folder.stat().st_ino] = self._live(folder)
            for entry in folder.iterdir():
                if entry.is_file():
                    self._kept[entry.stat().st_ino] = entry.read_bytes()
                    self._held.append(os.open(entry, os.O_RDONLY))
        self._usual = {name: getattr(os, name) for name in self.CALLS}

    @contextmanager
    def watched(self, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
        with monkeypatch.context() as patch:
            for name in self.CALLS:
                patch.setattr(os, name, self._call(name))
            yield

    def _call(self, name: str) -> Callable[..., object]:
        def call(*args: object, **options: object) -> object:
            if name == "open" and not args[1] & os.O_CREAT:  # type: ignore[operator]
                return self._usual[name](*args, **options)
            if self.calls == self.cut:
                raise PowerCutError
            self.calls += 1
            done = self._usual[name](*args, **options)
            if name == "open":
                inode = os.fstat(done).st_ino
                self._data[inode] = self._kept[inode] = b""
                self._held.append(os.dup(done))
            elif name == "mkdir":
                self._entries[os.stat(args[0]).st_ino] = {}  # type: ignore[arg-type]
            elif name == "write":
                self._data[os.fstat(args[0]).st_ino] += bytes(args[1])[:done]  # type: ignore
            elif name == "fsync":
                self._sync(args[0])  # type: ignore[arg-type]
            return done

        return call

    def _sync(self, fd: int) -> None:
        status = os.fstat(fd)
        if stat.S_ISDIR(status.st_mode):
            self._entries[status.st_ino] = self._live(Path(os.readlink(f"/proc/self/fd/{fd}")))
        else:
            self._kept[status.st_ino] = self._data[status.st_ino]

    @staticmethod
    def _live(folder: Path) -> dict[str, int]:
        return {entry.name: entry.lstat().st_ino for entry in folder.iterdir()}

    def close(self) -> None:
        for fd in self._held:
            os.close(fd)

    def restore(self, image: Path, survives: Callable[[str], bool]) -> None:
        """Makes `image` as the root is found after the cut. `survives`: of entries that no fsync held."""
        self._restore(self.root.stat().st_ino, self.root, image, survives)

    def _restore(self, inode: int, live: Path | None, image: Path, survives: Callable[[str], bool]) -> None:
        image.mkdir(mode=0o700)
        entries = dict(self._entries[inode])
        now = self._live(live) if live is not None else entries
        for name in entries.keys() | now.keys():
            if survives(name):
                entries.pop(name, None)
                if name in now:
                    entries[name] = now[name]
        places = {entry.stat().st_ino: entry for entry in self.root.rglob("*") if entry.is_dir()}
        for name, inner in entries.items():
            if inner in self._entries:
                self._restore(inner, places.get(inner), image / name, survives)
            else:
                (image / name).write_bytes(self._kept[inner])
                (image / name).chmod(0o600)


CHANCES = {
    "all": lambda _: True,
    "none": lambda _: False,
    "vehicles": lambda name: "vehicle" in name,
    "operator": lambda name: "operator" in name,
    "odd": lambda name: len(name) % 2 == 1,
}


def cuts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, work: Callable[[Path], object], prepare: Callable[[Path], object]
) -> Iterator[tuple[Path, bool]]:
    """What is found after a cut at each call of `work`, for each of CHANCES; last of all, False, one after its end."""
    monkeypatch.setattr(os, "fsync", lambda _: None)  # the model's do not wait for a disk
    cut = 0
    while True:
        root = tmp_path / f"live-{cut}"
        root.mkdir()
        prepare(root)
        disk = Disk(root, cut)
        is_cut = False
        with disk.watched(monkeypatch):
            try:
                work(root)
            except PowerCutError:
                is_cut = True
        for name, survives in CHANCES.items():
            image = tmp_path / f"found-{cut}-{name}"
            disk.restore(image, survives)
            yield image, is_cut
        disk.close()
        if not is_cut:
            assert disk.calls > 10
            return
        cut += 1

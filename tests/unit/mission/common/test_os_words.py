"""Errors of the system, as the programs tell them."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from mission.common.files import os_words


def test_file_is_named_and_the_reason_is_in_words(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="Errno") as missing:
        (tmp_path / "none").read_bytes()
    assert os_words(missing.value) == f"{tmp_path}/none: no such file"
    with pytest.raises(OSError, match="Errno") as folder:
        tmp_path.read_bytes()
    assert os_words(folder.value) == f"{tmp_path}: is a directory: must be a file"


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)), "No space left on device"),
        (OSError(errno.ENOSPC, "cannot be written: No space left", "a\nb"), "a\\nb: cannot be written: No space left"),
        (OSError("--listen 127.0.0.1:80: permission denied"), "--listen 127.0.0.1:80: permission denied"),
    ],
)
def test_what_was_said_in_its_place_stays(error: OSError, said: str) -> None:
    assert os_words(error) == said

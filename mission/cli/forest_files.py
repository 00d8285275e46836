"""Files that `mission forest` writes, and arguments that it refuses."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import NoReturn


def written(out: str, data: bytes) -> bool:
    """Write `data` into the file `out`; False, and why is said, where that cannot be."""
    try:
        Path(out).write_bytes(data)
    except OSError as error:
        print(f"mission: cannot write {out}: {os.strerror(error.errno or 0)}", file=sys.stderr)
        return False
    return True


def refuse(place: str, message: str) -> NoReturn:
    """Raise the MissionError of an argument."""
    from mission.common.files import refused

    raise refused(place, None, message)

"""The page of `mission edit` is what its sources, shared with the replay's page, build to."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

from mission.edit.server import BUNDLE, FILES

WEB = Path(__file__).parents[4] / "sim_bridge" / "judge" / "page" / "web"


def test_the_bundle_was_built_from_these_sources() -> None:
    told = dict(re.findall(r"^(\S+) ([0-9a-f]{64})$", (BUNDLE / "edit.js").read_text(encoding="utf-8"), re.MULTILINE))
    own = {"build_edit.mjs", "bundled.mjs", *(f"edit/{file.name}" for file in (WEB / "edit").iterdir())}
    assert own <= set(told)
    assert {"src/map/canvas.js", "src/map/layers/index.js", "src/theme.js"} <= set(told)
    assert told == {name: hashlib.sha256((WEB / name).read_bytes()).hexdigest() for name in told}, "make page"


def test_the_server_serves_what_is_in_it() -> None:
    assert {name for name, _ in FILES.values()} == {file.name for file in BUNDLE.iterdir()}
    assert (BUNDLE / "edit.html").read_bytes() == (WEB / "edit" / "edit.html").read_bytes()

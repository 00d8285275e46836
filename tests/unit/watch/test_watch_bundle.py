"""The page of `companion watch` is what its sources, shared with the replay's page, build to."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path

from companion.watch.server import BUNDLE, FILES

WEB = Path(__file__).parents[3] / "sim_bridge" / "judge" / "page" / "web"


def test_the_bundle_was_built_from_these_sources() -> None:
    told = dict(re.findall(r"^(\S+) ([0-9a-f]{64})$", (BUNDLE / "watch.js").read_text(encoding="utf-8"), re.MULTILINE))
    own = {"build_watch.mjs", *(file.relative_to(WEB).as_posix() for file in (WEB / "watch").rglob("*.*"))}
    assert own <= set(told)
    assert {"src/map/canvas.js", "src/map/layers/index.js", "src/theme.js"} <= set(told)
    assert told == {name: hashlib.sha256((WEB / name).read_bytes()).hexdigest() for name in told}, "make page"


def test_the_server_serves_what_is_in_it() -> None:
    assert {name for name, _ in FILES.values()} == {file.name for file in BUNDLE.iterdir()}
    assert (BUNDLE / "watch.html").read_bytes() == (WEB / "watch" / "watch.html").read_bytes()


def test_the_library_in_it_is_named_with_its_version_and_licence() -> None:
    lock = json.loads((WEB / "package-lock.json").read_text(encoding="utf-8"))
    head = (BUNDLE / "watch.js").read_text(encoding="utf-8").partition("sources, sha256:")[0]
    version = lock["packages"]["node_modules/@noble/hashes"]["version"]
    assert head.startswith(f"/* With @noble/hashes {version}:\nThe MIT License (MIT)")
    assert "Permission is hereby granted" in head

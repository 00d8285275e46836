"""The page's bundle is what stands beside its sources: built from them, with the licences of what is in it."""

from __future__ import annotations

import hashlib
import json
import re

from sim_bridge.judge.page import BUNDLE

WEB = BUNDLE.parent / "web"


def test_the_bundle_was_built_from_these_sources() -> None:
    digest = hashlib.sha256()
    names = [
        "build.mjs",
        "package.json",
        "package-lock.json",
        *sorted(f.relative_to(WEB).as_posix() for f in (WEB / "src").rglob("*.*")),
    ]
    for name in names:
        digest.update(f"{name}\n".encode() + (WEB / name).read_bytes())
    told = re.search(r"sources: sha256 ([0-9a-f]{64})", (BUNDLE / "page.js").read_text(encoding="utf-8"))
    assert told is not None
    assert told[1] == digest.hexdigest(), "make page"


def test_libraries_are_of_exact_versions_with_hashes_and_name_no_registry() -> None:
    wanted = json.loads((WEB / "package.json").read_text())["devDependencies"]
    assert all(re.fullmatch(r"\d+\.\d+\.\d+", version) for version in wanted.values())
    locked = {
        name: entry for name, entry in json.loads((WEB / "package-lock.json").read_text())["packages"].items() if name
    }
    assert {f"node_modules/{name}" for name in wanted} <= set(locked)
    assert all(entry["integrity"].startswith("sha512-") and "resolved" not in entry for entry in locked.values())


def test_the_licences_of_what_is_in_the_bundle_go_with_it() -> None:
    wanted = json.loads((WEB / "package.json").read_text())["devDependencies"]
    for text in ((BUNDLE / "LICENSES.txt").read_text("utf-8"), (BUNDLE / "page.js").read_text("utf-8")[:4000]):
        assert f"three {wanted['three']}" in text
        assert f"uplot {wanted['uplot']}" in text
        assert text.count("Permission is hereby granted, free of charge") == 2

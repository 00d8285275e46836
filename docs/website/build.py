"""Build the site: `python -m docs.website.build OUT`. `make site` installs what it needs before."""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from docs.website.browser import NPM, build_software, fetch_packages, lock_packages
from docs.website.pages import ROOT, config, stage_pages

HERE: Final = Path(__file__).parent
WORK: Final = ROOT / "build" / "site"
WHEELS: Final = ROOT / "build" / "site-wheels"
PAGE: Final = HERE / "page"
MERMAID: Final = NPM / "@mermaid-js" / "tiny" / "dist" / "mermaid.tiny.js"  # else the pages would load it elsewhere


def main(argv: Sequence[str]) -> int:
    """Exit code 0; 1 where a page or a link is wrong."""
    parser = argparse.ArgumentParser(prog="python -m docs.website.build", description=__doc__, allow_abbrev=False)
    parser.add_argument("out", type=Path, nargs="?", default=ROOT / "dist" / "site", help="(dist/site)")
    parser.add_argument("--zensical", default="zensical", metavar="PROGRAM", help="the generator of the pages")
    parser.add_argument("--lock", action="store_true", help="write browser.lock anew, and build nothing")
    parser.add_argument("--fetch", action="store_true", help="only fetch the page's Python packages")
    args = parser.parse_args(argv)
    if args.fetch:
        fetch_packages(WHEELS)
        return 0
    if args.lock:
        names = [line for line in (HERE / "browser.in").read_text().splitlines() if not line.startswith("#")]
        (HERE / "browser.lock").write_text(lock_packages(names), encoding="utf-8")
        return 0
    shutil.rmtree(args.out, ignore_errors=True)
    if not build_pages(args.out.resolve(), args.zensical):
        return 1
    build_fly(args.out / "fly")
    print(f"{args.out}: python -m http.server --directory {args.out}")
    return 0


def build_pages(out: Path, zensical: str) -> bool:
    """The documentation, with links that all lead somewhere."""
    shutil.rmtree(WORK, ignore_errors=True)
    stage_pages(WORK / "pages")
    shutil.copytree(HERE / "overrides", WORK / "overrides")
    shutil.copytree(HERE / "style", WORK / "pages" / "website")
    shutil.copyfile(MERMAID, WORK / "pages" / "website" / MERMAID.name)
    (WORK / "zensical.toml").write_text(config(), encoding="utf-8")
    command = [zensical, "build", "--strict", "--clean", "--config-file", str(WORK / "zensical.toml")]
    if subprocess.run(command, cwd=WORK, check=False).returncode:
        return False
    out.parent.mkdir(parents=True, exist_ok=True)
    (WORK / "site").rename(out)
    return True


def build_fly(out: Path) -> None:
    """The page that flies."""
    from sim_bridge.judge.page.html import AROUND, BUNDLE, live_page

    build_software(out, WHEELS)
    for file in PAGE.iterdir():
        shutil.copyfile(file, out / file.name)
    (out / "view.html").write_text(live_page("A flight in this page", AROUND), encoding="utf-8")
    shutil.copyfile(BUNDLE / "LICENSES.txt", out / "LICENSES.txt")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""MBTiles 1.3: an SQLite file of somebody else's, which may be damaged or hostile.

`tiles` may be a view, as the specification has it: tools store equal tiles once, and join them. So a view is not
refused for being one; it may read the file's own tables, without functions and without recursion, for so long and with
so much memory. Nothing is written, and what lies beside the file is not opened.
"""

from __future__ import annotations

import contextlib
import math
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from mission.basemap.chart import PICTURES, ZOOM_MAX, About, ChartError, is_picture
from mission.common.problems import printable

TILE_MAX_BYTES: Final = 1 << 22
FILE_ZOOM_MAX: Final = 30  # what tools write; the page asks up to ZOOM_MAX
OPEN_S: Final = 2.0  # of reading, to open it: a card that is slow takes a tenth of it
TILE_S: Final = 0.1  # a tile by its index takes a thousandth of it
LOOK_EVERY: Final = 100  # SQLite's instructions between two looks at the clock: each may copy TILE_MAX_BYTES
HEAP_MAX_BYTES: Final = 1 << 28
ROUNDING_DEG: Final = 1e-6  # tools write -180.00000000000003
TEXT_MAX: Final = 500  # characters of an attribution that are shown
WORDS: Final = ("format", "bounds", "attribution")
FUNCTIONS: Final = frozenset({"min", "max", "coalesce", "ifnull"})
LIMITS: Final = {
    sqlite3.SQLITE_LIMIT_LENGTH: TILE_MAX_BYTES + 4096,  # of a value, and of a row
    sqlite3.SQLITE_LIMIT_SQL_LENGTH: 1 << 16,
    sqlite3.SQLITE_LIMIT_COLUMN: 64,
    sqlite3.SQLITE_LIMIT_EXPR_DEPTH: 32,
    sqlite3.SQLITE_LIMIT_COMPOUND_SELECT: 16,
    sqlite3.SQLITE_LIMIT_ATTACHED: 0,
}
_TILE: Final = "SELECT tile_data FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?"


class MbTiles:
    """A file of tiles that are pictures: vector tiles would want a style, and a page that draws them."""

    def __init__(self, path: Path, clock: Callable[[], float] = time.monotonic) -> None:
        """`clock`: monotonic, s. ChartError, sqlite3.Error, OSError."""
        self._clock = clock
        self._until_s = 0.0
        self._lock = threading.Lock()
        where = f"{path.resolve().as_uri()}?mode=ro&immutable=1"  # no journal or lock of whoever put it there
        self._db = sqlite3.connect(where, uri=True, check_same_thread=False)
        try:
            self._guard()
            with self._for(OPEN_S, path):
                self.about = self._read_metadata(path)
        except BaseException:
            self._db.close()
            raise

    def _guard(self) -> None:
        for limit, most in LIMITS.items():
            self._db.setlimit(limit, most)
        for pragma in (
            "trusted_schema = OFF",
            "cell_size_check = ON",
            "mmap_size = 0",
            "temp_store = MEMORY",
            f"hard_heap_limit = {HEAP_MAX_BYTES}",
            "query_only = ON",
        ):
            self._db.execute(f"PRAGMA {pragma}").fetchall()
        self._db.set_authorizer(_authorise)
        self._db.set_progress_handler(lambda: self._clock() > self._until_s, LOOK_EVERY)

    @contextmanager
    def _for(self, limit_s: float, path: Path) -> Iterator[None]:
        """Reading that lasts no longer. ChartError says what was too much."""
        self._until_s = self._clock() + limit_s
        try:
            yield
        except MemoryError:
            raise ChartError(f"{path}: takes more than {HEAP_MAX_BYTES >> 20} MiB to be read") from None
        except sqlite3.DataError:
            raise ChartError(f"{path}: holds a value of more than {TILE_MAX_BYTES >> 20} MiB") from None
        except sqlite3.OperationalError as error:
            if getattr(error, "sqlite_errorcode", 0) != sqlite3.SQLITE_INTERRUPT:  # none: text that is no text
                raise
            raise ChartError(
                f"{path}: takes more than {limit_s:g} s to be read: are its tiles a view that runs long, "
                "or without an index on zoom_level, tile_column, tile_row?"
            ) from None

    def _read_metadata(self, path: Path) -> About:
        virtual = self._db.execute("SELECT name FROM sqlite_master WHERE type = 'table' AND rootpage = 0").fetchone()
        if virtual is not None:
            raise ChartError(f"{path}: has a virtual table, {printable(str(virtual[0]), 60)!r}: is no map")
        told = {word: self._word(word) for word in WORDS}
        kind = told["format"] or "png"
        if kind not in PICTURES:
            raise ChartError(f"{path}: its tiles are {printable(kind, 60)}: must be pictures ({', '.join(PICTURES)})")
        least, most = (
            self._db.execute(f"SELECT {which}(zoom_level) FROM tiles").fetchone()[0] for which in ("min", "max")
        )
        if least is None:
            raise ChartError(f"{path}: has no tiles")
        for zoom in (least, most):
            if not (isinstance(zoom, int) and 0 <= zoom <= FILE_ZOOM_MAX):
                value = printable(str(zoom), 60)
                raise ChartError(f"{path}: zoom_level = {value}: must be a whole number, 0 to {FILE_ZOOM_MAX}")
        if least > ZOOM_MAX:
            raise ChartError(f"{path}: zoom_level = {least}: has no tile up to {ZOOM_MAX}, which is shown at most")
        first = self._db.execute("SELECT tile_data FROM tiles LIMIT 1").fetchone()[0]
        if not (isinstance(first, bytes) and is_picture(first)):
            raise ChartError(f"{path}: its metadata say {kind}, but a tile is no picture (png, jpeg or webp)")
        self._db.execute(_TILE, (most, -1, -1)).fetchone()  # how long it takes where there is none
        self._check_told_zooms(path)
        bounds_deg = None if told["bounds"] is None else bounds_of(told["bounds"], path)
        shown = printable(told["attribution"] or "", TEXT_MAX)
        return About(PICTURES[kind], least, min(ZOOM_MAX, most), bounds_deg, attribution=shown)

    def _check_told_zooms(self, path: Path) -> None:
        """ChartError for zooms of the metadata that make no sense; those of the tiles are what is shown."""
        told = {name: word for name in ("minzoom", "maxzoom") if (word := self._word(name)) is not None}
        zooms = {name: _zoom(word) for name, word in told.items()}
        for name, zoom in zooms.items():
            if zoom is None:
                value = printable(told[name], 60)
                raise ChartError(f"{path}: {name} = {value!r}: must be a whole number, 0 to {FILE_ZOOM_MAX}")
        least, most = zooms.get("minzoom"), zooms.get("maxzoom")
        if least is not None and most is not None and least > most:
            raise ChartError(f"{path}: minzoom = {least:g}: must be at most maxzoom = {most:g}")

    def _word(self, name: str) -> str | None:
        found = self._db.execute("SELECT value FROM metadata WHERE name = ?", (name,)).fetchone()
        return None if found is None or found[0] is None else str(found[0])

    def tile(self, zoom: int, x: int, y: int) -> bytes | None:
        """See Chart. Rows count from the south in the file. None, too, where it takes longer than TILE_S."""
        row = (1 << zoom) - 1 - y
        with self._lock, contextlib.suppress(sqlite3.Error, MemoryError):
            self._until_s = self._clock() + TILE_S
            found = self._db.execute(_TILE, (zoom, x, row)).fetchone()
            if found is not None and isinstance(found[0], bytes) and len(found[0]) <= TILE_MAX_BYTES:
                return found[0]
        return None

    def image(self) -> bytes | None:
        """None."""
        return None

    def close(self) -> None:
        """Close the file."""
        self._db.close()


def _authorise(action: int, _one: Any, two: Any, *_: Any) -> int:
    """Reading, and no function but those that a view of tiles may need. Recursion is none of it."""
    if action in (sqlite3.SQLITE_SELECT, sqlite3.SQLITE_READ):
        return sqlite3.SQLITE_OK
    is_plain = action == sqlite3.SQLITE_FUNCTION and str(two).lower() in FUNCTIONS
    return sqlite3.SQLITE_OK if is_plain else sqlite3.SQLITE_DENY


def _zoom(text: str) -> float | None:
    """None: it is no zoom that a file may have."""
    try:
        zoom = float(text)
    except ValueError:
        return None
    return zoom if 0.0 <= zoom <= FILE_ZOOM_MAX and zoom.is_integer() else None  # false for NaN


def bounds_of(text: str, path: Path) -> tuple[float, float, float, float]:
    """West, south, east, north in degrees. ChartError with the value."""
    try:
        west, south, east, north = map(float, text.split(","))
    except ValueError:
        west = south = east = north = math.nan
    is_on_earth = max(-west, east) <= 180.0 + ROUNDING_DEG and max(-south, north) <= 90.0 + ROUNDING_DEG
    if west < east and south < north and is_on_earth:  # false for NaN
        return west, south, east, north
    raise ChartError(f"{path}: bounds = {printable(text, 80)!r}: must be west, south, east, north in degrees")

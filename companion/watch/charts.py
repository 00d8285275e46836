"""Maps that lie on this computer's disk: MBTiles, or an image with its world file. No network is asked.

MBTiles: 1.3, with tiles that are pictures: vector tiles would want a style, and a page that draws them.
"""

from __future__ import annotations

import contextlib
import math
import sqlite3
import struct
import threading
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final, Protocol

from mission.stems.utm import Zone, to_wgs84

ZOOM_MAX: Final = 24
TILE_MAX_BYTES: Final = 1 << 22
IMAGE_MAX_BYTES: Final = 1 << 26
PICTURES: Final = {"png": "image/png", "jpg": "image/jpeg", "jpeg": "image/jpeg", "webp": "image/webp"}
_SIDES: Final = {"png": "pgw", "jpg": "jgw", "jpeg": "jgw", "webp": "wpw"}


class ChartError(Exception):
    """A map cannot be shown; the message names its file, and what is allowed."""


@dataclass(frozen=True, slots=True)
class About:
    """Metadata for the page. `bounds_deg`: west, south, east, north. `corners_deg`: of an image: latitude and longitude
    of its upper left, its upper right and its lower left corner; None: there are tiles."""

    mime: str
    min_zoom: int = 0
    max_zoom: int = 0
    bounds_deg: tuple[float, float, float, float] | None = None
    corners_deg: tuple[tuple[float, float], ...] | None = None
    size_px: tuple[int, int] | None = None
    attribution: str = ""

    def as_dict(self) -> dict[str, object]:
        """For JSON."""
        return asdict(self)


class Chart(Protocol):
    """A map."""

    about: About

    def tile(self, zoom: int, x: int, y: int) -> bytes | None:
        """A picture of 256 px or more, in web Mercator, y from the north; None: there is none. Any thread may ask."""

    def image(self) -> bytes | None:
        """The whole map, where it has `corners_deg`."""

    def close(self) -> None:
        """Close its file."""


def open_chart(path: Path, zone: Zone | None = None) -> Chart:
    """By the file's name. `zone`: of an image's world file in UTM. ChartError."""
    kind = path.suffix.lower().removeprefix(".")
    if not path.is_file():
        raise ChartError(f"{path}: {'is not a file' if path.exists() else 'no such file'}")
    if zone is not None and kind not in PICTURES:
        raise ChartError(f"{path}: --utm is for an image with a world file")
    try:
        if kind == "mbtiles":
            return MbTiles(path)
        if kind in PICTURES:
            return Image(path, kind, zone)
    except (struct.error, IndexError):
        raise ChartError(f"{path}: is cut short: it ends inside its header") from None
    except (OSError, sqlite3.Error, ValueError, OverflowError) as error:
        raise ChartError(f"{path}: cannot be read as a map: {error}") from None
    raise ChartError(f"{path}: must be .mbtiles, or a .png, .jpg or .webp with its world file")


class MbTiles:
    """An SQLite file."""

    def __init__(self, path: Path) -> None:
        self._lock = threading.Lock()
        self._db = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True, check_same_thread=False)
        try:
            self._read_metadata(path)
        except BaseException:
            self._db.close()
            raise

    def _read_metadata(self, path: Path) -> None:
        told = {str(name): str(value) for name, value in self._db.execute("SELECT name, value FROM metadata")}
        kind = told.get("format", "png")
        if kind not in PICTURES:
            raise ChartError(f"{path}: its tiles are {kind}: must be pictures ({', '.join(PICTURES)})")
        zooms = self._db.execute("SELECT min(zoom_level), max(zoom_level) FROM tiles").fetchone()
        if zooms[0] is None:
            raise ChartError(f"{path}: has no tiles")
        first = self._db.execute("SELECT tile_data FROM tiles LIMIT 1").fetchone()[0]
        if not (isinstance(first, bytes) and _is_picture(first)):
            raise ChartError(f"{path}: its metadata say {kind}, but a tile is no picture (png, jpeg or webp)")
        bounds = tuple(float(part) for part in told["bounds"].split(",")) if "bounds" in told else None
        self.about = About(
            PICTURES[kind],
            int(zooms[0]),
            min(ZOOM_MAX, int(zooms[1])),
            bounds if bounds is not None and len(bounds) == 4 else None,
            attribution=told.get("attribution", ""),
        )

    def tile(self, zoom: int, x: int, y: int) -> bytes | None:
        """See Chart. Rows count from the south in the file."""
        row = (1 << zoom) - 1 - y
        with self._lock, contextlib.suppress(sqlite3.Error):
            found = self._db.execute(
                "SELECT tile_data FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?", (zoom, x, row)
            ).fetchone()
            if found is not None and isinstance(found[0], bytes) and len(found[0]) <= TILE_MAX_BYTES:
                return found[0]
        return None

    def image(self) -> bytes | None:
        """None."""
        return None

    def close(self) -> None:
        """Close the file."""
        self._db.close()


class Image:
    """A picture and its world file: six lines, of which the last two are the middle of the upper left pixel."""

    def __init__(self, path: Path, kind: str, zone: Zone | None) -> None:
        sides = [path.with_suffix(f".{_SIDES[kind]}"), Path(f"{path}w"), path.with_suffix(".wld")]
        side = next((file for file in sides if file.is_file()), None)
        if side is None:
            raise ChartError(f"{path}: has no world file: {', '.join(file.name for file in sides)}")
        if path.stat().st_size > IMAGE_MAX_BYTES:
            raise ChartError(f"{path}: must be at most {IMAGE_MAX_BYTES >> 20} MiB")
        try:
            a, d, b, e, c, f = (float(word) for word in side.read_text(encoding="ascii").split())
        except ValueError:
            raise ChartError(f"{side}: must be six numbers") from None
        self._bytes = path.read_bytes()
        width, height = _size_px(self._bytes, kind)
        if a * e == b * d:
            raise ChartError(f"{side}: its pixels have no area: the first four numbers are {a:g}, {d:g}, {b:g}, {e:g}")
        left, top = c - (a + b) / 2.0, f - (d + e) / 2.0
        corners = [(left, top), (left + a * width, top + d * width), (left + b * height, top + e * height)]
        if not all(math.isfinite(value) for corner in corners for value in corner):
            raise ChartError(f"{side}: must be six numbers")
        if zone is None:
            if any(abs(lon) > 180.0 or abs(lat) > 90.0 for lon, lat in corners):
                raise ChartError(f"{side}: is not in degrees: name its zone, as --utm 32N")
            corners_lat_lon_deg = tuple((lat, lon) for lon, lat in corners)
        else:
            corners_lat_lon_deg = tuple(to_wgs84(east_m, north_m, zone) for east_m, north_m in corners)
        self.about = About(PICTURES[kind], corners_deg=corners_lat_lon_deg, size_px=(width, height))

    def tile(self, zoom: int, x: int, y: int) -> bytes | None:
        """None."""
        del zoom, x, y
        return None

    def image(self) -> bytes | None:
        """The file."""
        return self._bytes

    def close(self) -> None:
        """Nothing is open."""


def _is_picture(data: bytes) -> bool:
    """Of any of the kinds: maps mix JPEG with PNG for their edges, and browsers look at the picture itself."""
    return data.startswith((b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff")) or data[:4] + data[8:12] == b"RIFFWEBP"


def _size_px(data: bytes, kind: str) -> tuple[int, int]:
    """Width and height, out of the file's header. ValueError, struct.error."""
    if kind == "png":
        if data[:8] != b"\x89PNG\r\n\x1a\n":
            raise ValueError("not a PNG")
        width, height = struct.unpack(">II", data[16:24])
    elif kind == "webp":
        if data[:4] != b"RIFF" or data[8:16] != b"WEBPVP8X":
            raise ValueError("must be a WebP of the extended kind, or a PNG or JPEG")
        width = 1 + int.from_bytes(data[24:27], "little")
        height = 1 + int.from_bytes(data[27:30], "little")
    else:
        width, height = _jpeg_size_px(data)
    return width, height


def _jpeg_size_px(data: bytes) -> tuple[int, int]:
    if data[:2] != b"\xff\xd8":
        raise ValueError("not a JPEG")
    at = 2
    while data[at] == 0xFF:
        marker, size = struct.unpack(">xBH", data[at : at + 4])
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack(">HH", data[at + 5 : at + 9])
            return width, height
        at += 2 + size
    raise ValueError("a JPEG without a size")

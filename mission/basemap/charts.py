"""Maps that lie on this computer's disk: MBTiles, or an image with its world file. No network is asked."""

from __future__ import annotations

import math
import sqlite3
import struct
from pathlib import Path
from typing import Final

from mission.basemap.chart import PICTURES, About, Chart, ChartError
from mission.basemap.mbtiles import MbTiles
from mission.stems.utm import Zone, to_wgs84

IMAGE_MAX_BYTES: Final = 1 << 26
SIDE_MAX_PX: Final = 32_767  # of what browsers draw
WORLD_FILE_MAX_BYTES: Final = 4096
_SIDES: Final = {"png": "pgw", "jpg": "jgw", "jpeg": "jgw", "webp": "wpw"}


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
    except OSError as error:
        raise ChartError(f"{path}: cannot be read as a map: {error.strerror or error}") from None
    except (sqlite3.Error, ValueError, OverflowError) as error:
        raise ChartError(f"{path}: cannot be read as a map: {error}") from None
    raise ChartError(f"{path}: must be .mbtiles, or a .png, .jpg or .webp with its world file")


class Image:
    """A picture and its world file: six lines, of which the last two are the middle of the upper left pixel."""

    def __init__(self, path: Path, kind: str, zone: Zone | None) -> None:
        sides = [path.with_suffix(f".{_SIDES[kind]}"), Path(f"{path}w"), path.with_suffix(".wld")]
        side = next((file for file in sides if file.is_file()), None)
        if side is None:
            raise ChartError(f"{path}: has no world file: {', '.join(file.name for file in sides)}")
        if path.stat().st_size > IMAGE_MAX_BYTES:
            raise ChartError(f"{path}: must be at most {IMAGE_MAX_BYTES >> 20} MiB")
        with side.open("rb") as file:
            words = file.read(WORLD_FILE_MAX_BYTES + 1)
        try:
            a, d, b, e, c, f = (float(word) for word in words.decode("ascii").split())
        except ValueError:
            raise ChartError(f"{side}: must be six numbers") from None
        self._bytes = path.read_bytes()
        width, height = _size_px(self._bytes, kind)
        if not (1 <= width <= SIDE_MAX_PX and 1 <= height <= SIDE_MAX_PX):
            raise ChartError(f"{path}: is {width} x {height} px: each side must be 1 to {SIDE_MAX_PX}")
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
            try:
                corners_lat_lon_deg = tuple(to_wgs84(east_m, north_m, zone) for east_m, north_m in corners)
            except (OverflowError, ValueError):
                corners_lat_lon_deg = ((math.nan, math.nan),)
            if not all(abs(lat) <= 90.0 and abs(lon) <= 180.0 for lat, lon in corners_lat_lon_deg):  # NaN is not
                raise ChartError(f"{side}: upper left at {left:g}, {top:g}: is nowhere in {zone}")
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

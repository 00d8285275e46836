"""A map on disk: what is told of it, what it gives, and how it is refused."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Final, Protocol

ZOOM_MAX: Final = 24
PICTURES: Final = {"png": "image/png", "jpg": "image/jpeg", "jpeg": "image/jpeg", "webp": "image/webp"}


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


def is_picture(data: bytes) -> bool:
    """Of any of the kinds: maps mix JPEG with PNG for their edges, and browsers look at the picture itself."""
    return data.startswith((b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff")) or data[:4] + data[8:12] == b"RIFFWEBP"

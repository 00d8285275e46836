"""Text of a stem map as programs write it: UTF-8, UTF-16 with a byte order mark, or what Windows had before."""

from __future__ import annotations

import codecs
import re
from typing import Final

from mission.common.files import decoded, refused
from mission.stems.columns import column_of

WINDOWS: Final = {"cp1252": "Windows-1252", "cp1250": "Windows-1250"}  # of western, of central Europe: Excel's CSV
_BOMS: Final = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
_CONTROL: Final = re.compile(rb"[\x00-\x08\x0b\x0c\x0e-\x1f]")
_FIELD: Final = re.compile(r"[,;\t]")


def read_text(data: bytes, place: str) -> tuple[str, str]:
    """The text, and the encoding where it was inferred, else ""; MissionError.

    Nothing in a file says which of the older Windows encodings it has: that in which more headings are understood.
    """
    if data.startswith(_BOMS):
        try:
            return data.decode("utf-16"), ""
        except UnicodeDecodeError:
            raise refused(place, None, "not UTF-16 text, as its first two bytes say") from None
    try:
        return data.decode("utf-8-sig"), ""
    except UnicodeDecodeError:
        texts = {} if _CONTROL.search(data) else _windows_texts(data)
        if not texts:
            return decoded(data, place), ""  # which tells the byte
        encoding = max(texts, key=lambda name: _headings(texts[name]))
        return texts[encoding], WINDOWS[encoding]


def _windows_texts(data: bytes) -> dict[str, str]:
    texts = {}
    for encoding in WINDOWS:
        try:
            texts[encoding] = data.decode(encoding)
        except UnicodeDecodeError:  # a byte that it does not have
            continue
    return texts


def _headings(text: str) -> int:
    """Number of understood names in the header."""
    for line in text[:20_000].split("\n"):
        if line.strip() and line[0] != "#":
            return sum(column_of(name.strip(' "\r')) is not None for name in _FIELD.split(line))
    return 0

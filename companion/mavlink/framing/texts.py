"""STATUSTEXT longer than its 50 bytes: MAVLink 2 sends it in chunks, which share an id and are numbered from 0.

The last chunk is one that is not full. An id of 0 is a text that is whole.
"""

from __future__ import annotations

from typing import Any, Final

from companion.mavlink import dialect

CHUNK_BYTES: Final = 50
SENT_CHUNKS: Final = 4  # at most, of one text of ours
READ_CHUNKS: Final = 8  # at most, of one text of somebody else's
ID_MAX = 0xFFFF
CUT = "..."  # ends a text that did not fit


def encode(severity: int, text: str, text_id: int) -> list[Any]:
    """The STATUSTEXT messages of `text`, in order; one that does not fit is cut at a word. `text_id`: 1..65535."""
    longest = SENT_CHUNKS * CHUNK_BYTES - 1  # or its last chunk would be full
    if len(text) > longest:
        kept = text[: longest - len(CUT)]
        text = (kept.rpartition(" ")[0] or kept) + CUT
    data = text.encode("ascii", "replace")  # as many bytes as characters
    if len(data) <= CHUNK_BYTES:
        return [dialect.MAVLink_statustext_message(severity, data)]
    return [
        dialect.MAVLink_statustext_message(severity, data[at : at + CHUNK_BYTES], text_id, seq)
        for seq, at in enumerate(
            range(0, len(data) + 1, CHUNK_BYTES)
        )  # + 1: a full last chunk is followed by an empty one
    ]


class Reader:
    """Puts the texts of one sender together."""

    __slots__ = ("_chunks", "_id", "lost")

    def __init__(self) -> None:
        self._id = 0
        self._chunks: list[str] = []
        self.lost = 0  # chunks of texts that were not whole

    def read_text(self, message: Any) -> str | None:
        """The text that `message` ends; None while more chunks of it are to come, or one of them was lost."""
        text = str(message.text)
        if not message.id:
            return text
        if message.chunk_seq == 0:
            self._id, self._chunks = message.id, []
        if message.id != self._id or message.chunk_seq != len(self._chunks):
            self._id, self._chunks = 0, []
            self.lost += 1
            return None
        self._chunks.append(text)
        if len(text) >= CHUNK_BYTES and len(self._chunks) < READ_CHUNKS:
            return None
        text = "".join(self._chunks)
        self._id, self._chunks = 0, []
        return text

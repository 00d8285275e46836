"""Tables of what proves who has sent a frame."""

from __future__ import annotations

from typing import Final

from companion.mavlink.schema.rows import Message, field

MACS_MAX: Final = 20  # frames that a manifest names; more are the next one's
ECHOES_MAX: Final = 8  # boots that it echoes, in turn
SIGNATURE: Final = 64  # bytes, Ed25519

MANIFEST: Final = Message(
    id=52107,
    name="SWARM_MANIFEST",
    meaning="In a signed swarm, once a second and with news: the sender vouches with its own Ed25519 key for this boot"
    " of it, and for the frames that it has sent. The group's MAC, which each frame bears, only says that one of"
    " the swarm has sent it.",
    see="[signed frames](../explanation/signed-frames.md)",
    fields=(
        field("newest", "uint64_t", "Timestamp, as in the signature, of the last frame that is named. In 10 us."),
        field("boot", "uint32_t", "Number of this start of the sender, drawn at random; never 0."),
        field("span", "uint32_t", "From the first frame that is named to the last. In 10 us."),
        field(
            "echoes",
            f"uint8_t[{5 * ECHOES_MAX}]",
            "Groups of five bytes: system id of another sender (0: none), and its `boot`, low byte first.",
        ),
        field(
            "macs",
            f"uint8_t[{6 * MACS_MAX}]",
            "The last six bytes of each frame that the sender has sent between the first and the last, in their order;"
            " zeros: none. Neither manifests nor records are named.",
        ),
        field(
            "ed25519",
            f"uint8_t[{SIGNATURE}]",
            'Ed25519, of "understory manifest 1", the sender\'s system id and all fields before it as they are sent.',
        ),
    ),
)

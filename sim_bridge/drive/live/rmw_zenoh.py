"""Names and attachments of rmw_zenoh_cpp, by which ROS 2 nodes over Zenoh find topics and each other.

As version 0.2.4 (Jazzy) and later write them, Kilted's and Rolling's, too: key expressions and liveliness tokens as its
docs/design.md has them (github.com/ros2/rmw_zenoh), attachments as rmw_zenoh_cpp/src/detail/attachment_helpers.cpp.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final

import xxhash

ADMIN_SPACE: Final = "@ros2_lv"
NODE, PUBLISHER, SUBSCRIPTION = "NN", "MP", "MS"
QOS: Final = "::,10:,:,:,,"  # reliable, volatile, the last ten; the rest as by default
GID_BYTES: Final = 16


def type_name(kind: str) -> str:
    """`nav_msgs/msg/Odometry` as DDS and rmw_zenoh name it."""
    package, folder, name = kind.split("/")
    return f"{package}::{folder}::dds_::{name}_"


def mangled(name: str) -> str:
    """A name in one chunk of a key expression."""
    return name.replace("/", "%")


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic's name (with its slash), type and type hash (RIHS01), in a ROS domain."""

    domain: int
    name: str
    kind: str
    type_hash: str

    @property
    def key(self) -> str:
        """Key expression on which its messages are put."""
        return f"{self.domain}/{self.name.strip('/')}/{type_name(self.kind)}/{self.type_hash}"


@dataclass(frozen=True, slots=True)
class Node:
    """A node of one session. `namespace` with its slash; `number`: its id in the session."""

    domain: int
    session: str
    number: int
    namespace: str
    name: str

    @property
    def token(self) -> str:
        """Liveliness token of the node."""
        return self._token(self.number, NODE)

    def endpoint_token(self, number: int, kind: str, topic: Topic) -> str:
        """Liveliness token of its publisher or subscription, whose id in the session is `number`."""
        about = f"{mangled(topic.name)}/{type_name(topic.kind)}/{topic.type_hash}/{QOS}"
        return f"{self._token(number, kind)}/{about}"

    def _token(self, number: int, kind: str) -> str:
        who = f"{ADMIN_SPACE}/{self.domain}/{self.session}/{self.number}/{number}/{kind}"
        return f"{who}/%/{mangled(self.namespace)}/{self.name}"


def gid_of(token: str) -> bytes:
    """The id by which a message's publisher is known: XXH3 (128 bit) of its token, the low half first."""
    digest: bytes = xxhash.xxh3_128_digest(token.encode())
    return digest[::-1]


def attachment(sequence: int, time_ns: int, gid: bytes) -> bytes:
    """Attachment of a message, as zenoh's serializer writes it: two int64, and bytes after their length."""
    return struct.pack("<qqB", sequence, time_ns, GID_BYTES) + gid

"""A Zenoh session that ROS 2 nodes with rmw_zenoh take for nodes of theirs: publishers, subscriptions, their tokens."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Mapping
from typing import Any, Final

import zenoh
from rosbags.typesys import Stores, get_typestore

from mission.common.exit_codes import EXIT_ENVIRONMENT
from mission.common.problems import printable
from sim_bridge.drive.live.rmw_zenoh import PUBLISHER, SUBSCRIPTION, Node, Topic, attachment, gid_of
from sim_bridge.errors import StartError
from sim_bridge.judge.export.ros2.messages import Stamped

NODE_NAME: Final = "understory"
CONNECT_MS: Final = 3000
WORDS_MAX_CHARS: Final = 300


class _Publisher:
    """One topic of ours."""

    def __init__(self, session: Any, node: Node, number: int, topic: Topic) -> None:
        token = node.endpoint_token(number, PUBLISHER, topic)
        self._gid = gid_of(token)
        self._sequence = 0
        # The flight waits for who reads slowly; who reads nothing is disconnected by zenoh, after seconds
        self._put = session.declare_publisher(topic.key, congestion_control=zenoh.CongestionControl.BLOCK).put
        self._token = session.liveliness().declare_token(token)  # lives as long as this does

    def put(self, payload: bytes, time_ns: int) -> None:
        """CDR of a message."""
        self._sequence += 1
        self._put(payload, attachment=attachment(self._sequence, time_ns, self._gid))


class Inlet:
    """The last message of a topic that others publish; read between two ticks."""

    def __init__(self) -> None:
        self._last: deque[bytes] = deque(maxlen=1)  # zenoh's thread appends

    def take_last(self) -> bytes | None:
        """CDR of the last message since the last call; None: none came."""
        return self._last.pop() if self._last else None

    def receive(self, sample: Any) -> None:
        """Of any thread."""
        self._last.append(bytes(sample.payload))


class ZenohSession:
    """Opened to `endpoint`; nodes, publishers and subscriptions are declared as they are needed."""

    def __init__(self, endpoint: str, domain: int) -> None:
        """`endpoint`: of a router or peer, as tcp/localhost:7447. StartError: nobody is there."""
        self._store: Final = get_typestore(Stores.ROS2_JAZZY)
        self._domain: Final = domain
        config = zenoh.Config()
        connect = {"endpoints": [endpoint], "timeout_ms": CONNECT_MS, "exit_on_failure": True}
        try:
            config.insert_json5("mode", '"peer"')
            config.insert_json5("scouting/multicast/enabled", "false")  # as rmw_zenoh has it
            config.insert_json5("listen/endpoints", "[]")
            config.insert_json5("connect", json.dumps(connect))
            self._session = zenoh.open(config)
        except zenoh.ZError as error:
            why = printable(str(error), WORDS_MAX_CHARS)
            hint = "a router is started by `ros2 run rmw_zenoh_cpp rmw_zenohd`"
            raise StartError(f"--zenoh {endpoint}: no session: {why}; {hint}", EXIT_ENVIRONMENT) from None
        self._ids = 0
        self._nodes: dict[str, Node] = {}
        self._publishers: dict[str, _Publisher] = {}
        self._kept: list[Any] = []  # tokens and subscriptions, which end when they are let go

    @property
    def types(self) -> Mapping[str, Any]:
        """Message classes by name."""
        types: Mapping[str, Any] = self._store.types
        return types

    def put(self, message: Stamped) -> None:
        """Publish it; its topic's first namespace is that of the node."""
        found = self._publishers.get(message.topic)
        if found is None:
            node, topic = self._node_of(message.topic), self._topic(message.topic, message.kind)
            found = self._publishers[message.topic] = _Publisher(self._session, node, self._new_id(), topic)
        found.put(bytes(self._store.serialize_cdr(message.body, message.kind)), message.time_ns)

    def subscribe(self, name: str, kind: str) -> Inlet:
        """The messages that others publish on a topic."""
        inlet, topic = Inlet(), self._topic(name, kind)
        token = self._node_of(name).endpoint_token(self._new_id(), SUBSCRIPTION, topic)
        self._kept.append(self._session.declare_subscriber(topic.key, inlet.receive))
        self._kept.append(self._session.liveliness().declare_token(token))
        return inlet

    def deserialize(self, data: bytes, kind: str) -> Any:
        """A message. ValueError: it is none of that kind."""
        try:
            return self._store.deserialize_cdr(data, kind)
        except Exception as error:  # whatever the library makes of bytes that are none
            raise ValueError(f"no {kind}: {type(error).__name__}") from error

    def close(self) -> None:
        """End all that was declared."""
        self._session.close()  # type: ignore[no-untyped-call]

    def _node_of(self, topic: str) -> Node:
        first, _, rest = topic.strip("/").partition("/")
        namespace = f"/{first}" if rest else "/"
        node = self._nodes.get(namespace)
        if node is None:
            number = self._new_id()
            node = Node(self._domain, str(self._session.zid()), number, namespace, NODE_NAME)
            self._nodes[namespace] = node
            self._kept.append(self._session.liveliness().declare_token(node.token))
        return node

    def _topic(self, name: str, kind: str) -> Topic:
        return Topic(self._domain, name, kind, self._store.hash_rihs01(kind))

    def _new_id(self) -> int:
        self._ids += 1
        return self._ids - 1

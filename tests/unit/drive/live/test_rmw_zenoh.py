"""Names and attachments as rmw_zenoh's design document and source have them."""

from __future__ import annotations

import pytest
from rosbags.typesys import Stores, get_typestore

pytest.importorskip("xxhash", reason="of the extra `zenoh`")

from sim_bridge.drive.live.rmw_zenoh import PUBLISHER, SUBSCRIPTION, Node, Topic, attachment, gid_of

STRING = "std_msgs/msg/String"
HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
CHATTER = Topic(0, "/chatter", STRING, HASH)


def test_the_type_hash_is_that_of_ros() -> None:
    assert get_typestore(Stores.ROS2_JAZZY).hash_rihs01(STRING) == HASH


def test_keys_are_those_of_the_design_document() -> None:
    assert CHATTER.key == f"0/chatter/std_msgs::msg::dds_::String_/{HASH}"
    assert Topic(0, "/robot1/chatter", STRING, HASH).key == f"0/robot1/chatter/std_msgs::msg::dds_::String_/{HASH}"


def test_tokens_are_those_of_the_design_document() -> None:
    listener = Node(2, "aac3178e146ba6f1fc6e6a4085e77f21", 0, "/", "listener")
    assert listener.token == "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener"
    assert listener.endpoint_token(10, SUBSCRIPTION, CHATTER) == (
        "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/10/MS/%/%/listener/%chatter/std_msgs::msg::dds_::String_/"
        f"{HASH}/::,10:,:,:,,"
    )
    named = Node(0, "a1", 3, "/vehicle_1", "understory")
    of_topic = named.endpoint_token(4, PUBLISHER, Topic(0, "/vehicle_1/odom", STRING, HASH))
    assert of_topic.startswith("@ros2_lv/0/a1/3/4/MP/%/%vehicle_1/understory/%vehicle_1%odom/std_msgs::msg::dds_::")


def test_an_attachment_is_two_numbers_and_the_publishers_id() -> None:
    gid = gid_of("@ros2_lv/0/a1/3/4/MP/%/%/understory")
    found = attachment(7, 1_700_000_000_123_456_789, gid)
    assert found[:8] == (7).to_bytes(8, "little")
    assert found[8:16] == (1_700_000_000_123_456_789).to_bytes(8, "little")
    assert (found[16], found[17:], len(found)) == (16, gid, 33)


def test_zenoh_reads_an_attachment_as_it_would_write_it() -> None:
    zenoh = pytest.importorskip("zenoh", reason="of the extra `zenoh`")
    ext = pytest.importorskip("zenoh.ext")
    gid = bytes(range(16))
    assert bytes(ext.z_serialize((ext.Int64(3), ext.Int64(4), gid))) == attachment(3, 4, gid)
    kinds = tuple[ext.Int64, ext.Int64, bytes]
    assert ext.z_deserialize(kinds, zenoh.ZBytes(attachment(3, 4, gid))) == (3, 4, gid)

"""The live map over its sockets: who is let in, what viewers get, and what a slow one costs."""

from __future__ import annotations

import asyncio
import json
import socket
import urllib.error
import urllib.request
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import pytest
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from mission.common.network.connections import CONNECTIONS_MAX
from mission.common.problems import MissionError
from sim_bridge.judge.live import wire
from sim_bridge.judge.live.server import OF_ADDRESS_MAX, VIEWERS_MAX, MapServer
from sim_bridge.judge.page.coding import read_column
from sim_bridge.judge.recording import COLUMNS
from tests.unit.judge.live_kit import CONTROLS, Served, served

UP = {"on_ground": (False,) * 3}


def serving(test: Callable[[Served], Coroutine[Any, Any, None]]) -> None:
    async def run() -> None:
        async with served() as one:
            await test(one)

    asyncio.run(run())


def fetched(host: str, path: str = "/", **headers: str) -> tuple[int, str, dict[str, str]]:
    request = urllib.request.Request(f"http://{host}{path}", headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:
            return answer.status, answer.read().decode(), dict(answer.headers)
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read().decode(), {}


async def told(viewer: Any) -> dict[str, Any]:
    message: dict[str, Any] = json.loads(await asyncio.wait_for(viewer.recv(), 60.0))
    return message


def test_the_page_comes_with_a_policy_that_lets_it_ask_for_its_stream_only() -> None:
    async def test(one: Served) -> None:
        status, page, headers = await asyncio.to_thread(fetched, one.host)
        assert status == 200
        assert 'data-stream="live"' in page
        policy = headers["Content-Security-Policy"]
        assert "default-src 'none'" in policy
        assert f"connect-src ws://{one.host};" in policy
        assert (await asyncio.to_thread(fetched, one.host, "/other"))[0] == 404

    serving(test)


def test_a_foreign_name_gets_no_page_and_a_foreign_page_no_stream(tmp_path: Path) -> None:
    async def test(one: Served) -> None:
        one.begin(tmp_path)
        assert (await asyncio.to_thread(fetched, one.host, Host="evil.example"))[0] == 403
        assert (await asyncio.to_thread(fetched, one.host, Host=f"evil.example:{one.port}"))[0] == 403
        for origin in ("http://evil.example", f"http://localhost:{one.port}", "null"):
            with pytest.raises(InvalidStatus):
                async with connect(one.stream, origin=origin):  # type: ignore[arg-type]
                    pass
        async with connect(one.stream, origin=f"http://{one.host}") as viewer:  # type: ignore[arg-type]
            assert (await told(viewer))["format"] == "understory-live"

    serving(test)


def test_a_viewer_gets_what_was_and_then_what_comes(tmp_path: Path) -> None:
    async def test(one: Served) -> None:
        one.begin(tmp_path)
        for k in range(5):
            one.row(0.1 * k)
        async with connect(one.stream) as viewer:
            first = await told(viewer)
            assert (first["version"], first["controls"]) == (1, CONTROLS)
            assert read_column(first["replay"]["time_s"]).tolist() == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
            assert read_column(first["replay"]["vehicles"][0]["north_m"]).tolist() == [5.0] * 5
            one.row(0.5, pos_ned_m=((1.0, 2.0, -3.0), (9.0, 2.0, -3.0), (99.0, 2.0, -3.0)), **UP)
            row = (await told(viewer))["rows"][0]
            assert row["time_s"] == 0.5
            assert row["vehicles"]["north_m"] == [1.0, 9.0, 99.0]
            assert row["vehicles"]["east_m"] == [2.0] * 3
            assert row["vehicles"]["up_m"] == [3.0] * 3
            assert row["vehicles"]["yaw_deg"] == [90.0] * 3
            assert row["vehicles"]["beacon_age_s"] == [None] * 3
            assert row["swarm"]["separation_m"] == 8.0
            assert row["swarm"]["lambda2"] == 0.0  # the third is out of reach
            assert row["links"] == "gA=="  # of the pairs 1-2, 1-3, 2-3 the first

    serving(test)


def test_what_happens_and_the_pace_reach_those_who_look_and_those_who_come_later(tmp_path: Path) -> None:
    event = {"time_s": 1.0, "kind": "text", "vehicles": [], "text": "vehicle 1: ready"}

    async def test(one: Served) -> None:
        one.begin(tmp_path)
        one.row(0.0)
        async with connect(one.stream) as early:
            await told(early)
            wire.send(one.end, {"event": event})
            wire.send(one.end, {"pace": {"paused": True, "factor": 5.0}})
            seen: dict[str, Any] = {}
            while "pace" not in seen or "events" not in seen:
                seen |= await told(early)
            assert seen["events"] == [event]
            async with connect(one.stream) as late:
                first = await told(late)
                assert first["pace"] == {"paused": True, "factor": 5.0}
                assert first["replay"]["events"] == [event]

    serving(test)


def test_a_change_of_the_leader_is_told_with_its_reason(tmp_path: Path) -> None:
    killed = {"kind": "kill", "vehicles": [1], "at_s": 0.1, "until_s": None, "late_s": None, "asked": "kill 1@0.1"}

    async def test(one: Served) -> None:
        one.begin(tmp_path)

        def row(time_s: float, leader: int) -> None:
            values: dict[str, Any] = {name: [0] * 3 for name in COLUMNS}
            acting = [k == leader for k in (1, 2, 3)]
            values |= {"time_s": time_s, "pos_ned_m": [[0, 0, 0]] * 3, "vel_ned_mps": [[0, 0, 0]] * 3}
            values |= {"agent_alive": [True] * 3, "acting": acting, "leader": [leader] * 3}
            wire.send(one.end, {"row": list(values.values()), "yaw_deg": [None] * 3, "beacon_age_s": [0.0] * 3})

        row(0.0, 1)
        async with connect(one.stream) as viewer:
            events = (await told(viewer))["replay"]["events"]
            assert [e["text"] for e in events if e["kind"] == "lead"] == ["vehicle 1 leads: first election"]
            wire.send(one.end, {"fault": killed})
            row(0.2, 2)
            while not (events := (await told(viewer)).get("events", [])):
                pass
            assert [e["text"] for e in events] == ["vehicle 2 leads: vehicle 1 killed at 0.1 s"]

    serving(test)


def test_a_wish_reaches_the_flight_and_nonsense_does_not(tmp_path: Path) -> None:
    async def test(one: Served) -> None:
        one.begin(tmp_path)
        one.row(0.0)
        async with connect(one.stream) as viewer:
            await told(viewer)
            for nonsense in ("", "{", b"\xff\xfe", '{"do":"wind"}', "[]", '"kill"'):
                await viewer.send(nonsense)
            await viewer.send('{"do":"kill","vehicle":2}')
            heard = await one.asked()
            while len(heard) < 2:
                heard += await one.asked()
            assert heard == [{"viewers": 1}, {"do": "kill", "vehicle": 2}]
        assert await one.asked() == [{"viewers": 0}]

    serving(test)


def test_a_message_that_is_too_long_ends_its_viewer_and_nobody_else(tmp_path: Path) -> None:
    async def test(one: Served) -> None:
        one.begin(tmp_path)
        one.row(0.0)
        async with connect(one.stream) as good, connect(one.stream) as bad:
            await told(good)
            await told(bad)
            await bad.send("x" * 100_000)
            await asyncio.wait_for(bad.wait_closed(), 60.0)
            one.row(0.1)
            assert (await told(good))["rows"]

    serving(test)


def test_more_viewers_than_there_are_places_are_told_to_come_later(tmp_path: Path) -> None:
    async def test(one: Served) -> None:
        one.begin(tmp_path)
        one.row(0.0)
        viewers = [await connect(one.stream) for _ in range(VIEWERS_MAX)]
        async with connect(one.stream) as late:
            with pytest.raises(ConnectionClosed) as closed:
                await told(late)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1013
        for viewer in viewers:
            await viewer.close()

    serving(test)


def test_a_viewer_that_does_not_read_keeps_nobody_waiting_and_misses_rows_only(tmp_path: Path) -> None:
    n, rows = 12, 600

    async def times_s(viewer: Any) -> list[float]:
        return [row["time_s"] for row in (await told(viewer)).get("rows", [])]

    async def test(one: Served) -> None:
        one.begin(tmp_path, n)
        one.row(0.0, n=n)
        narrow = socket.socket()
        narrow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        await asyncio.to_thread(narrow.connect, ("127.0.0.1", one.port))
        async with connect(one.stream, sock=narrow, max_queue=1) as stalled, connect(one.stream) as viewer:
            await told(stalled)
            await told(viewer)
            newest_s = 0.0
            for k in range(1, rows + 1):
                assert one.row(0.1 * k, n=n)  # the flight never finds its socket full
                while newest_s < 0.1 * k - 0.01:
                    newest_s = (await times_s(viewer))[-1]
            wire.send(one.end, {"event": {"time_s": 1.0, "kind": "text", "vehicles": [], "text": "ready"}})
            late: list[float] = []
            while not late or late[-1] < 0.1 * rows - 0.01:
                late += await times_s(stalled)
            assert len(late) < rows
            assert late == sorted(set(late))

    serving(test)


def test_a_mission_that_cannot_be_read_ends_the_map_and_not_in_silence(tmp_path: Path) -> None:
    async def test() -> None:
        ours, theirs = wire.pair()
        with ours, theirs, socket.create_server(("127.0.0.1", 0)) as listener:
            running = asyncio.create_task(MapServer(theirs).run(listener))
            files = {"mission": str(tmp_path / "none.toml"), "stems_in": str(tmp_path)}
            wire.send(ours, {"begin": {**files, "title": "", "size": 3, "controls": []}})
            with pytest.raises(ConnectionClosed):
                async with connect(f"ws://127.0.0.1:{listener.getsockname()[1]}/live") as viewer:
                    await told(viewer)
            with pytest.raises(MissionError, match=r"none\.toml"):
                await running

    asyncio.run(asyncio.wait_for(test(), 60.0))


def test_the_end_of_the_flight_is_the_last_that_viewers_are_told(tmp_path: Path) -> None:
    async def test(one: Served) -> None:
        one.begin(tmp_path)
        one.row(0.0)
        viewer = await connect(one.stream)
        await told(viewer)
        wire.send(one.end, {"over": {"verdict": {"text": "ARRIVED", "succeeded": True}}})
        one.end.close()
        assert (await told(viewer))["over"]["verdict"]["text"] == "ARRIVED"
        with pytest.raises(ConnectionClosed):
            await told(viewer)

    serving(test)


def is_closed(client: socket.socket) -> bool:
    """By a reset, where the other end had not read all."""
    try:
        return client.recv(1) == b""
    except ConnectionResetError:
        return True


def test_connections_that_only_hold_on_keep_nobody_out(tmp_path: Path) -> None:
    def hold(one: Served) -> list[socket.socket]:
        sources = [f"127.0.1.{k}" for k in range(1, 3 + CONNECTIONS_MAX // OF_ADDRESS_MAX)]
        held = []
        for source in sources * OF_ADDRESS_MAX:
            held.append(socket.create_connection(("127.0.0.1", one.port), 60.0, (source, 0)))
            held[-1].sendall(b"GET / HTTP/1.1\r\n")
        return held

    async def test(one: Served) -> None:
        one.begin(tmp_path)
        held = await asyncio.to_thread(hold, one)
        assert (await asyncio.to_thread(fetched, one.host))[0] == 200
        async with connect(one.stream) as viewer:
            assert (await told(viewer))["format"] == "understory-live"
        closed = await asyncio.to_thread(lambda: [is_closed(client) for client in held[: len(held) - CONNECTIONS_MAX]])
        assert all(closed)
        for client in held:
            client.close()

    serving(test)

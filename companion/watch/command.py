"""`companion watch`: hear the radio, and show what it says until it is stopped."""

from __future__ import annotations

import argparse
import contextlib
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, Final, Protocol

from companion.keys.key_file import KeyFileError, load_keyring
from companion.keys.keyring import OPERATOR, Keyring
from companion.keys.process import harden_process
from companion.mavlink.peers.session import BASE_ID, Session, open_session
from companion.order.radio import open_operator
from companion.records.signed.keys import mission_hash, record_keys
from companion.shell.links import LinkError
from companion.shell.urls import HEARING_SCHEMES, parse_url
from companion.watch.alarms import alarms
from companion.watch.heard import Heard
from companion.watch.listening_guard import ListeningGuard
from companion.watch.orders.desk import OrderDesk
from companion.watch.orders.order_key import OrderKey
from companion.watch.orders.radio import OrderClerk, OrderingReceiver
from companion.watch.orders.server import OrderServer
from companion.watch.server import Stream, WatchServer
from companion.watch.udp_receiver import UdpReceiver
from mission import __version__
from mission.basemap.chart import Chart, ChartError
from mission.basemap.charts import open_chart
from mission.common.exit_codes import EXIT_BAD_FILE, EXIT_DONE, EXIT_ENVIRONMENT
from mission.common.files import os_words
from mission.common.frames import LocalFrame, enu_to_ned
from mission.common.network import own_addresses
from mission.common.problems import MissionError, printable
from mission.common.signals import Stop
from mission.document.load import load_mission, mission_sha256
from mission.document.model import Mission
from mission.stems.utm import zone_of

UNUSED_BOOT: Final = 1  # nothing is sent
PICTURES_S: Final = 0.25  # four a second: ages in tenths need no more


class RefusedFilesError(Exception):
    """The mission, the key, or both are refused: in lines for the terminal."""


class Receiver(Protocol):
    """The radio, as it is heard."""

    def receive_datagrams(self, wait_s: float) -> Iterator[bytes]:
        """Yield what comes, and wait so long at most for the first."""


Told = Callable[[float], dict[str, Any]]  # of the page, besides what is heard: by the time


def watch(arguments: argparse.Namespace) -> int:
    """Until SIGINT or SIGTERM; the exit code."""
    with ExitStack() as opened:
        try:
            mission, session = _read_files(arguments.mission, arguments.key)
            chart = _chart(arguments.map, arguments.utm)
            if chart is not None:
                opened.callback(chart.close)
            stream = Stream()
            receiver, told, server = _open(arguments, mission, stream, chart, opened)
        except (RefusedFilesError, MissionError) as error:
            return _refused(EXIT_BAD_FILE, error)
        except KeyFileError as error:
            return _refused(EXIT_BAD_FILE, f"companion: --key {error}")
        except (ChartError, ValueError) as error:
            return _refused(EXIT_BAD_FILE, f"companion: {error}")
        except LinkError as error:
            return _refused(EXIT_ENVIRONMENT, f"companion: {error}")
        except OSError as error:
            return _refused(EXIT_ENVIRONMENT, f"companion: {os_words(error)}")
        opened.callback(server.server_close)
        stop = opened.enter_context(Stop())
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        opened.callback(server.shutdown)
        opened.callback(stream.close)
        with contextlib.suppress(OSError):
            print("\n".join([f"watching {arguments.peers}", *_addresses(server)]), flush=True)
        heard = Heard()
        if session is not None and mission is not None:
            heard = Heard(ListeningGuard(session), record_keys(session, mission_hash(mission)))
        still = {"about": about(mission, chart)}
        _listen(heard, receiver, stream, stop, lambda now_s: {**still, **told(now_s)}, mission)
    return EXIT_DONE


def _open(
    arguments: argparse.Namespace, mission: Mission | None, stream: Stream, chart: Chart | None, opened: ExitStack
) -> tuple[Receiver, Told, WatchServer]:
    """The radio, and the page's server. ValueError, KeyFileError, OSError, LinkError."""
    address = arguments.listen
    if not arguments.orders:
        udp_receiver = UdpReceiver(parse_url(str(arguments.peers), HEARING_SCHEMES))
        opened.callback(udp_receiver.close)
        return udp_receiver, lambda _now_s: {"orders": None}, _bound(WatchServer, address, stream, chart)
    if arguments.key is None or mission is None:
        raise ValueError("--orders: needs --key FILE, the operator's, and --mission FILE, the swarm's own")
    size = mission.swarm.size
    operator = open_operator(arguments.key, arguments.mission, size, arguments.peers, opened)
    if operator.trouble:
        _to_stderr(operator.trouble)
    desk = OrderDesk(OrderKey(), size, time.monotonic)
    receiver = OrderingReceiver(operator, OrderClerk(operator.station, size, _to_stdout), desk, _to_stderr)
    server = _bound(partial(OrderServer, desk=desk), address, stream, chart)
    return receiver, lambda now_s: {"orders": receiver.picture(now_s)}, server


def _addresses(server: WatchServer) -> list[str]:
    """Lines for the terminal."""
    if not isinstance(server, OrderServer):
        return own_addresses.lines("open", server.urls)
    return [
        "orders are taken: whoever has a whole address of the first kind can start, hold, land and abort",
        *own_addresses.lines("order at", server.urls),
        *own_addresses.lines("only watch at", server.watch_urls),
    ]


def about(mission: Mission | None, chart: Chart | None) -> dict[str, Any]:
    """Static data of the page: the operator's own files, and nothing from the radio."""
    told: dict[str, Any] = {"version": __version__, "chart": None if chart is None else chart.about.as_dict()}
    if mission is None:
        return {**told, "mission": None}
    assert mission.origin is not None
    frame = LocalFrame(mission.origin.wgs84)
    fence = mission.fence.polygon_enu_m or ()

    def lat_lon_deg(east_m: float, north_m: float, up_m: float = 0.0) -> tuple[float, float]:
        there = frame.to_wgs84(enu_to_ned((east_m, north_m, up_m)))
        return there.lat_deg, there.lon_deg

    return {
        **told,
        "mission": {
            "name": mission.name,
            "vehicles": mission.swarm.size,
            "places": [{"name": name, "at": lat_lon_deg(*at)} for name, at in mission.named_places],
            "fence": [lat_lon_deg(*vertex) for vertex in fence],
            "ground_alt_m": mission.origin.wgs84.alt_m,
        },
    }


def view(heard: Heard, mission: Mission | None, now_s: float) -> dict[str, Any]:
    """Changing data of the page: the picture, how far the records are, and alarms."""
    picture = heard.picture(now_s)
    leader = next((one.leader for one in picture.vehicles if one.acting and one.quorum), 0)
    told = {"harvest": heard.harvest.text(leader), "alarms": [asdict(alarm) for alarm in alarms(picture, mission)]}
    return {**asdict(picture), **told}


def _listen(heard: Heard, receiver: Receiver, stream: Stream, stop: Stop, told: Told, mission: Mission | None) -> None:
    due_s = time.monotonic()
    while not stop.asked:
        now_s = time.monotonic()
        if now_s >= due_s:
            stream.show({**told(now_s), **view(heard, mission, now_s)})
            due_s = now_s + PICTURES_S
        for data in receiver.receive_datagrams(max(0.001, due_s - now_s)):
            read_s = time.monotonic()
            heard.receive_datagram(data, read_s)
            if read_s >= due_s:  # a flood keeps no picture waiting
                break


def _read_files(mission_path: str | None, key: str | None) -> tuple[Mission | None, Session | None]:
    """The mission, and the session of the key. RefusedFilesError: all that is wrong with both."""
    mission, keyring, why = None, None, list[str]()
    try:
        mission = None if mission_path is None else _mission(mission_path)
    except MissionError as error:
        why.append(f"companion: --mission: the mission is refused\n{error}")
    except ValueError as error:
        why.append(f"companion: --mission {error}")
    try:
        keyring = None if key is None else _keyring(key, mission_path)
    except KeyFileError as error:
        why.append(f"companion: --key {error}")
    if why:
        raise RefusedFilesError("\n".join(why))
    if keyring is None or mission_path is None:
        return mission, None
    return mission, open_session(keyring, BASE_ID, bytes.fromhex(mission_sha256(mission_path)), UNUSED_BOOT)


def _keyring(key: str, mission_path: str | None) -> Keyring:
    """KeyFileError."""
    if mission_path is None:
        raise KeyFileError(f"{printable(key)}: needs --mission FILE: the swarm signs for its own mission file")
    harden_process()
    return load_keyring(key, OPERATOR)


def _mission(path: str) -> Mission:
    mission = load_mission(path)
    if mission.origin is None:
        raise ValueError(f"{path}: must have an [origin]: where on Earth is it?")
    return mission


def _chart(path: str | None, utm: str | None) -> Chart | None:
    if path is None:
        if utm is not None:
            raise ValueError(f"--utm {utm}: is for an image that --map names")
        return None
    zone = None if utm is None else zone_of(utm)
    if utm is not None and zone is None:
        raise ValueError(f"--utm {utm}: must be a zone, as 32N or EPSG:32632")
    return open_chart(Path(path), zone)


def _bound(
    server: Callable[..., WatchServer], address: tuple[str, int], stream: Stream, chart: Chart | None
) -> WatchServer:
    try:
        return server(address, stream, chart, say=_to_stderr)
    except OSError as error:
        raise OSError(f"--listen {address[0]}:{address[1]}: {error.strerror}") from None


def _to_stdout(line: str) -> None:
    with contextlib.suppress(OSError):
        print(line, flush=True)


def _to_stderr(line: str) -> None:
    with contextlib.suppress(OSError):
        print(f"companion watch: {line}", file=sys.stderr, flush=True)


def _refused(code: int, why: object) -> int:
    print(why, file=sys.stderr)
    return code

"""The server of `mission edit`: what its page may do, what nobody else may, and what bad requests come to."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mission.cli.main import main
from tests.unit.mission.edit.edit_kit import GOOD, JSON, Client, editing


@pytest.fixture
def client(tmp_path: Path) -> Iterator[Client]:
    with editing(tmp_path / "my.toml") as one:
        one.state()
        yield one


def test_the_address_with_its_token_opens_the_page(client: Client) -> None:
    status, headers, _ = client.ask("GET", f"/?token={client.server.token}", Cookie=None, Origin=None)
    assert (status, headers["Location"]) == (303, "/")
    assert headers["Set-Cookie"] == f"{client.cookie}; HttpOnly; SameSite=Strict; Path=/"
    for path, word in (("/", b"edit.js"), ("/edit.js", b"sources, sha256"), ("/edit.css", b"--ground")):
        status, headers, data = client.ask("GET", path, Origin=None)
        assert (status, word in data) == (200, True)
        assert "connect-src 'self'" in headers["Content-Security-Policy"]
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert headers["Cache-Control"] == "no-store"


@pytest.mark.parametrize(
    "headers",
    [
        {"Cookie": None},
        {"Cookie": "understory-edit-1=guess"},
        {"Cookie": "\x7f=;;"},
        {"Host": "evil.example"},
        {"Host": None},
        {"Host": "localhost"},
    ],
)
@pytest.mark.parametrize("path", ["/", "/state", "/stand", "/flight", "/flight/report.html", "/edit.js"])
def test_nobody_else_sees_anything(client: Client, path: str, headers: dict[str, str | None]) -> None:
    status, _, data = client.ask("GET", path, **headers)
    assert status == 403
    assert b"mine" not in data


@pytest.mark.parametrize(
    "headers",
    [
        {"Cookie": None},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": None},
        {"Host": "evil.example"},
    ],
)
def test_another_page_changes_nothing(client: Client, headers: dict[str, str | None]) -> None:
    body = json.dumps({"revision": client.revision}).encode()
    for path in ("/change", "/save", "/fly", "/reload", "/stems"):
        status, _, _ = client.ask("POST", path, body, **{"Content_Type": JSON, **headers})
        assert status == 403
    assert client.flight.number == 0


@pytest.mark.parametrize("kind", ["text/plain", "application/x-www-form-urlencoded", "multipart/form-data", ""])
def test_a_form_is_no_request(client: Client, kind: str) -> None:
    """Which another page could send without asking the browser first."""
    body = json.dumps({"revision": client.revision}).encode()
    assert client.ask("POST", "/save", body, Content_Type=kind)[0] == 415


def test_each_change_is_checked_with_the_reasons_of_mission_check(
    client: Client, capsys: pytest.CaptureFixture[str]
) -> None:
    changes = [
        ("set", ("swarm", "size"), 40),
        ("set", ("route", "vel_leader_mps"), 99),
        ("set", ("route", "d2_enu_m"), [1, 2]),
        ("set", ("fence", "polygon_enu_m"), [[0, 0], [10, 10], [0, 10], [10, 0]]),
        ("set", ("coverage", "radius_mm"), 3),
    ]
    for change in changes:
        status, told = client.change(change)
        assert status == 200
        assert client.do("/save") == (200, {**client_state(client), "said": "saved: my.toml"})
        assert main(["check", str(client.draft.path), "--json"]) == 2
        (checked,) = json.loads(capsys.readouterr().out)
        assert [{**problem, "text": None} for problem in checked["problems"]] == [
            {**problem, "text": None} for problem in told["state"]["problems"]
        ]
        assert all(problem["text"].startswith(str(client.draft.path)) for problem in told["state"]["problems"])


def client_state(client: Client) -> dict[str, Any]:
    return {"state": client.state()}


def test_notes_and_the_sentence_are_those_of_mission_check(client: Client, capsys: pytest.CaptureFixture[str]) -> None:
    _, told = client.change(("set", ("sensing", "range_m"), 12))
    client.do("/save")
    assert main(["check", str(client.draft.path)]) == 0
    sentence, airtime, *notes = capsys.readouterr().out.splitlines()
    state = told["state"]
    assert state["problems"] == []
    assert state["summary"] == f"{sentence.partition(': ok: ')[2]}; {airtime.strip()}"
    assert state["notes"] == [note.strip() for note in notes]


def test_page_names_what_was_not_read_of_the_stem_map(client: Client) -> None:
    stand = "Baum-Nr;east_m;north_m;BHD [cm];Baumart;Zustand\n1;60,5;20,0;31;Weißtanne;gut\n"
    status, _, told = client.ask(
        "POST", "/stems", stand.encode("cp1252"), X_Name="bestand.csv", Content_Type="application/octet-stream"
    )
    assert status == 200, told
    notes = client.state()["notes"]
    assert "bestand.csv: not read: Zustand" in notes
    assert any("taken for" in note and "not UTF-8" in note for note in notes)


def test_saving_keeps_comments_and_is_said(client: Client) -> None:
    client.change(("set", ("name",), "yours"))
    status, told = client.do("/save")
    assert (status, told["said"], told["state"]["is_saved"]) == (200, "saved: my.toml", True)
    assert client.draft.path.read_text() == GOOD.replace('"mine" #', '"yours" #')


def test_undo_redo_and_reload(client: Client) -> None:
    client.change(("set", ("swarm", "size"), 3))
    assert client.do("/undo")[1]["state"]["fields"]["swarm.size"] == 8
    assert client.do("/redo")[1]["state"]["fields"]["swarm.size"] == 3
    client.draft.path.write_text(GOOD.replace("mine", "theirs"))
    assert client.state()["disk"] == "changed"
    status, told = client.do("/save")
    assert (status, "another program has changed it" in told["refused"]) == (409, True)
    told = client.do("/reload")[1]
    assert (told["state"]["disk"], told["state"]["fields"]["name"]) == ("same", "theirs")
    client.draft.path.write_text("schema = ")
    status, told = client.do("/reload")
    assert (status, "not TOML" in told["refused"]) == (422, True)
    status, told = client.do("/save", over=True)
    assert told["said"] == "saved: my.toml; what the other program wrote is in my.other-1.toml"


def test_two_windows_do_not_change_over_each_other(client: Client) -> None:
    other = client.revision
    client.change(("set", ("swarm", "size"), 3))
    client.revision = other
    status, told = client.change(("set", ("swarm", "size"), 4))
    assert (status, told["state"]["fields"]["swarm.size"]) == (409, 3)
    assert "in another window" in told["refused"]
    assert client.change(("set", ("swarm", "size"), 4))[1]["state"]["fields"]["swarm.size"] == 4


def test_a_destination_on_bare_ground_is_a_hint_and_no_error(
    client: Client, capsys: pytest.CaptureFixture[str]
) -> None:
    stand = b"east_m,north_m,dbh_cm\n60,20,30\n130,0.5,40\n"
    assert client.ask("POST", "/stems", stand, X_Name="s.csv", Content_Type="application/octet-stream")[0] == 200
    hint = "no trunk stands within coverage.keep_out_m = 2 m of d2: the nearest is 8.3 m away"
    assert not [note for note in client.state()["notes"] if "no trunk" in note]
    _, told = client.change(("set", ("route", "d2_enu_m"), [130.0, 9.0, 8.0]))
    assert told["state"]["problems"] == []
    assert hint in told["state"]["notes"]
    client.do("/save")
    assert main(["check", str(client.draft.path)]) == 0
    assert hint in capsys.readouterr().out


def test_a_stem_map_is_put_beside_the_mission(client: Client) -> None:
    data = b"east_m,north_m,dbh_cm\n10,0,30\n130,0,40\n"
    kind = {"Content_Type": "application/octet-stream"}
    status, _, told = client.ask("POST", "/stems", data, X_Name="my%20stand.csv", **kind)
    assert status == 200
    assert json.loads(told)["state"]["values"]["forest"] == {"file": "my stand.csv"}
    assert (client.draft.path.parent / "my stand.csv").read_bytes() == data
    stand = json.loads(client.ask("GET", "/stand")[2])
    assert stand["trees"]["east_m"] == [10.0, 130.0]
    client.state()
    for name, refused in (("..%2Fx.csv", 422), ("x.csv", 422), ("", 422)):
        assert client.ask("POST", "/stems", b"nothing", X_Name=name, **kind)[0] == refused
    assert client.do("/stems", name="absent.csv")[0] == 422
    assert client.do("/stems", name="../my.toml")[0] == 422
    assert sorted(entry.name for entry in client.draft.path.parent.iterdir()) == ["my stand.csv", "my.toml"]


BODIES = [
    b"",
    b"{",
    b"[]",
    b"null",
    b'{"revision": 0}',
    b'{"revision": "0", "changes": []}',
    b'{"revision": 0, "changes": []}',
    b'{"revision": 0, "changes": [{"do": "drop", "path": ["a"]}]}',
    b'{"revision": 0, "changes": [{"do": "set", "path": []}]}',
    b'{"revision": 0, "changes": [{"do": "set", "path": ["a", -1], "value": 1}]}',
    b'{"revision": 0, "changes": [{"do": "set", "path": ["a"], "value": NaN}]}',
    b'{"revision": 0, "changes": [{"do": "set", "path": ["a"], "value": 1, "more": 1}]}',
    b'{"revision": 0, "changes": [{"do": "set", "path": ["a"], "value": ' + b"[" * 5000 + b"]" * 5000 + b"}]}",
    b'{"revision": 0, "changes": [{"do": "set", "path": ["a"], "value": "\\ud800"}]}',
    b"\xff\xfe",
]


@pytest.mark.parametrize("body", BODIES)
def test_a_bad_body_is_refused_in_words_and_changes_nothing(client: Client, body: bytes) -> None:
    status, _, told = client.ask("POST", "/change", body, Content_Type=JSON)
    assert status in (400, 422)
    assert json.loads(told)["refused"]
    assert client.draft.text == GOOD


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=9),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=9), inner, max_size=4),
    max_leaves=8,
)
parts = st.sampled_from(["route", "stops", "swarm", "size", "fence", "polygon_enu_m", "d1_enu_m", "forest", "file", ""])
paths = st.lists(parts | st.integers(0, 3) | st.text(max_size=5), min_size=1, max_size=4)
changes = st.lists(
    st.fixed_dictionaries({"do": st.sampled_from(["set", "insert", "remove"]), "path": paths, "value": values}),
    min_size=1,
    max_size=4,
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150)
@given(changes)
def test_whatever_is_asked_for_is_done_or_refused(client: Client, asked: list[dict[str, Any]]) -> None:
    status, told = client.do("/change", changes=asked)
    assert status in (200, 400, 422), told
    assert ("refused" in told) == (status != 200)
    state = client.state()
    assert isinstance(state["problems"], list)
    client.do("/undo")


@pytest.mark.parametrize("length", [None, "-1", "x", "99999999999", "9" * 5000])
def test_a_body_has_a_length_and_a_limit(client: Client, length: str | None) -> None:
    status, _, _ = client.ask("POST", "/change", b"", Content_Type=JSON, Content_Length=length)
    assert status in (411, 413)


@pytest.mark.parametrize("method", ["PUT", "DELETE", "OPTIONS", "HEAD", "TRACE"])
def test_other_methods_are_none(client: Client, method: str) -> None:
    assert client.ask(method, "/state")[0] == 501


@pytest.mark.parametrize("path", ["/nothing", "/../edit.js", "/edit.html", "/state/", "/bundle/edit.js"])
def test_there_is_nothing_else(client: Client, path: str) -> None:
    assert client.ask("GET", path)[0] == 404
    assert client.ask("POST", path, b"{}", Content_Type=JSON)[0] == 404


def test_a_head_and_its_body_may_come_in_pieces(client: Client) -> None:
    body = json.dumps({"revision": client.revision, "changes": [{"do": "set", "path": ["name"], "value": "y"}]})
    whole = (
        f"POST /change HTTP/1.1\r\nHost: {client.server.host}\r\nOrigin: http://{client.server.host}\r\n"
        f"Cookie: {client.cookie}\r\nContent-Type: {JSON}\r\nContent-Length: {len(body)}\r\n\r\n{body}"
    ).encode()
    for cut in (5, whole.index(b"\r\n\r\n") + 2, whole.index(b"\r\n\r\n") + 6, len(whole) - 1):
        with socket.create_connection(client.server.server_address[:2], timeout=20) as connection:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            connection.sendall(whole[:cut])
            connection.sendall(whole[cut:])
            answer = b"".join(iter(lambda: connection.recv(1 << 16), b""))
        assert answer.split(None, 2)[1] in (b"200", b"409")
    assert client.state()["fields"]["name"] == "y"


def test_without_the_simulator_it_is_said(tmp_path: Path) -> None:
    with editing(tmp_path / "my.toml", find=lambda: None) as client:
        client.state()
        status, told = client.do("/fly")
        assert status == 200
        assert "The simulator is not installed here" in told["flight"]["lines"][-1]
        assert not told["flight"]["is_under_way"]
        assert client.ask("GET", "/flight/report.html")[0] == 404


def test_a_flight_that_cannot_begin_says_why(tmp_path: Path) -> None:
    """The program is there and refuses, as sim-bridge does without its libraries."""
    words = "sim-bridge: jsbsim is not installed"
    program = [sys.executable, "-c", f"import sys; print({words!r}, file=sys.stderr); sys.exit(3)"]
    with editing(tmp_path / "my.toml", find=lambda: program) as client:
        client.state()
        client.do("/fly")
        assert client.flight._process is not None
        assert client.flight._process.wait(20) == 3
        client.flight.stop()
        told = json.loads(client.ask("GET", "/flight")[2])
        assert (told["lines"], told["code"], told["has_report"]) == ([words], 3, False)


def test_stop_and_the_end_of_the_server_end_the_flight(tmp_path: Path) -> None:
    program = [sys.executable, "-c", "print('flying', flush=True); import time; time.sleep(600)"]
    with editing(tmp_path / "my.toml", find=lambda: program) as client:
        client.state()
        client.do("/fly")
        first = client.flight._process
        assert first is not None
        client.do("/stop")
        assert first.poll() is not None
        client.do("/fly")
        second = client.flight._process
        assert second is not None
        assert second.poll() is None
        folder = client.flight._folder
    assert second.poll() is not None
    assert folder is not None
    assert not Path(folder.name).exists()


def test_a_file_that_is_no_mission_is_refused_before_there_is_a_page(tmp_path: Path) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text("schema = \n")
    stems = tmp_path / "stand.txt"
    stems.write_text("")
    for arguments, words in (
        ([str(bad)], "bad.toml:1: not TOML"),
        ([str(tmp_path / "x.csv")], "must be a mission file, which ends in .toml"),
        ([str(tmp_path / "nowhere" / "x.toml")], "its folder is not there"),
        ([str(tmp_path / "x.toml"), "--stems", str(stems)], "must be a stem map that missions can name"),
        ([str(tmp_path / "x.toml"), "--stems", str(tmp_path / "no.csv")], "no such file"),
        ([str(bad), "--stems", str(stems)], "is there already: choose its stem map on the page"),
        ([str(bad), "--port", "99999"], "must be 0 (a free one) to 65535"),
    ):
        done = subprocess.run(
            [sys.executable, "-m", "mission.cli.main", "edit", *arguments], capture_output=True, text=True, check=False
        )
        assert (done.returncode, words in done.stderr) == (2, True), done.stderr

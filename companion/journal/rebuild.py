"""The endpoint of a recorded flight, built of its first entry alone."""

from __future__ import annotations

from pydantic import ValidationError

from companion.journal.channels import UNCHAINED_HEAD, VERSION, WORD_ALONE, Json
from companion.journal.tape.played import PlayedGate, PlayedGuard, PlayedLink, PlayedMarks
from companion.journal.tape.tape import PlayedTape
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.harvest import Survey
from companion.mavlink.makes import load_installed_makes
from companion.mavlink.orders.book import OrderBook
from companion.payload.recorder import payload_of
from companion.sensors.table import kind_of
from companion.survey.of_mission import survey_of
from mission.common.entry_points import EntryPointError
from mission.document.model import Mission


class RebuildError(Exception):
    """This program cannot run the recorded endpoint again, and why."""


def rebuild_endpoint(start: Json, tape: PlayedTape) -> Endpoint:
    """As it began. RebuildError; ModuleNotFoundError: a survey needs numpy."""
    try:
        if start["format"] not in (UNCHAINED_HEAD, WORD_ALONE, VERSION):
            raise RebuildError(f"format {start['format']}: this program reads {UNCHAINED_HEAD} to {VERSION}")
        tells_vouched = start["format"] == VERSION
        if start["flown_by"]:
            raise RebuildError(f"it was flown by {start['flown_by']}, which the log does not hold")
        vehicle_id = int(start["vehicle"])
        load_installed_makes()
        mission = Mission.model_validate(start["mission"])
        survey: Survey | None = survey_of(mission, vehicle_id) if start["has_survey"] else None
        endpoint = Endpoint(
            mission,
            vehicle_id,
            sensors=[kind_of(str(name)).of(mission) for name in start["sensors"]],
            autopilot_is_stream=bool(start["autopilot_is_stream"]),
            sensor_streams={str(name): bool(is_stream) for name, is_stream in start["sensor_streams"].items()},
            guard=None
            if start["guard_flags"] is None
            else PlayedGuard(tape, int(start["guard_flags"]), tells_vouched=tells_vouched),
            orders=None if start["orders"] is None else rebuild_book(start["orders"], vehicle_id, tape),
            autopilot_gate=PlayedGate(tape) if start["autopilot_signed"] else None,
            survey=survey,
            payload=payload_of(mission, vehicle_id),
            records=PlayedLink(tape) if start["has_records"] else None,
        )
        endpoint.agent.ground(str(start["grounded"]))
        endpoint.agent.waive(str(start["waived"]), str(start["unknown"]), unsigned=bool(start["unsigned"]))
    except EntryPointError as error:
        raise RebuildError(f"{error}") from None
    except (KeyError, TypeError, ValueError, AttributeError, ValidationError) as error:
        raise RebuildError(f"its first entry makes no sense: {error}") from None
    return endpoint


def rebuild_book(begun: Json, vehicle_id: int, tape: PlayedTape) -> OrderBook:
    """The book of orders as it began: it checks each order again, by the operator's public key. ValueError."""
    return OrderBook(
        operator=bytes.fromhex(begun["operator"]),
        digest=bytes.fromhex(begun["digest"]),
        me=vehicle_id,
        size=int(begun["size"]),
        boot=int(begun["boot"]),
        marks=PlayedMarks(tape),
        kept=bytes.fromhex(begun["kept"]),
    )

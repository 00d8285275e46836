"""Compares what an autopilot sends: acknowledgements, answers, texts, and how often each message comes.

One function a check, each with the tolerance that it allows.
"""

from __future__ import annotations

from typing import Any

from companion.mavlink import dialect as mav
from sim_bridge.conformance.check import Check, Difference, moved
from sim_bridge.conformance.recording import Frame, Recording
from sim_bridge.conformance.replay import parameter_value

ACK_WITHIN_S = 0.05  # recorded: 0.2-28 ms
RATE_WITHIN = 0.12
COUNT_WITHIN = 2.0  # messages, of slow streams
WINDOW_MIN_S = 1.5  # shorter than this tells no rate
ANSWER_WITHIN_S = 0.1
STAMP_S = 0.02  # two of our steps: between the stamp of what goes in and that of what comes out
TEXT_SEVERITY = mav.MAV_SEVERITY_WARNING  # and graver: refusals, failsafes

_ANSWERS = {
    mav.MAVLINK_MSG_ID_AUTOPILOT_VERSION: "AUTOPILOT_VERSION",
    mav.MAVLINK_MSG_ID_PROTOCOL_VERSION: "PROTOCOL_VERSION",
    mav.MAVLINK_MSG_ID_MISSION_COUNT: "MISSION_COUNT",
    mav.MAVLINK_MSG_ID_MISSION_ACK: "MISSION_ACK",
}
_PARAMETERS = frozenset({mav.MAVLINK_MSG_ID_PARAM_REQUEST_READ, mav.MAVLINK_MSG_ID_PARAM_SET})
_EVENT, _CURRENT_EVENT_SEQUENCE = 410, 411  # PX4's; not in the dialect
_NO_STREAMS = frozenset(
    {
        mav.MAVLINK_MSG_ID_COMMAND_ACK,
        mav.MAVLINK_MSG_ID_COMMAND_LONG,
        mav.MAVLINK_MSG_ID_MESSAGE_INTERVAL,
        mav.MAVLINK_MSG_ID_PARAM_VALUE,
        mav.MAVLINK_MSG_ID_STATUSTEXT,
        _EVENT,
        *_ANSWERS,
    }
)


def commands(recorded: Recording, ours: Recording) -> Check:
    """COMMAND_ACK: command, result, receiver, in order; and how long after the command."""

    def acks(flight: Recording) -> list[str]:
        return [_ack(frame.message) for frame in flight.heard if frame.id == mav.MAVLINK_MSG_ID_COMMAND_ACK]

    want, have = acks(recorded), acks(ours)
    latest_s = _ack_latency_s(ours)
    found = moved(want, have)
    if latest_s > ACK_WITHIN_S:
        found.append(Difference("latency of an ack", f"<= {ACK_WITHIN_S} s", f"{latest_s:.3f} s"))
    same = len(want) - sum(1 for difference in found if difference.recorded != "no")
    latency = f"{_ack_latency_s(recorded) * 1e3:.0f} / {latest_s * 1e3:.0f} ms"
    return Check("commands", f"{same} of {len(want)}, {latency}", tuple(found))


def _ack(message: Any) -> str:
    result = mav.enums["MAV_RESULT"][message.result].name.removeprefix("MAV_RESULT_")
    return f"ack {message.command} {result} to {message.target_system}/{message.target_component}"


def _ack_latency_s(flight: Recording) -> float:
    """The longest from a command to the next ack of that command."""
    worst = 0.0
    acks = [frame for frame in flight.heard if frame.id == mav.MAVLINK_MSG_ID_COMMAND_ACK]
    for sent in flight.sent:
        if sent.id == mav.MAVLINK_MSG_ID_COMMAND_LONG and sent.message.target_system == 1:
            after = (a.at_s - sent.at_s for a in acks if a.message.command == sent.message.command)
            worst = max(worst, min((s for s in after if s >= -ACK_WITHIN_S), default=0.0))
    return worst


def answers(recorded: Recording, ours: Recording) -> Check:
    """PARAM_VALUE to the one that asked (name and value), versions, intervals; HOME_POSITION on request."""
    want, have = _answers(recorded), _answers(ours)
    found = moved(want, have)
    return Check("answers", f"{len(want) - len(found)} of {len(want)}" if want else "-", tuple(found))


def _answers(flight: Recording) -> list[str]:
    asked = {frame.message.param_id for frame in flight.sent if frame.id in _PARAMETERS}
    told: list[str] = []
    for frame in flight.heard:
        message = frame.message
        if frame.id in _ANSWERS:
            told.append(_ANSWERS[frame.id])
        elif frame.id == mav.MAVLINK_MSG_ID_MESSAGE_INTERVAL:
            told.append(f"MESSAGE_INTERVAL {message.message_id} {message.interval_us} us")
        elif frame.id == mav.MAVLINK_MSG_ID_PARAM_VALUE and message.param_id in asked:
            told.append(f"PARAM_VALUE {message.param_id} {parameter_value(flight.personality, message):g}")
    # PX4 tells a value that has been set twice.
    told = [what for index, what in enumerate(told) if index == 0 or what != told[index - 1]]
    homes = [frame.at_s for frame in flight.heard if frame.id == mav.MAVLINK_MSG_ID_HOME_POSITION]
    for sent in flight.sent:
        if _requests(sent, mav.MAVLINK_MSG_ID_HOME_POSITION):
            came = any(0.0 <= at_s - sent.at_s + STAMP_S < ANSWER_WITHIN_S for at_s in homes)
            told.append(f"HOME_POSITION {'when' if came else 'not yet when'} asked for")
    return told


def _requests(frame: Frame, message_id: int) -> bool:
    is_command = frame.id == mav.MAVLINK_MSG_ID_COMMAND_LONG
    request = is_command and frame.message.command == mav.MAV_CMD_REQUEST_MESSAGE
    return bool(request and frame.message.param1 == message_id)


def texts(recorded: Recording, ours: Recording) -> Check:
    """STATUSTEXT of warnings and worse, in order."""
    want, have = _texts(recorded), _texts(ours)
    found = moved(want, have)
    return Check("texts", f"{len(want) - len(found)} of {len(want)}" if want or have else "-", tuple(found))


def _texts(flight: Recording) -> list[str]:
    return [
        frame.message.text.rstrip("\t")
        for frame in flight.heard
        if frame.id == mav.MAVLINK_MSG_ID_STATUSTEXT
        and frame.message.severity <= TEXT_SEVERITY
        and not frame.message.text.startswith("PreArm:")  # repeated twice a minute, heard or not
    ]


def streams(recorded: Recording, ours: Recording) -> Check:
    """Messages per second, by id, before the client asked for other rates and after it."""
    found: list[Difference] = []
    compared: set[int] = set()
    for begin_s, end_s in _windows(recorded):
        want, have = (_counts(flight, begin_s, end_s) for flight in (recorded, ours))
        for message_id in sorted(want.keys() | have.keys()):
            compared.add(message_id)
            expected, seen = want.get(message_id, 0), have.get(message_id, 0)
            if abs(expected - seen) > max(COUNT_WITHIN, RATE_WITHIN * expected):
                span_s = end_s - begin_s
                what = f"{_name(message_id)} from {begin_s:.0f} s"
                if not seen or not expected:
                    what = _name(message_id)
                found.append(Difference(what, f"{expected / span_s:.2f} Hz", f"{seen / span_s:.2f} Hz"))
    unique = {difference.what: difference for difference in found}
    return Check("streams", f"{len(compared) - len(unique)} of {len(compared)}", tuple(unique.values()))


def _windows(recorded: Recording) -> list[tuple[float, float]]:
    asked = [
        frame.at_s
        for frame in recorded.sent
        if frame.id == mav.MAVLINK_MSG_ID_COMMAND_LONG and frame.message.command == mav.MAV_CMD_SET_MESSAGE_INTERVAL
    ]
    booted_s = 2.5
    windows = [(booted_s, asked[0]), (asked[-1] + 1.0, recorded.end_s)] if asked else [(booted_s, recorded.end_s)]
    return [(begin_s, end_s) for begin_s, end_s in windows if end_s - begin_s >= WINDOW_MIN_S]


def _counts(flight: Recording, begin_s: float, end_s: float) -> dict[int, int]:
    counts: dict[int, int] = {}
    for frame in flight.heard:
        if begin_s <= frame.at_s < end_s and frame.id not in _NO_STREAMS:
            counts[frame.id] = counts.get(frame.id, 0) + 1
    return counts


def _name(message_id: int) -> str:
    known = mav.mavlink_map.get(message_id)
    return f"{known.msgname} ({message_id})" if known else f"message {message_id}"

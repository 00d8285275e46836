"""A companion without its sockets: bytes of its links in, bytes out. The same on a board, as a process, in lockstep.

Identity (MAVLink "Companion Computers"): the vehicle's own system id, component 191, MAV_TYPE_ONBOARD_CONTROLLER. The
HEARTBEAT comes from the same `tick` that steers, so it stops when the agent hangs.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final, assert_never

from companion.core.agent import Agent
from companion.core.model.actions import Action, Ask, Say, SendBeacon, SendOdometry, VelocitySetpoint
from companion.core.model.beacon import RelativeReport, TrunkReport
from companion.core.model.events import Answer, AutopilotMode, Event, LidarScan
from companion.core.model.stand import RecordsWaiting, StandMeasured
from companion.core.model.states import BeaconFate, Role, Severity
from companion.core.stages import FLIGHT_STAGES, StageFactory
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink import dialect
from companion.mavlink.autopilot_link.ground_hold import GroundHold
from companion.mavlink.beacon import Decoded
from companion.mavlink.codec import Codec
from companion.mavlink.framing import texts, wire
from companion.mavlink.framing.frames import Framing, Incoming
from companion.mavlink.framing.outbox import Outbox
from companion.mavlink.framing.signing import Gate
from companion.mavlink.harvest import GuardedPayload, GuardedSurvey, Payload, RecordLink, Survey
from companion.mavlink.orders.book import OrderBook
from companion.mavlink.orders.desk import open_desk
from companion.mavlink.peers.guard import Guard, OpenGuard
from companion.mavlink.peers.peers_link import PeersLink
from companion.mavlink.sensor_inputs import SHARED, SensorInputs
from companion.mavlink.sensor_source import SensorSource
from companion.mavlink.streams import FRAME_MESSAGES, STREAMS_HZ, StreamRequests, receiver_hz, reception_counts
from mission.common.frames import LocalFrame, enu_to_ned
from mission.document.model import Mission

COMPONENT = swarm_beacon.COMPONENT
HEARTBEAT_S: Final = 1.0
WAITING_S: Final = 1.0  # between counts of the records that wait: of vectors there is one a second
SYNC_S: Final = 0.25  # between questions for the autopilot's time: a loaded computer's simulator loses 0.4 s within one
REPLIES_LIMIT: Final = 8  # a tick; beyond, the oldest asker asks again
RECEPTION = frozenset({dialect.MAVLINK_MSG_ID_GPS_RAW_INT, dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS})
SETPOINT = dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
TIMESYNC = dialect.MAVLINK_MSG_ID_TIMESYNC
FROM_AUTOPILOT = frozenset(
    {
        *STREAMS_HZ,
        dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
        dialect.MAVLINK_MSG_ID_HEARTBEAT,
        *FRAME_MESSAGES,
        dialect.MAVLINK_MSG_ID_COMMAND_ACK,
        dialect.MAVLINK_MSG_ID_COMMAND_LONG,
        dialect.MAVLINK_MSG_ID_STATUSTEXT,
        TIMESYNC,
    }
)
DATAGRAMS: Final[Mapping[str, bool]] = MappingProxyType({})


class Endpoint:
    """One companion's links: hand in what arrives, then `tick` for what to send. Times are the local clock's, s.

    `sensors`: the vehicle's, by `companion.sensors.table.sensors_of`; their drivers have links of their own.
    """

    def __init__(
        self,
        mission: Mission,
        vehicle_id: int,
        *,
        sensors: Sequence[SensorSource] = (),
        autopilot_is_stream: bool = False,
        sensor_streams: Mapping[str, bool] = DATAGRAMS,
        beacons: swarm_beacon.Reader | None = None,
        stages: StageFactory = FLIGHT_STAGES,
        survey: Survey | None = None,
        payload: Payload | None = None,
        records: RecordLink | None = None,
        guard: Guard | None = None,
        orders: OrderBook | None = None,
        autopilot_gate: Gate | None = None,
    ) -> None:
        """ValueError when the mission has no origin or no such vehicle.

        `sensor_streams`: the links to its sensors' drivers by name, and whether bytes may break anywhere (serial).
        `beacons`: reads those of this mission, shared with other vehicles; by default its own.
        `stages`: of its agent. `survey`: measures stems, `payload`: records other sensors, in a mission that asks for
        it; `records`: keeps what they find.
        `guard`: of the peers' link; by default whoever is in range is heard. `autopilot_gate`: of a signed link.
        `orders`: of the operator's key; by default commands count, and the flags of beacons.
        """
        if mission.origin is None:
            raise ValueError("the mission has no [origin]: a vehicle cannot tell where its d1 and d2 are")
        frame = LocalFrame(mission.origin.wgs84)
        self.orders: Final = open_desk(orders)
        self.agent = Agent(mission, vehicle_id, stages, self.orders.operator)
        ranging = mission.ranging if mission.flies_by_ranges else None
        start = None
        if ranging is not None and not mission.has_satellites(vehicle_id):
            start = enu_to_ned(ranging.start_enu_m[vehicle_id - 1])
        self.codec = Codec(vehicle_id, frame, start_ned_m=start, broadcasts_position=ranging is None)
        self.autopilot_gate: Final = autopilot_gate or Gate(takes_signed=True)  # by wire, or from a simulator
        self.peers: Final = PeersLink(
            vehicle_id,
            beacons or swarm_beacon.Reader(frame),
            guard or OpenGuard(),
            records,
            self.orders,
            ranging=ranging is not None,
            trunks=mission.shares_trunks,
        )
        self.sensors = SensorInputs(sensors, vehicle_id, sensor_streams)
        self.survey: Final = None if survey is None else GuardedSurvey(survey)
        self.payload: Final = None if payload is None else GuardedPayload(payload)
        self.records: Final = records
        reception, fix_hz = reception_counts(mission, vehicle_id), receiver_hz(mission, vehicle_id)
        needed_hz = fix_hz, self.sensors.autopilot_hz
        self._requests = StreamRequests(self.codec, needed_hz, self.report_surroundings, reception=reception)
        self._ground_hold = GroundHold(self.codec, self.report_surroundings)
        wanted = FROM_AUTOPILOT | self.sensors.forwarded | frozenset(self.sensors.autopilot_hz)
        wanted |= RECEPTION if reception else frozenset(fix_hz)
        self.autopilot = Framing(wanted, is_stream=autopilot_is_stream)
        self._decoders = self._decoder_table()
        self.requested_ns: int | None = None  # time of a TIMESYNC request, for `--clock vehicle` to take
        self._to_autopilot = wire.Sender(vehicle_id, COMPONENT)
        self._to_sensor = wire.Sender(vehicle_id, COMPONENT)
        self._text_id = 0  # of the last text said
        self._aside: list[bytes] = []  # datagrams behind this tick's beacon
        self._to_say: list[Say] = []  # with the next tick; at most a few
        self._versions_told: set[int] = set()  # vehicles of this swarm whose beacons are of another version
        self._heartbeat_s: float | None = None
        self._counted_s = -math.inf  # records that wait
        self._synced_s: float | None = None
        self._replies: deque[Any] = deque(maxlen=REPLIES_LIMIT)  # messages; an int: a TIMESYNC request's ts1
        self._heard: dict[tuple[int, BeaconFate], int] = {}  # as in Outbox, since the last tick
        self._foreign: set[int] = set()  # autopilots of other vehicles heard on this link

    @property
    def id(self) -> int:
        """The vehicle's system id."""
        return self.codec.vehicle_id

    # --- in ---

    def from_autopilot(self, data: bytes, now_s: float) -> None:
        """Bytes of the autopilot's link, which arrive at `now_s`."""
        self.autopilot_says(self.read_autopilot(data), now_s)

    def read_autopilot(self, data: bytes) -> list[Incoming]:
        """Messages that the autopilot's gate admits; nothing is remembered of them before `autopilot_says`."""
        return [
            incoming for incoming in self.autopilot.read_messages(data) if self.autopilot_gate.admits(incoming.frame)
        ]

    def autopilot_says(self, messages: Iterable[Incoming], now_s: float) -> None:
        """Messages that `read_autopilot` returned, which arrive at `now_s`."""
        for incoming in messages:
            m, message_id = incoming.message, incoming.message_id
            system, component = incoming.system, incoming.component
            if message_id == dialect.MAVLINK_MSG_ID_COMMAND_LONG:
                self._operator(m, (system, component), now_s)
            elif message_id in self.sensors.forwarded:
                self._receive(self.sensors.read_forwarded(incoming, now_s), now_s)
            elif component != dialect.MAV_COMP_ID_AUTOPILOT1:
                continue
            elif system == self.id:
                self._own_autopilot_says(message_id, m, now_s)
            elif message_id == dialect.MAVLINK_MSG_ID_HEARTBEAT and m.autopilot != dialect.MAV_AUTOPILOT_INVALID:
                self._foreign.add(system)

    @property
    def foreign_autopilots(self) -> frozenset[int]:
        """System ids of other vehicles' autopilots on this link: a wrong `--id`, or a shared port."""
        return frozenset(self._foreign)

    def from_sensor(self, data: bytes, now_s: float, link: str = SHARED) -> None:
        """Bytes of a link to sensors' drivers, which arrive at `now_s`. Any of them may send on any of these links."""
        for event in self.sensors.read_link(link, data, now_s):
            self.agent.receive(event, now_s)

    def from_peers(self, data: bytes, now_s: float) -> None:
        """A datagram of the swarm's radio, which arrives at `now_s`."""
        for word in self.peers.read_datagram(data, now_s):
            match word:
                case RelativeReport() | TrunkReport():
                    self.agent.receive(word, now_s)
                case sender, decoded:
                    key = sender, self._receive_beacon(sender, decoded, now_s)
                    self._heard[key] = self._heard.get(key, 0) + 1
        if self.peers.guard.cloned and not self.agent.flight.grounded:
            self.agent.ground(f"another companion flies as vehicle {self.id}")

    def _receive_beacon(self, sender: int, decoded: Decoded, now_s: float) -> BeaconFate:
        beacon = self.codec.beacon(decoded)
        if beacon is not None:
            return self.agent.receive_beacon(beacon, now_s)
        if decoded.version == swarm_beacon.VERSION:
            return BeaconFate.INVALID
        self._tell_version(sender, decoded.version)
        return BeaconFate.VERSION

    def _tell_version(self, sender: int, version: int) -> None:
        """Once for each vehicle of this swarm: it is not kept clear of."""
        if self.agent.swarm.has(sender) and sender not in self._versions_told:
            self._versions_told.add(sender)
            self._to_say.append(_other_version(sender, version))

    def report_surroundings(self, say: Say) -> None:
        """A word for the operator of what is around this companion, its links: told with the next tick."""
        self._to_say.append(say)

    def _decoder_table(self) -> dict[int, Callable[[Any], Event | None]]:
        """The own autopilot's messages by id -> what makes an event of the core of each."""
        return {
            dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED: self.codec.position,
            dialect.MAVLINK_MSG_ID_HEARTBEAT: self._recognise,
            dialect.MAVLINK_MSG_ID_SYS_STATUS: self.codec.health,
            dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: self.codec.landed,
            dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT: self.codec.ekf,
            dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS: self.codec.estimator,
            dialect.MAVLINK_MSG_ID_GPS_RAW_INT: self.codec.satellites,
            dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: self.codec.origin,
            dialect.MAVLINK_MSG_ID_HOME_POSITION: self.codec.home,
            dialect.MAVLINK_MSG_ID_COMMAND_ACK: self._answer,
            dialect.MAVLINK_MSG_ID_STATUSTEXT: self.codec.text,
        }

    def _own_autopilot_says(self, message_id: int, m: Any, now_s: float) -> None:
        self._requests.note_message(message_id, now_s)
        decode = self._decoders.get(message_id)
        if decode is not None:
            self._receive(decode(m), now_s)
        elif message_id == TIMESYNC:
            self._take_timesync(m, now_s)
        if message_id in self.sensors.autopilot_hz:
            self.sensors.read_autopilot(message_id, m, now_s)

    def _receive(self, event: Event | None, now_s: float) -> None:
        if event is not None:
            self.agent.receive(event, now_s)

    def _take_timesync(self, m: Any, now_s: float) -> None:
        if m.tc1 == 0:
            self.requested_ns = m.ts1
            self._replies.append(m.ts1)
        else:
            self._receive(self.codec.boot_time(m, now_s), now_s)

    def _answer(self, m: Any) -> Answer | None:
        mine = m.target_system in (0, self.id) and m.target_component in (0, COMPONENT)
        return self.codec.answer(m) if mine else None

    def _recognise(self, m: Any) -> AutopilotMode | None:
        before = self.codec.make
        event = self.codec.mode(m)
        if self.codec.make is not before:
            self._requests.change_make(self.codec.make)
        return event

    def _operator(self, m: Any, sender: tuple[int, int], now_s: float) -> None:
        """COMMAND_LONG for this companion, forwarded by the autopilot. `sender`: system and component."""
        if m.target_system != self.id or m.target_component != COMPONENT:
            return
        result, order = self.orders.command(m)
        self._receive(order, now_s)
        self._replies.append(dialect.MAVLink_command_ack_message(m.command, result, 0, 0, *sender))

    # --- out ---

    def tick(self, now_s: float) -> Outbox:
        """One tick of the agent; its setpoint comes after its requests, and TIMESYNC answers last."""
        out, self._heard = Outbox(heard=self._heard), {}
        pack = self._to_autopilot.pack
        to_autopilot: list[bytes] = []
        to_peers: list[bytes] = []
        if self._heartbeat_s is None or now_s - self._heartbeat_s >= HEARTBEAT_S:
            self._heartbeat_s = now_s
            to_autopilot.append(pack(heartbeat()))
            if self.sensors.sources:
                out.sensor = self._to_sensor.pack(heartbeat())
        to_autopilot += map(pack, self._requests.missing(now_s))
        to_autopilot += map(pack, self._ground_hold.asks(self.agent.flight, now_s))
        self._ask_for_time(now_s, to_autopilot)
        self._take_scans(now_s)
        for order in self.orders.tick(self.agent, now_s):
            self.agent.receive(order, now_s)
        for action in (*self._to_say, *self.agent.tick(now_s)):
            self._encode(action, now_s, to_autopilot, to_peers, out.said)
        self._to_say.clear()
        self._reply(now_s, to_autopilot)
        out.autopilot = b"".join([self.autopilot_gate.seal(frame, now_s) for frame in to_autopilot])
        out.peers = b"".join([*to_peers, *self.peers.prove(now_s)])
        aside, self._aside = self._aside, []
        sent = len(out.peers) + sum(map(len, aside))
        out.records = [*self.peers.send_orders(now_s), *aside, *self.peers.send_records(now_s, sent)]
        self._to_say += self.peers.take_says()
        for liar in self.peers.guard.take_liars():
            self.agent.swarm.block(liar, "vouches for what it denies to others")
        return out

    def _take_scans(self, now_s: float) -> None:
        """Hands on the scans since the last tick; a survey measures stems by them."""
        survey = self.survey
        if survey is not None:
            survey.begin_tick(self.agent, now_s)
        for event in self.sensors.collect(now_s):
            self.agent.receive(event, now_s)
            if survey is not None and isinstance(event, LidarScan):
                survey.integrate(event, now_s)
        if survey is not None and self.records is not None:
            for kind, body in survey.take_records(now_s):
                self.records.append(kind, body, now_s)
        if survey is not None:
            self._to_say += survey.take_says()
        payload = self.payload
        if payload is not None and self.records is not None:
            for kind, body in payload.take_records(self.agent, self.sensors.take_values, now_s):
                self.records.append(kind, body, now_s)
            self._to_say += payload.take_says()
        if self.records is not None:
            if self.agent.rise.is_allowed and now_s - self._counted_s >= WAITING_S:
                self._counted_s = now_s
                self.agent.receive(RecordsWaiting(self.records.count_waiting()), now_s)
            update = self.records.take_stand(leads=self.agent.swarm.election.role is Role.LEADER, now_s=now_s)
            if update is not None:
                self.agent.receive(StandMeasured(update.basal_area_pct), now_s)
                self._to_say += [Say(Severity.INFO, f"stand: {update.text}")] if update.text else []

    def take_returns(self) -> list[bytes]:
        """Returns of stems that a survey has fitted, since last asked: for a file, where there is one."""
        return [] if self.survey is None else self.survey.take_returns()

    def hello(self) -> bytes:
        """A HEARTBEAT to send before the first tick, so that the other end learns this companion's address."""
        return self.autopilot_gate.seal(wire.pack(heartbeat(), seq=0, system=self.id, component=COMPONENT), 0.0)

    def _encode(
        self, action: Action, now_s: float, to_autopilot: list[bytes], to_peers: list[bytes], said: list[Say]
    ) -> None:
        match action:
            case VelocitySetpoint():
                setpoint = self.codec.setpoint(action.vel_ned_mps, action.yaw_rad, int(now_s * 1e3) & 0xFFFFFFFF)
                to_autopilot.append(self._to_autopilot.frame(SETPOINT, setpoint))
            case SendBeacon():
                payload = self.codec.encode_beacon(action.beacon, action.pos_ned_m, action.off_ned_m)
                if payload is not None:
                    to_peers += self.peers.send_beacon(action.beacon, payload, action.word, now_s)
                    if action.trunks is not None:
                        self._aside.append(self.peers.send_trunks(action.trunks, now_s))
            case Ask(request, altitude_m):
                assert self.codec.make is not None  # nothing is asked of an unknown autopilot
                command, parameters = self.codec.make.command(request, self.codec.altitude(altitude_m))
                to_autopilot.append(self._to_autopilot.pack(self.codec.command(command, *parameters)))
            case SendOdometry():
                odometry = self.codec.odometry(action.vel_ned_mps, _nanoseconds(now_s) // 1000)
                to_autopilot.append(self._to_autopilot.pack(odometry))
            case Say(severity, text):
                said.append(action)
                self._text_id = self._text_id % texts.ID_MAX + 1
                to_autopilot += map(self._to_autopilot.pack, texts.encode(severity, text, self._text_id))
            case _:
                assert_never(action)

    def _ask_for_time(self, now_s: float, to_autopilot: list[bytes]) -> None:
        """A TIMESYNC request, not with the first tick: a vehicle's time of 0 would answer with another request."""
        if self._synced_s is not None and now_s - self._synced_s < SYNC_S:
            return
        first, self._synced_s = self._synced_s is None, now_s
        if not first:
            to_autopilot.append(self._timesync(0, _nanoseconds(now_s)))

    def _timesync(self, tc1_ns: int, ts1_ns: int) -> bytes:
        return self._to_autopilot.frame(TIMESYNC, self.codec.timesync(tc1_ns, ts1_ns))

    def _reply(self, now_s: float, to_autopilot: list[bytes]) -> None:
        for reply in self._replies:
            time = isinstance(reply, int)
            to_autopilot.append(self._timesync(_nanoseconds(now_s), reply) if time else self._to_autopilot.pack(reply))
        self._replies.clear()


def _other_version(sender: int, version: int) -> Say:
    return Say(Severity.WARNING, f"vehicle {sender} beacon version {version}, not {swarm_beacon.VERSION}: ignored")


def _nanoseconds(now_s: float) -> int:
    """For TIMESYNC: not 0, which would be a request, and within an int64."""
    return min(max(1, int(now_s * 1e9)), (1 << 63) - 1)


def heartbeat() -> Any:
    """HEARTBEAT of an onboard computer."""
    return dialect.MAVLink_heartbeat_message(
        dialect.MAV_TYPE_ONBOARD_CONTROLLER, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, 3
    )

"""Texts of `companion --help`: the program and of each command."""

ABOUT = """\
Flight software for one vehicle of a swarm. It runs on the vehicle's companion computer, is linked to the
vehicle's autopilot (MAVLink) and to the companions of the other vehicles, and steers together with them.
"""

EXAMPLE = """\
vehicle 3, its autopilot on a serial port, the others on a mesh network:
  companion run --mission forest.toml --id 3 \\
      --autopilot serial:///dev/ttyAMA0:921600 --peers udpbcast://192.168.4.255:14660 \\
      --key vehicle-3.key --preflight vehicle3.json

`companion run --help` explains the options.
"""

RUN = """\
Flies one vehicle's part of a mission. Nothing is armed before an operator starts the mission, and before
`companion preflight` has passed (--preflight, --waive). A companion that is started again in flight flies on.

A companion that is stopped (Ctrl-C, SIGTERM, a crash) commands nothing more: the autopilot notices that
setpoints have ended, and its own offboard-loss failsafe holds or lands the vehicle. Stopping is thus safe at
any time, and a companion that is started again rejoins the swarm.
"""

RUN_MORE = """\
where a link goes (URL):
  serial:///dev/ttyX:BAUD      a serial port; autopilot and sensors only
  udpin://HOST:PORT            wait at this computer's address HOST for one other end: the first that
                               speaks there, until it has been silent for 3 s; sensors: all are heard
  udpout://HOST:PORT           send to HOST:PORT, receive only from there
  udpbcast://BROADCAST:PORT    send to all of a network, hear all of it; peers only
Only the interface that is named is used, and there is no default. HOST is a name or an IPv4 address.

the clock:
  monotonic   this computer's clock, 20 ticks a second: for every real flight
  vehicle     one tick for each TIMESYNC request of the autopilot, whose time is the clock: for simulators
              that run faster or slower than real time. They must ask 20 times per second of their time.

A serial device that is not there, as one on USB early at boot, is waited for; the log says so.

exit codes: 0 stopped by SIGINT or SIGTERM, 1 broken invariant (traceback in the log), 2 wrong usage or a bad
mission, 3 a port, a device or a file cannot be opened
"""

PREFLIGHT = """\
Checks one vehicle for one mission before its flight: the autopilot's failsafe parameters under a canopy, its
fence, readiness, GPS, battery, home and link; this computer's clock, key and disk. One table, one verdict.
Nothing is changed without --apply, and nothing is armed.
"""

PREFLIGHT_MORE = """\
No `companion run` may use the links at the same time. It takes about 10 seconds, longer where parameters
do not exist. What is checked and why: docs/how-to/preflight.md.

exit codes: 0 pass, 1 fail, 2 wrong usage or a bad mission, 3 the link cannot be opened, or no autopilot is heard
"""

DOCTOR = """\
Looks for what keeps a companion from working on this computer: serial ports, groups and permissions, the links and
which program has their UDP ports if they are given, time, disk, versions, power, service. Each problem comes with its
fix.
"""

DOCTOR_MORE = """\
It changes nothing. On the autopilot's link it sends heartbeats only, so that an autopilot that waits for a partner
answers; end `companion run` first where it has the port.

exit codes: 0 no problem, 1 problems, 2 wrong usage
"""

WATCH = """\
Hears the beacons of a swarm and shows, on a page for a tablet, what they say and how old it is: where each
vehicle was last heard, which one leads, what nobody knows. It sends nothing to any vehicle, and cannot steer; but with
--orders, where the page has buttons for START, HOLD, LAND and ABORT, as `companion order` gives them.
"""

WATCH_MORE = """\
The address that it prints holds a token; without it nobody is let in. With --orders one of them also ends with a key:
whoever has that address orders. docs/how-to/watch-in-the-field.md says what this stands against. Ends with Ctrl-C.
exit codes: 0 ended by SIGINT or SIGTERM, 2 wrong usage or a bad file, 3 a port that cannot be opened
"""

STAND = """\
Makes a stand of the records of a survey: observations of one stem by several vehicles become one stem, and stems
figures per hectare with intervals of 95 %. Writes a stem map (GeoPackage, GeoJSON, CSV), the figures, the raw records
and a report of one page.
"""

CLOUD = "files of returns off the vehicles' disks (records-ID-MISSION.returns): a point cloud of them, cloud.laz"

STAND_MORE = """\
The same records give the same files, whichever order they came in. docs/how-to/read-the-stand-report.md says how to
read them.

exit codes: 0 written, 2 wrong usage, a bad mission or a bad store, 3 a file that cannot be written, or numpy
and scipy are not installed
"""

LIDAR = """\
Reads a lidar by its own protocol, and sends what it sees to the companion of the same vehicle, as obstacle sensors
do: MAVLink's OBSTACLE_DISTANCE, the nearest of each of 72 sectors of 5 degrees, or with --raw every ray
(SWARM_LIDAR_SCAN). It runs beside `companion run`.
"""

LIDAR_MORE = """\
The companion hears it with --sensor obstacles=udpin://127.0.0.1:14570. (--mask=-10..10 is across the nose.)

A lidar that is unplugged is waited for. docs/how-to/connect-a-lidar.md has wiring, mounting and the check.

exit codes: 0 ended by SIGINT or SIGTERM, or the check has passed, 1 the check has not, 2 wrong usage, 3 a port that
cannot be opened, or a check in which nothing is received, 130 a check ended by SIGINT or SIGTERM
"""

BASE = """\
Hears a swarm that surveys, stores its records, and acknowledges what is on its disk: only then may a vehicle
delete them. It steers nothing. It may be stopped and started again at any time: nothing comes twice, nothing is
left out.
"""

BASE_MORE = """\
It shows how many records there are, as far as the vehicles have told it, and how many it has:
  412 of 430 records delivered, vehicles 1, 2, 5 in range; 3, 4 out of range: may hold more
Ends with Ctrl-C. docs/how-to/collect-records.md has more.

exit codes: 0 ended by SIGINT or SIGTERM, 2 wrong usage or a bad file, 3 a port or a file that cannot be opened
"""
EXAMPLES = {
    "order": (
        "companion order start --key fleet/operator.key --mission forest.toml \\\n"
        "      --peers udpbcast://192.168.4.255:14660",
        "companion order abort --key fleet/operator.key --mission forest.toml \\\n"
        "      --peers udpbcast://192.168.4.255:14660",
    ),
    "order start": (
        "companion order start --key fleet/operator.key --mission forest.toml \\\n"
        "      --peers udpbcast://192.168.4.255:14660",
        "companion order start --key fleet/operator.key --mission forest.toml \\\n"
        "      --peers udpbcast://192.168.4.255:14660 --hand-back 3",
    ),
    "order hold": (
        "companion order hold --key fleet/operator.key --mission forest.toml \\\n"
        "      --peers udpbcast://192.168.4.255:14660",
        "companion order hold --key fleet/operator.key --mission forest.toml \\\n"
        "      --peers udpbcast://192.168.4.255:14660 --for-s 60",
    ),
    "order land": (
        "companion order land --key fleet/operator.key --mission forest.toml \\\n"
        "      --peers udpbcast://192.168.4.255:14660",
        "companion order land --key fleet/operator.key --mission forest.toml \\\n"
        "      --peers udpbcast://192.168.4.255:14660 --for-s 60",
    ),
    "order abort": (
        "companion order abort --key fleet/operator.key --mission forest.toml \\\n"
        "      --peers udpbcast://192.168.4.255:14660",
        "companion order abort --key fleet/operator.key --mission forest.toml \\\n"
        "      --peers udpbcast://192.168.4.255:14660 --for-s 60",
    ),
    "order gateway": (
        "companion order gateway --key fleet/operator.key --mission forest.toml \\\n"
        "      --peers udpbcast://192.168.4.255:14660 --ground-station udpin://127.0.0.1:14590",
        "companion order gateway --key fleet/operator.key --mission forest.toml \\\n"
        "      --peers udpbcast://192.168.4.255:14660 --ground-station udpout://127.0.0.1:14550",
    ),
    "key": ("companion key new fleet --vehicles 5", "companion key show-id fleet/vehicle-3.key"),
    "key new": ("companion key new fleet --vehicles 5", "companion key new /media/safe/forest --vehicles 12"),
    "key show-id": (
        "companion key show-id fleet/vehicle-3.key",
        "companion key show-id /etc/understory/vehicle.key",
    ),
    "key autopilot": (
        "companion key autopilot fleet/vehicle-3.key --out autopilot-3.passphrase",
        "companion key autopilot /etc/understory/vehicle.key --out /media/safe/autopilot-3.passphrase",
    ),
    "key rotate": ("companion key rotate fleet", "companion key rotate fleet --finish"),
    "key revoke": ("companion key revoke fleet 3", "companion key revoke /media/safe/forest 12"),
    "base": (
        "companion base forest.toml --key fleet/operator.key --listen udpbcast://192.168.4.255:14660 \\\n"
        "      --records forest.db",
        "companion base forest.toml --unsigned --listen udpin://0.0.0.0:14660 --records forest.db",
    ),
    "stand": (
        "companion stand forest.db --mission forest.toml --out stand",
        "companion stand forest.db --mission forest.toml --out stand --form-height-m 11.5",
        "companion stand forest.db --mission forest.toml --out stand --cloud disks/records-*.returns",
    ),
    "run": (
        "companion run --mission forest.toml --id 3 --autopilot serial:///dev/ttyAMA0:921600 \\\n"
        "      --peers udpbcast://192.168.4.255:14660 --key vehicle-3.key --preflight vehicle3.json",
        "companion run --mission forest.toml --id 1 --autopilot udpin://127.0.0.1:14540 \\\n"
        "      --peers udpbcast://127.255.255.255:14660 --clock vehicle --waive all --unsigned",
    ),
    "replay": (
        "companion replay /var/lib/understory/black-box",
        "companion replay runs/my-flight/black-box/vehicle-3-flight-0001-0001.mcap --from 40 --to 42 --ticks",
    ),
    "preflight": (
        "companion preflight --mission forest.toml --id 3 --autopilot serial:///dev/ttyAMA0:921600",
        "companion preflight --mission forest.toml --id 3 --autopilot serial:///dev/ttyAMA0:921600 \\\n"
        "      --apply --report vehicle3.json",
    ),
    "doctor": (
        "companion doctor",
        "companion doctor --autopilot serial:///dev/ttyAMA0:921600 --peers udpbcast://192.168.4.255:14660",
    ),
    "watch": (
        "companion watch --peers udpbcast://192.168.4.255:14660",
        "companion watch --peers udpbcast://192.168.4.255:14660 --listen 192.168.4.10 --map forest.mbtiles",
        "companion watch --peers udpbcast://192.168.4.255:14660 --listen 192.168.5.10 --mission forest.toml \\\n"
        "      --key fleet/operator.key --orders",
    ),
    # an LD19 that hangs below vehicle 3 with its cable to the front, two legs in its way
    "lidar": (
        "companion lidar --model ld19 --lidar serial:///dev/ttyUSB0:230400 --upside-down --yaw-deg 180 \\\n"
        "      --mask 130..140,220..230 --check",
        "companion lidar --model ld19 --lidar serial:///dev/ttyUSB0:230400 --upside-down --yaw-deg 180 \\\n"
        "      --mask=-10..10 --id 3 --to udpout://127.0.0.1:14570",
    ),
}

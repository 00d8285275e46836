"""Options of `sim-bridge export`."""

from __future__ import annotations

import argparse
from pathlib import Path

WHAT = {
    "mcap": "poses, links, setpoints, roles, phases, trunks, scans and texts, for Foxglove and Lichtblick",
    "rrd": "the same but for scans, for the viewer of Rerun; wants the extra [rerun]",
    "kml": "tracks in time, places, fence and trunks, for Google Earth and QGIS",
    "gpx": "tracks in time and places, for map programs",
    "geojson": "tracks, places, fence and trunks, for GIS and web maps",
}
BAG = "ros2bag"
NAME = "flight"  # of each file, in the run folder


def configure(parser: argparse.ArgumentParser) -> None:
    """Options of `sim-bridge export`."""
    parser.add_argument("folder", type=Path, metavar="RUN", help="run folder of a flight")
    for kind, what in WHAT.items():
        parser.add_argument(f"--{kind}", action="store_true", help=f"{NAME}.{kind}: {what}")
    bag = "rosbag2 (MCAP) with odometry, scans, battery, setpoints and tf of each vehicle; wants the extra [ros2]"
    parser.add_argument(f"--{BAG}", type=Path, metavar="DIR", help=f"new folder: a {bag}")
    parser.add_argument("--out", type=Path, metavar="DIR", help="existing folder to write into (the run folder)")

"""`python -m sim_bridge.conformance`."""

from __future__ import annotations

import argparse
import sys

from sim_bridge.conformance import __doc__ as purpose
from sim_bridge.conformance import run
from sim_bridge.options.conformance import configure

parser = argparse.ArgumentParser(prog="python -m sim_bridge.conformance", description=purpose, allow_abbrev=False)
configure(parser)
sys.exit(run(parser.parse_args()))

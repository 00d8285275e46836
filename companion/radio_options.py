"""The options of keys, of the commands that have a radio or an autopilot."""

from __future__ import annotations

import argparse


def add_run_keys(run: argparse.ArgumentParser) -> None:
    """Of `run`."""
    _add_key(
        run,
        "this vehicle's key file, by which its radio is signed and orders are the operator's (`companion key`)",
        "without a key, as in the simulator: whoever is in radio range can start, lead and land it; log, service and "
        "ground station are told",
    )
    run.add_argument(
        "--sign-autopilot",
        action="store_true",
        help="sign the autopilot's link by --key, and refuse what comes by it unsigned (docs/how-to/"
        "sign-the-autopilot-link.md)",
    )


def add_preflight_keys(preflight: argparse.ArgumentParser) -> None:
    """Of `preflight`."""
    preflight.add_argument("--key", metavar="FILE", help="this vehicle's key file, to be checked")
    preflight.add_argument(
        "--sign-autopilot",
        action="store_true",
        help="by a link that is signed by --key: see that the autopilot signs, and refuses who has no key; with "
        "--apply give it the key, by a wire that nobody else hears",
    )


def add_base_keys(base: argparse.ArgumentParser) -> None:
    """Of `base`."""
    _add_key(base, "the operator's key file", "without a key, as in the simulator: of a swarm whose radio is unsigned")


def _add_key(command: argparse.ArgumentParser, key: str, unsigned: str) -> None:
    """Either is needed; the command itself says so, with how to make a key."""
    either = command.add_mutually_exclusive_group()
    either.add_argument("--key", metavar="FILE", help=key)
    either.add_argument("--unsigned", action="store_true", help=unsigned)

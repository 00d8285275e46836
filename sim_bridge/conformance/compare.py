"""Compares what a client sees of two flights."""

from __future__ import annotations

from collections.abc import Callable

from sim_bridge.conformance import messages, motion
from sim_bridge.conformance.check import Check
from sim_bridge.conformance.recording import Recording

CHECKS: tuple[Callable[[Recording, Recording], Check], ...] = (
    messages.commands,
    messages.answers,
    motion.heartbeats,
    motion.landed_states,
    messages.streams,
    messages.texts,
    motion.takeoff,
    motion.setpoint_loss,
    motion.landing,
)


def compare(recorded: Recording, ours: Recording) -> list[Check]:
    """Every check, in the order of the table."""
    return [check(recorded, ours) for check in CHECKS]

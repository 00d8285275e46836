"""Forms in which simulated faults are written on a command line."""

from __future__ import annotations

from mission.schema.kinds import FaultKind, FaultPhase

LEADER = "leader"  # instead of ids: the vehicle that leads then
# Kind -> forms of its option, an example, and what it does
OPTIONS = {
    FaultKind.KILL: (("VEHICLES@WHEN",), "leader@40", "a companion is killed"),
    FaultKind.RESTART: (
        ("VEHICLES@WHEN:SECONDS",),
        "2@30:1",
        "a companion is killed, and started again after so long",
    ),
    FaultKind.STOP: (("VEHICLES@WHEN:SECONDS",), "2@30:3", "a companion is stopped for so long"),
    FaultKind.PARTITION: (
        ("VEHICLES@WHEN:SECONDS",),
        "1,2,3@60:100",
        "for so long, these and the others do not hear one another",
    ),
    FaultKind.LATE: (
        ("VEHICLES@WHEN:LATE", "VEHICLES@WHEN:LATE:SECONDS"),
        "2@40:1.5",
        "what an autopilot tells its companion comes LATE seconds later, in order (with :SECONDS, for so long)",
    ),
    FaultKind.BLIND: (
        ("VEHICLES@WHEN", "VEHICLES@WHEN:SECONDS"),
        "2@40:1.5",
        "an obstacle sensor tells its companion nothing (with :SECONDS, for so long)",
    ),
    FaultKind.WIND: (
        ("VEHICLES@WHEN:EAST:NORTH", "VEHICLES@WHEN:EAST:NORTH:SECONDS"),
        "1,2,3@40:4:-3",
        "the air about vehicles moves to the east and north, m/s (with :SECONDS, for so long)",
    ),
}
GRAMMAR = (
    f"VEHICLES: {LEADER} (that acts as such then, or first after it), or ids as 1,2,3. WHEN: seconds, the phase that "
    f"begins ({', '.join(phase.value for phase in FaultPhase)}), or PHASE+SECONDS."
)

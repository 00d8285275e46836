"""A battery that empties with the throttle. Any personality's."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class BatterySpec:
    """The battery that is fitted. The currents give about 20 minutes of hover at half throttle with 5 Ah."""

    capacity_mah: float = 5000.0
    remaining: float = 1.0  # at boot, 0..1
    cells: int = 4
    idle_a: float = 0.5  # the electronics
    full_throttle_a: float = 40.0
    cell_full_v: float = 4.05  # PX4's BAT1_V_CHARGED
    cell_empty_v: float = 3.6  # BAT1_V_EMPTY

    def __post_init__(self) -> None:
        """ValueError for what cannot be a battery."""
        if not self.capacity_mah > 0.0 or self.cells < 1 or not 0.0 <= self.remaining <= 1.0:
            raise ValueError(f"{self}: capacity_mah must be > 0, cells >= 1, remaining 0..1")


class Battery:
    """State of charge by counting current; the voltage is linear in it."""

    def __init__(self, spec: BatterySpec) -> None:
        self._spec = spec
        self.remaining = spec.remaining
        self.current_a = spec.idle_a
        self.consumed_mah = 0.0

    @property
    def voltage_v(self) -> float:
        """Of the whole pack, by what is left."""
        spec = self._spec
        return spec.cells * (spec.cell_empty_v + (spec.cell_full_v - spec.cell_empty_v) * self.remaining)

    def drain(self, dt_s: float, throttle: float) -> None:
        """`dt_s` seconds at `throttle` (0..1): power of a rotor goes with thrust to the 3/2."""
        spec = self._spec
        self.current_a = spec.idle_a + spec.full_throttle_a * max(throttle, 0.0) ** 1.5
        used_mah = self.current_a * dt_s / 3.6
        self.consumed_mah += used_mah
        self.remaining = max(0.0, self.remaining - used_mah / spec.capacity_mah)

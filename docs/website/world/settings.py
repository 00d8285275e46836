"""Settings of a flight in the page, and the mission that they make of the examples."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, fields
from importlib.resources import files
from typing import Any, Final

from mission.document.model import Mission
from mission.schema.check import validated
from sim_bridge.world.world import DEFAULT_ORIGIN

OPEN_FIELD: Final = "lone_tree.toml"
STAND: Final = "managed_stand.toml"
RANGE_MARGIN_M: Final = 25.0  # that the radio has around the tree beyond its range on the way, as the examples


@dataclass(frozen=True, slots=True)
class Setting:
    """One slider."""

    least: float
    most: float
    step: float
    usual: float


SETTINGS: Final = {
    "size": Setting(2, 12, 1, 8),
    "range_m": Setting(20, 60, 1, 30),
    "loss": Setting(0.0, 0.6, 0.05, 0.0),
    "density_per_ha": Setting(0, 350, 25, 225),
    "seed": Setting(1, 99, 1, 1),
}


@dataclass(frozen=True, slots=True)
class Settings:
    """Values of the sliders. `density_per_ha` 0: the open field with one tree, and no obstacle sensors."""

    size: int = 8
    range_m: float = 30.0
    loss: float = 0.0
    density_per_ha: float = 225.0
    seed: int = 1

    @classmethod
    def read(cls, values: dict[str, Any]) -> Settings:
        """From numbers by name; ValueError names what is out of bounds."""
        made = cls(**{one.name: values.get(one.name, one.default) for one in fields(cls)})
        for name, setting in SETTINGS.items():
            value = getattr(made, name)
            if type(value) not in (int, float) or not setting.least <= value <= setting.most:
                raise ValueError(f"{name} = {value}: must be {setting.least:g} to {setting.most:g}")
        for name in ("size", "seed"):
            if getattr(made, name) != int(getattr(made, name)):
                raise ValueError(f"{name} = {getattr(made, name)}: must be a whole number")
        return made

    def mission(self) -> Mission:
        """The example's, with these. MissionError, with what to change."""
        name = STAND if self.density_per_ha else OPEN_FIELD
        text = files("mission").joinpath("examples", name).read_text(encoding="utf-8")
        tables = tomllib.loads(text)
        tables["swarm"] = {**tables.get("swarm", {}), "size": int(self.size)}
        tables["radio"] = {
            **tables.get("radio", {}),
            "transit_range_m": float(self.range_m),
            "full_range_m": float(self.range_m) + RANGE_MARGIN_M,
        }
        tables["sim"] = {**tables.get("sim", {}), "seed": int(self.seed), "radio_loss": float(self.loss)}
        if self.density_per_ha:
            tables["forest"]["stand"]["density_per_ha"] = float(self.density_per_ha)
        return validated(Mission, tables, name).with_origin(DEFAULT_ORIGIN)

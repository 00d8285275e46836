"""A simulator for the companions: `from sim_bridge import fly` flies one mission. The rest is for the program."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import mission as mission  # settles, before the first module of this package, whether it comes compiled

if TYPE_CHECKING:
    from sim_bridge.library import Result as Result
    from sim_bridge.library import fly as fly

__all__ = ["Result", "fly"]


def __getattr__(name: str) -> Any:
    """`fly` and `Result`, loaded when they are asked for: `sim-bridge --help` needs neither."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from sim_bridge import library

    return getattr(library, name)

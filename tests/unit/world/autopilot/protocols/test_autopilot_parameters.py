"""The parameter table and its bytes."""

from __future__ import annotations

import math
import struct

import pytest

from sim_bridge.world.autopilot import ParameterError
from sim_bridge.world.autopilot.protocols.parameters import INT32, REAL32, ParameterTable
from sim_bridge.world.autopilot.px4.tables import PARAMETERS

DEFAULTS: dict[str, int | float] = {"B_REAL": 1.5, "A_INT": 3}


def int_bytes(value: int) -> float:
    wire: float = struct.unpack("<f", struct.pack("<i", value))[0]
    return wire


def test_names_are_in_alphabetical_order() -> None:
    assert ParameterTable(DEFAULTS).names == ("A_INT", "B_REAL")


def test_an_int_travels_in_the_bytes_of_the_float() -> None:
    message = ParameterTable(DEFAULTS).message("A_INT")
    assert message.param_type == INT32
    assert struct.pack("<f", message.param_value) == struct.pack("<i", 3)
    assert (message.param_index, message.param_count) == (0, 2)


@pytest.mark.parametrize("value", [0, 5, -1, 2_000_000, -2])
def test_an_int_is_set_from_its_bytes(value: int) -> None:
    table = ParameterTable(DEFAULTS)
    assert table.set_from_wire("A_INT", int_bytes(value), INT32)
    assert table["A_INT"] == value


def test_a_real_is_set_as_it_is() -> None:
    table = ParameterTable(DEFAULTS)
    assert table.set_from_wire("B_REAL", 0.5, REAL32)
    assert table["B_REAL"] == 0.5


@pytest.mark.parametrize(("name", "wire", "kind"), [("A_INT", 5.0, REAL32), ("B_REAL", math.nan, REAL32)])
def test_the_wrong_type_and_nan_change_nothing(name: str, wire: float, kind: int) -> None:
    table = ParameterTable(DEFAULTS)
    assert not table.set_from_wire(name, wire, kind)
    assert table[name] == DEFAULTS[name]


def test_every_wrong_preset_is_named() -> None:
    with pytest.raises(ParameterError) as error:
        ParameterTable(DEFAULTS, {"NOPE": 1.0, "A_INT": 1.5, "B_REAL": math.inf})
    told = str(error.value)
    assert "NOPE: no such parameter" in told
    assert "A_INT = 1.5: must be a whole number" in told
    assert "B_REAL = inf: must be a finite number" in told


def test_px4_names_fit_the_wire() -> None:
    assert all(len(name) <= 16 and name.isascii() for name in PARAMETERS)


@pytest.mark.parametrize(
    ("name", "value"),  # as recorded from PX4 1.16
    [
        ("COM_OF_LOSS_T", 1.0),
        ("COM_OBL_RC_ACT", 0),
        ("NAV_RCL_ACT", 2),
        ("COM_LOW_BAT_ACT", 0),
        ("MIS_TAKEOFF_ALT", 2.5),
        ("MPC_XY_VEL_MAX", 12.0),
        ("MPC_Z_VEL_MAX_UP", 3.0),
        ("MPC_ACC_HOR", 3.0),
        ("MPC_TKO_SPEED", 1.5),
        ("MPC_LAND_SPEED", 0.7),
        ("RTL_RETURN_ALT", 30.0),
        ("COM_FAIL_ACT_T", 5.0),
        ("COM_OBC_LOSS_T", 5.0),
    ],
)
def test_defaults_are_px4s(name: str, value: float) -> None:
    assert PARAMETERS[name] == value
    assert isinstance(PARAMETERS[name], type(value))

"""The parameters of an emulated autopilot: those that clients request, and those that change its flight.

PX4 puts the bits of an integer into the float of PARAM_VALUE, ArduPilot casts it; clients choose by the autopilot field
of HEARTBEAT. PX4 takes only a PARAM_SET of the right type, ArduPilot ignores the type. Both refuse a value outside the
range of its parameter.

``docs/emulator.md`` lists them all, which a test checks.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from sitl_sim.autopilot.modes import Flavour

INT32 = 6
REAL32 = 9


@dataclass(slots=True)
class Parameter:
    """One parameter; `kind` is MAV_PARAM_TYPE, `low` and `high` are the limits of allowed values."""

    name: str
    value: float
    kind: int
    low: float
    high: float


_PX4 = (
    ("COM_DISARM_LAND", 2.0, REAL32, -1.0, 20.0),
    ("COM_DISARM_PRFLT", 10.0, REAL32, -1.0, 30.0),
    ("COM_DL_LOSS_T", 10, INT32, 5, 300),
    ("COM_OBL_RC_ACT", 0, INT32, 0, 5),
    ("COM_OF_LOSS_T", 1.0, REAL32, 0.1, 60.0),
    ("MIS_TAKEOFF_ALT", 2.5, REAL32, 0.5, 500.0),
    ("MPC_TKO_SPEED", 3.0, REAL32, 0.5, 5.0),  # PX4 ships 1.5; a demonstration should not wait for a slow climb
    ("MPC_XY_CRUISE", 5.0, REAL32, 0.5, 60.0),
    ("MPC_XY_VEL_MAX", 12.0, REAL32, 0.5, 60.0),
    ("MPC_Z_VEL_MAX_DN", 1.5, REAL32, 0.5, 10.0),
    ("MPC_Z_VEL_MAX_UP", 3.0, REAL32, 0.5, 10.0),
    ("NAV_ACC_RAD", 2.0, REAL32, 0.2, 200.0),
    ("NAV_DLL_ACT", 0, INT32, 0, 3),
    ("RTL_RETURN_ALT", 30.0, REAL32, 0.0, 1000.0),
    ("SYS_AUTOSTART", 10040, INT32, 0, 9_999_999),
)
_ARDUPILOT = (
    ("ANGLE_MAX", 3000, INT32, 1000, 8000),
    ("ARMING_CHECK", 1, INT32, 0, 2_097_151),
    ("DISARM_DELAY", 10, INT32, 0, 127),
    ("FS_GCS_ENABLE", 0, INT32, 0, 7),
    ("FS_GCS_TIMEOUT", 5.0, REAL32, 2.0, 120.0),
    ("GUID_OPTIONS", 0, INT32, 0, 255),
    ("GUID_TIMEOUT", 3.0, REAL32, 0.1, 5.0),
    ("RTL_ALT", 1500, INT32, 30, 300_000),
    ("WPNAV_ACCEL", 250.0, REAL32, 50.0, 500.0),
    ("WPNAV_RADIUS", 200.0, REAL32, 5.0, 1000.0),
    ("WPNAV_SPEED", 1000.0, REAL32, 10.0, 6000.0),
    ("WPNAV_SPEED_DN", 150.0, REAL32, 10.0, 1000.0),
    ("WPNAV_SPEED_UP", 250.0, REAL32, 10.0, 1000.0),
)


class Parameters:
    """The parameters of one vehicle, in the order of their index."""

    def __init__(self, flavour: Flavour, system_id: int) -> None:
        self._bytewise = flavour.is_px4
        own_id = ("MAV_SYS_ID" if flavour.is_px4 else "SYSID_THISMAV", system_id, INT32, system_id, system_id)
        rows = sorted([*(_PX4 if flavour.is_px4 else _ARDUPILOT), own_id])
        self._parameters = [Parameter(name, float(value), kind, low, high) for name, value, kind, low, high in rows]
        self._index = {parameter.name: index for index, parameter in enumerate(self._parameters)}

    def __len__(self) -> int:
        return len(self._parameters)

    def __getitem__(self, name: str) -> float:
        return self._parameters[self._index[name]].value

    @property
    def names(self) -> list[str]:
        """All of them."""
        return list(self._index)

    def find(self, param_id: bytes, index: int = -1) -> int | None:
        """Index of a parameter by name, or by index if that is not negative."""
        if index >= 0:
            return index if index < len(self._parameters) else None
        return self._index.get(parameter_name(param_id))

    def set(self, index: int, wire_value: float, kind: int) -> str | None:
        """Set the value of a PARAM_SET; returns None, or why it is refused."""
        parameter = self._parameters[index]
        if self._bytewise and kind != parameter.kind:
            return f"{parameter.name}: wrong type"
        value = self._from_wire(wire_value, parameter.kind)
        if not parameter.low <= value <= parameter.high:  # also catches NaN
            return f"{parameter.name}: only {parameter.low:g} to {parameter.high:g}"
        parameter.value = value
        return None

    def fields(self, index: int) -> dict[str, object]:
        """Fields of the PARAM_VALUE of one parameter."""
        parameter = self._parameters[index]
        return {
            "param_id": parameter.name,
            "param_value": self._to_wire(parameter),
            "param_type": parameter.kind,
            "param_count": len(self._parameters),
            "param_index": index,
        }

    def _to_wire(self, parameter: Parameter) -> float:
        if parameter.kind == INT32 and self._bytewise:
            bits: float = struct.unpack("<f", struct.pack("<i", int(parameter.value)))[0]
            return bits
        return parameter.value

    def _from_wire(self, value: float, kind: int) -> float:
        if kind != INT32:
            return value
        if self._bytewise:
            return float(struct.unpack("<i", struct.pack("<f", value))[0])
        return float(math.trunc(value)) if abs(value) < 2**31 else math.nan


def parameter_name(param_id: bytes) -> str:
    """The name in a message: its printable characters, since parameter names are ASCII."""
    return "".join(c for c in param_id.split(b"\x00")[0].decode("ascii", "replace") if " " < c < "\x7f")

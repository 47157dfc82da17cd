"""The parameters of an emulated autopilot: those that clients ask for, and those that change how it flies.

PX4 puts the bits of an integer into the float of PARAM_VALUE, ArduPilot casts it; clients choose by the autopilot field
of HEARTBEAT.
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
    """One parameter; `kind` is MAV_PARAM_TYPE."""

    name: str
    value: float
    kind: int


_PX4 = (
    ("COM_OF_LOSS_T", 1.0, REAL32),
    ("MIS_TAKEOFF_ALT", 2.5, REAL32),
    ("MPC_TKO_SPEED", 3.0, REAL32),  # PX4 ships 1.5; a demonstration should not wait for a slow climb
    ("MPC_XY_CRUISE", 5.0, REAL32),
    ("MPC_XY_VEL_MAX", 12.0, REAL32),
    ("MPC_Z_VEL_MAX_DN", 1.5, REAL32),
    ("MPC_Z_VEL_MAX_UP", 3.0, REAL32),
    ("RTL_RETURN_ALT", 30.0, REAL32),
    ("SYS_AUTOSTART", 10040, INT32),
)
_ARDUPILOT = (
    ("ANGLE_MAX", 3000, INT32),
    ("GUID_OPTIONS", 0, INT32),
    ("GUID_TIMEOUT", 3.0, REAL32),
    ("RTL_ALT", 1500, INT32),
    ("WPNAV_ACCEL", 250.0, REAL32),
    ("WPNAV_SPEED", 1000.0, REAL32),
    ("WPNAV_SPEED_DN", 150.0, REAL32),
    ("WPNAV_SPEED_UP", 250.0, REAL32),
)


class Parameters:
    """The parameters of one vehicle, in the order of their index."""

    def __init__(self, flavour: Flavour, system_id: int) -> None:
        self._bytewise = flavour.is_px4
        own_id = ("MAV_SYS_ID" if flavour.is_px4 else "SYSID_THISMAV", float(system_id), INT32)
        rows = sorted([*(_PX4 if flavour.is_px4 else _ARDUPILOT), own_id])
        self._parameters = [Parameter(name, float(value), kind) for name, value, kind in rows]
        self._index = {parameter.name: index for index, parameter in enumerate(self._parameters)}

    def __len__(self) -> int:
        return len(self._parameters)

    def __getitem__(self, name: str) -> float:
        return self._parameters[self._index[name]].value

    def find(self, param_id: bytes, index: int = -1) -> int | None:
        """Index of a parameter by name, or by index where that is not negative."""
        if index >= 0:
            return index if index < len(self._parameters) else None
        return self._index.get(param_id.split(b"\x00")[0].decode("ascii", "replace"))

    def set(self, index: int, wire_value: float, kind: int) -> bool:
        """Take the value of a PARAM_SET; False if its type is another, or it is not finite."""
        parameter = self._parameters[index]
        value = self._from_wire(wire_value, parameter.kind)
        if kind != parameter.kind or not math.isfinite(value):
            return False
        parameter.value = value
        return True

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

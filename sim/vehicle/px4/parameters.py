"""PX4's parameters: some dozens of its about 885, as read by the emulation or requested by a companion.

A parameter is an int32 or a float32. On the link every value is a float: an int32 is sent as its bits.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping

Value = int | float
INT32, REAL32 = 6, 9  # MAV_PARAM_TYPE
_ALL_BITS = 0xFFFF_FFFF

DEFAULTS: dict[str, Value] = {
    "BAT1_CAPACITY": 5000.0,
    "BAT1_N_CELLS": 4,
    "BAT1_V_CHARGED": 4.05,
    "BAT_CRIT_THR": 0.07,
    "BAT_EMERGEN_THR": 0.05,
    "BAT_LOW_THR": 0.15,
    "CBRK_SUPPLY_CHK": 0,
    "COM_ARM_WO_GPS": 1,
    "COM_DISARM_LAND": 2.0,
    "COM_DISARM_PRFLT": 10.0,
    "COM_DL_LOSS_T": 10,
    "COM_FAIL_ACT_T": 5.0,
    "COM_LOW_BAT_ACT": 3,
    "COM_OBL_RC_ACT": 0,
    "COM_OF_LOSS_T": 1.0,
    "COM_POS_FS_EPH": 5.0,
    "COM_RCL_EXCEPT": 0,
    "COM_RC_IN_MODE": 1,
    "COM_RC_LOSS_T": 0.5,
    "COM_SPOOLUP_TIME": 1.0,
    "COM_TAKEOFF_ACT": 0,
    "EKF2_EV_CTRL": 0,
    "EKF2_GPS_CTRL": 7,
    "EKF2_HGT_REF": 1,
    "EKF2_NOAID_TOUT": 5000000,
    "GF_ACTION": 2,
    "GF_MAX_HOR_DIST": 0.0,
    "GF_MAX_VER_DIST": 0.0,
    "GF_PREDICT": 0,
    "GF_SOURCE": 0,
    "MAV_COMP_ID": 1,
    "MAV_PROTO_VER": 0,
    "MAV_SYS_ID": 1,
    "MAV_TYPE": 2,
    "MC_PITCH_P": 4.0,
    "MC_ROLL_P": 4.0,
    "MC_YAWRATE_MAX": 200.0,
    "MC_YAW_P": 2.8,
    "MIS_TAKEOFF_ALT": 2.5,
    "MPC_ACC_HOR": 3.0,
    "MPC_ACC_HOR_MAX": 5.0,
    "MPC_JERK_AUTO": 4.0,
    "MPC_LAND_ALT1": 10.0,
    "MPC_LAND_ALT2": 5.0,
    "MPC_LAND_SPEED": 0.7,
    "MPC_MAN_TILT_MAX": 35.0,
    "MPC_THR_HOVER": 0.5,
    "MPC_TILTMAX_AIR": 45.0,
    "MPC_TILTMAX_LND": 12.0,
    "MPC_TKO_RAMP_T": 3.0,
    "MPC_TKO_SPEED": 1.5,
    "MPC_XY_CRUISE": 5.0,
    "MPC_XY_P": 0.95,
    "MPC_XY_VEL_D_ACC": 0.2,
    "MPC_XY_VEL_I_ACC": 0.4,
    "MPC_XY_VEL_MAX": 12.0,
    "MPC_XY_VEL_P_ACC": 1.8,
    "MPC_YAWRAUTO_ACC": 20.0,
    "MPC_YAWRAUTO_MAX": 60.0,
    "MPC_Z_P": 1.0,
    "MPC_Z_VEL_D_ACC": 0.0,
    "MPC_Z_VEL_I_ACC": 2.0,
    "MPC_Z_VEL_MAX_DN": 1.5,
    "MPC_Z_VEL_MAX_UP": 3.0,
    "MPC_Z_VEL_P_ACC": 4.0,
    "MPC_Z_V_AUTO_DN": 1.5,
    "MPC_Z_V_AUTO_UP": 3.0,
    "NAV_ACC_RAD": 10.0,
    "NAV_DLL_ACT": 0,
    "NAV_MC_ALT_RAD": 0.8,
    "NAV_RCL_ACT": 2,
    "RTL_CONE_ANG": 45,
    "RTL_DESCEND_ALT": 10.0,
    "RTL_LAND_DELAY": 0.0,
    "RTL_MIN_DIST": 10.0,
    "RTL_RETURN_ALT": 30.0,
    "RTL_TYPE": 0,
    "SDLOG_MODE": 0,
    "SIH_KDV": 1.0,
    "SIH_MASS": 1.0,
    "SIH_T_MAX": 5.0,
    "SIH_T_TAU": 0.05,
    "SIM_BAT_DRAIN": 60.0,
    "SIM_BAT_MIN_PCT": 50.0,
    "SIM_GPS_USED": 10,
    "SIM_MAG_OFFSET_X": 0.0,
    "SYS_AUTOSTART": 10040,
    "SYS_FAILURE_EN": 1,
    "SYS_HITL": 0,
}


class Parameters:
    """The PX4 parameters of one vehicle, in the order of their indices. ``changes``: number of changes so far."""

    def __init__(self, system_id: int, changed: Mapping[str, float]) -> None:
        unknown = sorted(set(changed) - set(DEFAULTS))
        if unknown:
            raise KeyError(f"no such parameter of the emulated PX4: {unknown[0]}")
        self._values = dict(DEFAULTS)
        self._values["MAV_SYS_ID"] = system_id
        for name, value in changed.items():
            self._values[name] = type(DEFAULTS[name])(value)
        self.names = tuple(sorted(self._values))
        self.changes = 0

    def __getitem__(self, name: str) -> float:
        return float(self._values[name])

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def kind(self, name: str) -> int:
        """Return the type of a parameter as a number of MAV_PARAM_TYPE."""
        return INT32 if isinstance(self._values[name], int) else REAL32

    def wire(self, name: str) -> float:
        """Return a parameter's value as the message PARAM_VALUE carries it."""
        value = self._values[name]
        return _float_of_bits(value) if isinstance(value, int) else value

    @property
    def hash_wire(self) -> float:
        """PX4's hash over all names and values, in the form of PARAM_VALUE: a CRC-32 without the usual inversions."""
        inverted = _ALL_BITS
        for name in self.names:
            inverted = zlib.crc32(name.encode() + struct.pack("<f", self.wire(name)), inverted)
        result: float = struct.unpack("<f", struct.pack("<I", inverted ^ _ALL_BITS))[0]
        return result

    def set(self, name: str, wire: float) -> None:
        """Set a parameter to the value in a PARAM_SET message of the right type."""
        self.changes += 1
        self._values[name] = _bits_of_float(wire) if isinstance(self._values[name], int) else wire


def _float_of_bits(value: int) -> float:
    result: float = struct.unpack("<f", struct.pack("<i", value))[0]
    return result


def _bits_of_float(value: float) -> int:
    result: int = struct.unpack("<i", struct.pack("<f", value))[0]
    return result

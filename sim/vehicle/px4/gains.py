"""Conversion of PX4's present parameters to a vehicle's gains, limits and the drag of PX4's own simulator."""

from __future__ import annotations

from math import radians

from msgspec.structs import replace

from radron.sim.vehicle.multirotor import MultirotorTruth
from radron.sim.vehicle.px4.parameters import DEFAULTS, Parameters

_MIN_GAIN = 0.01  # PX4 accepts any value; no vehicle flies with a gain of zero
_IN_DEGREES = "MC_YAWRATE_MAX"  # here in rad/s
# The tilt's lag scales with MC_ROLL_P; with 6.5 it was recorded as 1 / 6.5 s.
_FIELDS = {
    "MPC_XY_P": "position_gain_ps",
    "MPC_XY_VEL_P_ACC": "velocity_gain_ps",
    "MPC_XY_VEL_I_ACC": "integrator_gain_ps2",
    "MPC_XY_VEL_D_ACC": "derivative_gain",
    "MC_ROLL_P": "attitude_rate_ps",
    "SIH_KDV": "drag_ps",
    "MPC_Z_P": "climb_position_gain_ps",
    "MPC_Z_VEL_P_ACC": "climb_velocity_gain_ps",
    "MPC_Z_VEL_I_ACC": "climb_integrator_gain_ps2",
    "MPC_Z_VEL_D_ACC": "climb_derivative_gain",
    "MPC_TILTMAX_AIR": "maximum_tilt_deg",
    "MPC_XY_VEL_MAX": "maximum_speed_mps",
    "MPC_Z_VEL_MAX_UP": "maximum_climb_mps",
    "MPC_Z_VEL_MAX_DN": "maximum_descent_mps",
    "MC_YAW_P": "yaw_gain_ps",
    "MC_YAWRATE_MAX": "maximum_yaw_rate_rps",
}


def equipped(vehicle: MultirotorTruth, parameters: Parameters) -> MultirotorTruth:
    """Return a vehicle's true parameters with each PX4 parameter applied that differs from PX4's default."""
    changed = {}
    for name, field in _FIELDS.items():
        value = parameters[name]
        if value != float(DEFAULTS[name]):
            changed[field] = max(_MIN_GAIN, radians(value) if name == _IN_DEGREES else value)
    return replace(vehicle, **changed) if changed else vehicle

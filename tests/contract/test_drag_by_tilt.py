"""The drag that an agent finds by the tilt of a real PX4: 1.0 1/s as its simulator had it, 0.3 in some recordings."""

from __future__ import annotations

from math import cos, hypot, pi, sin

import numpy as np
import pytest

from radron.agent.navigation.drag import DragFilter
from radron.agent.vehicle.interface import FlightMode, VehicleState
from support.px4.recorded_series import Recording, recordings

STEP_S = 0.05
MOVING = sorted(name for name in recordings() if "circle" in name or "square" in name)
STANDING = ("C_hover_60s_p", "C_yaw_standing")


def quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """ENU from FLU, of roll and pitch in FRD and a yaw from east, counter-clockwise."""
    (cr, sr), (cp, sp), (cy, sy) = ((cos(0.5 * angle), sin(0.5 * angle)) for angle in (roll, -pitch, yaw))
    return cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy


def telemetry(recording: Recording) -> list[VehicleState]:
    """Estimated motion, and the attitude."""
    times = np.arange(recording.begin_s, recording.end_s, STEP_S)
    states = []
    for time_s, estimate, truth in zip(times, recording.estimate(times).tolist(), recording.truth(times).tolist(), strict=True):
        states.append(
            VehicleState(
                stamp_ns=round(1e9 * time_s),
                epoch=0,
                position_m=tuple(estimate[:3]),
                velocity_mps=tuple(estimate[3:6]),
                quaternion=quaternion(truth[6], truth[7], truth[8]),
                height_m=5.0,
                position_sigma_m=0.2,
                yaw_sigma_rad=0.0,
                mode=FlightMode.OFFBOARD,
                armed=True,
                in_air=True,
                healthy=True,
            )
        )
    return states


@pytest.mark.parametrize("name", MOVING)
def test_the_drag_of_a_moving_vehicle_is_found_within_15_s_and_stays_known(name: str) -> None:
    recording, drag, found = recordings()[name], DragFilter(0.5), []
    for state in telemetry(recording):
        drag.follow(state)
        found.append((1e-9 * state.stamp_ns - recording.begin_s, drag.drag_ps))
        assert drag.fits
    late = [drag_ps for time_s, drag_ps in found if time_s > 15.0]
    assert len(late) > 20
    assert np.array(late) == pytest.approx(recording.vehicle.drag_ps, abs=0.15)


@pytest.mark.parametrize("name", STANDING)
def test_of_a_vehicle_that_stands_nothing_is_learnt(name: str) -> None:
    drag = DragFilter(0.5)
    for state in telemetry(recordings()[name]):
        drag.follow(state)
    assert drag.drag_ps == pytest.approx(0.5, abs=0.1)
    assert drag.fits


def test_the_attitude_is_the_one_of_the_thrust() -> None:
    """Nose down by 0.2 rad while looking east: the thrust leads east."""
    w, x, y, z = quaternion(0.0, -0.2, 0.0)
    assert 2.0 * (x * z + w * y) == pytest.approx(sin(0.2))
    w, x, y, z = quaternion(0.0, -0.2, 0.5 * pi)
    assert hypot(2.0 * (x * z + w * y), 2.0 * (y * z - w * x) - sin(0.2)) == pytest.approx(0.0, abs=1e-12)

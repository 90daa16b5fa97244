"""Vehicles with positions too uncertain for a track to use their measurements.

The updates of a track are linear about the mean of place and biases, which gives the direction to the source. If a vehicle's
position uncertainty is as large as its distance from the source, this direction is arbitrary. The update then moves the source
along a wrong direction with false certainty, the more so, the wider the vehicle's prior. So measurements of such a vehicle are
left out while vehicles with known positions measure. Without any, for example after the clocks of a swarm have split into halves,
they count.
"""

from __future__ import annotations

from collections.abc import Mapping

from radron.agent.fusion.bayes.motion import BIAS
from radron.agent.fusion.observation import Observation
from radron.agent.geometry import Array

MAX_DISTANCE_SIGMA_M = 6.0  # of the horizontal distance: 4.2 m along each axis, half the distance of a camera on a small circle
DOUBT_WINDOW_NS = 5_000_000_000  # several exposures

Sure = Mapping[int, int]  # by vehicle, the stamp of its newest observation at a known place


def is_left_out(sure: Sure, vehicle: int, observation: Observation) -> bool:
    """Return whether an observation must be left out, since its position is too uncertain and other vehicles know theirs.

    sure: by vehicle, the time of its newest observation at a known position.
    """
    return observation.position_sigma_m > MAX_DISTANCE_SIGMA_M and bool(others(sure, vehicle, observation.stamp_ns))


def noted(sure: Sure, vehicle: int, observation: Observation) -> Sure:
    """Return ``sure`` (by vehicle, the time of its newest observation at a known position) with one more observation."""
    if observation.position_sigma_m > MAX_DISTANCE_SIGMA_M:
        return sure
    return {**sure, vehicle: max(observation.stamp_ns, sure.get(vehicle, 0))}


def of_counting(bias_variance: Array, sure: Sure, stamp_ns: int) -> Array:
    """Return the variances (BIAS V,) of the errors of V vehicles, with 0 for vehicles whose measurements are left out at a time
    stamp.

    Otherwise a place that is the mean over all vehicles would be as uncertain as the positions of the vehicles left out.
    """
    doubted = [
        vehicle
        for vehicle, variance in enumerate(bias_variance[::BIAS].tolist())
        if variance > MAX_DISTANCE_SIGMA_M**2 / 2.0 and others(sure, vehicle, stamp_ns)
    ]
    if not doubted:
        return bias_variance
    counting = bias_variance.copy()
    counting.reshape(-1, BIAS)[doubted] = 0.0
    return counting


def others(sure: Sure, vehicle: int, stamp_ns: int) -> list[int]:
    """Return the other vehicles that have recent measurements at known positions."""
    return [other for other, newest_ns in sure.items() if other != vehicle and stamp_ns - newest_ns <= DOUBT_WINDOW_NS]

"""Vehicles that are too doubtful of their own places for a track to use what they measure.

The updates of a track are linear about the mean of place and biases: the direction to the source is taken from there. Where a
vehicle may be as far from its place as the source is, that direction may be any, and the update moves the source, and makes it
certain, along a wrong one; the more so, the wider the vehicle's prior. So what such a vehicle measures is left out while others
measure that know their places. Where none does, as where the clocks of a swarm split into halves, it counts.
"""

from __future__ import annotations

from collections.abc import Mapping

from agent.fusion.bayes.motion import BIAS
from agent.fusion.observation import Observation
from agent.geometry import Array

MOST_SIGMA_M = 6.0  # of the horizontal distance: 4.2 m along each axis, half the distance of a camera on a small circle
RECENT_NS = 5_000_000_000  # several exposures

Sure = Mapping[int, int]  # by vehicle, the stamp of its newest observation at a place that it knows


def is_left_out(sure: Sure, vehicle: int, observation: Observation) -> bool:
    """Whether an observation is not to count, after those of which ``sure`` tells."""
    return observation.position_sigma_m > MOST_SIGMA_M and bool(others(sure, vehicle, observation.stamp_ns))


def noted(sure: Sure, vehicle: int, observation: Observation) -> Sure:
    """``sure``, with that of one more observation."""
    if observation.position_sigma_m > MOST_SIGMA_M:
        return sure
    return {**sure, vehicle: max(observation.stamp_ns, sure.get(vehicle, 0))}


def of_counting(bias_variance: Array, sure: Sure, stamp_ns: int) -> Array:
    """Stationary variances (BIAS V,) of the vehicles' biases, 0 of those whose measurements are left out at a stamp: a place that
    is the mean of all vehicles' would be as doubtful as theirs.
    """
    doubted = [
        vehicle
        for vehicle, variance in enumerate(bias_variance[::BIAS].tolist())
        if variance > MOST_SIGMA_M**2 / 2.0 and others(sure, vehicle, stamp_ns)
    ]
    if not doubted:
        return bias_variance
    counting = bias_variance.copy()
    counting.reshape(-1, BIAS)[doubted] = 0.0
    return counting


def others(sure: Sure, vehicle: int, stamp_ns: int) -> list[int]:
    """The other vehicles that know their places and have measured recently."""
    return [other for other, newest_ns in sure.items() if other != vehicle and stamp_ns - newest_ns <= RECENT_NS]

"""Goals of the tracker, one for each step of a plan: the reference, moved inside the fence and within reach."""

from __future__ import annotations

from math import hypot

import numpy as np

from radron.agent.config.mission import LimitsConfig
from radron.agent.geometry import Array
from radron.agent.motion.fence import Fence
from radron.agent.motion.reference import Reference

Piece = tuple[Array, Array]  # half-planes n . p >= b: normals (M, 2), offsets (M,)

_FENCE_INSIDE_M = 1.5  # margin of plans to the fence, for the vehicle's deviation from them
HEIGHT_INSIDE_M = 0.5  # the same to floor and ceiling
_REACH_S = 0.5  # goals may be as far away as full speed allows in their time and this time more


class Goals:
    """Goals of a drone's tracker: positions and velocities at the steps of a plan, inside the fence and within reach."""

    def __init__(self, limits: LimitsConfig, fence: Fence, step_s: float, horizon: int) -> None:
        self._fence, self._step_s, self._horizon = fence, step_s, horizon
        self._low, self._high = fence.floor_m + HEIGHT_INSIDE_M, fence.ceiling_m - HEIGHT_INSIDE_M
        self._known = (0.0, 0.0, 0.0)  # a position, and its clearance from the fence
        self._times: Array = step_s * np.arange(1, horizon + 1, dtype=np.float64)
        self._speed, self._climb = limits.speed_mps, limits.climb_mps
        self._reach: Array = self._times + _REACH_S  # seconds
        flat = 0.5**0.5 * self._speed * self._reach  # inside these boxes, every goal is within reach
        self._boxes: Array = np.column_stack((flat, flat, self._climb * self._reach))

    def inside(self, x: float, y: float) -> Piece:
        """Return a convex part of the fence around a position as half-planes, shrunk by the margin of plans to the fence."""
        normals, offsets = self._fence.half_planes(x, y)
        return normals, offsets + _FENCE_INSIDE_M

    def surely_inside(self, x: float, y: float, radius_m: float) -> bool:
        """Return whether a circle around (x, y) of this radius lies inside the fence.

        The fence itself is queried only if the last known clearance does not decide: it changes by at most the distance flown
        since then.
        """
        known_x, known_y, known_m = self._known
        way = hypot(x - known_x, y - known_y)
        if known_m - way > radius_m:
            return True
        if known_m + way <= radius_m:
            return False
        distance = self._fence.clearance(x, y) - _FENCE_INSIDE_M
        self._known = (x, y, distance)
        return distance > radius_m

    def of(self, reference: Reference, start: Array, height: float) -> Array:
        """Return the goals (2 + 2 H, 3) for H steps, as ``Prediction.optimum`` takes them: velocity and acceleration at the
        start, H positions relative to the start, H velocities.

        ``start``: (3, 3), position, velocity and acceleration of the plan's start; ``height``: z of the start as reference and
        fence count heights: above the ground if that is not level.
        """
        horizon = self._horizon
        wanted = np.empty((2 + 2 * horizon, 3))
        wanted[:2] = start[1:]
        positions, velocities = wanted[2 : 2 + horizon], wanted[2 + horizon :]
        self._resample(reference, positions, velocities)
        positions -= (start[0, 0], start[0, 1], height)
        magnitudes = np.abs(positions)
        (x, y, _), z, (dx, dy, dz) = start[0].tolist(), height, magnitudes.max(axis=0).tolist()
        moved = False
        if z - dz < self._low or z + dz > self._high:
            heights, low = positions[:, 2], self._low - z
            np.minimum(np.maximum(heights, low, out=heights), max(low, self._high - z), out=heights)
            moved = True
        if not self.surely_inside(x, y, hypot(dx, dy)):
            normals, offsets = self.inside(x, y)
            _bring_inside(positions[:, :2], velocities[:, :2], (normals, offsets - normals @ start[0, :2]))
            moved = True
        if moved or (magnitudes > self._boxes).any():
            self._bring_within_reach(positions, velocities)
        return wanted

    def _resample(self, reference: Reference, positions: Array, velocities: Array) -> None:
        horizon, count = self._horizon, len(reference.positions) - 1
        if reference.step_s == self._step_s and count >= horizon:
            positions[:], velocities[:] = reference.positions[1 : horizon + 1], reference.velocities[1 : horizon + 1]
            return
        known = np.arange(count + 1) * reference.step_s
        after = np.maximum(0.0, self._times - known[-1])  # the reference continues straight beyond its end
        for axis in range(3):
            velocities[:, axis] = np.interp(self._times, known, reference.velocities[:, axis])
            positions[:, axis] = np.interp(self._times, known, reference.positions[:, axis]) + after * velocities[:, axis]

    def _bring_within_reach(self, offsets: Array, velocities: Array) -> None:
        """Limit the distances of the goals to what full speed allows; larger ones would only reduce the solver's accuracy."""
        most = np.abs(offsets).max(axis=0).tolist()
        if max(most[0], most[1]) > self._speed * self._reach[0]:
            reach = self._speed * self._reach
            distance = np.maximum(np.hypot(offsets[:, 0], offsets[:, 1]), 1e-9)
            far = distance > reach
            direction = offsets[far, :2] / distance[far, None]
            offsets[far, :2] = direction * reach[far, None]
            velocities[far, :2] = direction * self._speed
        if most[2] > self._climb * self._reach[0]:
            reach = self._climb * self._reach
            far = np.abs(offsets[:, 2]) > reach
            direction = np.sign(offsets[far, 2])
            offsets[far, 2] = direction * reach[far]
            velocities[far, 2] = direction * self._climb


def _bring_inside(positions: Array, velocities: Array, inside: Piece) -> None:
    """Move goals (H, 2) beyond the fence onto its boundary, in place, and stop their velocities (H, 2) towards the outside."""
    normals, offsets = inside
    outside = positions @ normals.T < offsets
    if outside.any():
        for normal, offset, beyond in zip(normals, offsets.tolist(), outside.T, strict=True):
            positions += np.maximum(0.0, offset - positions @ normal)[:, None] * normal
            velocities += (np.maximum(0.0, -velocities @ normal) * beyond)[:, None] * normal

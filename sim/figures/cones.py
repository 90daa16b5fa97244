"""Intersection of a Compton cone with the ground."""

from __future__ import annotations

import numpy as np

from radron.sim.geometry import Array


def ground_curve(apex_m: Array, axis: Array, theta_rad: float, reach_m: float, samples: int = 361) -> Array:
    """Return the intersection of a Compton cone with the ground z = 0 as a curve, (samples, 2) horizontal coordinates in metres.

    The cone's rays u have angle(u, axis) = theta. apex_m, axis: (3,), ENU, apex above the ground. Rays that do not reach the
    ground, or only farther than ``reach_m`` (horizontally) from the apex, give NaN, so that a drawn line breaks there.
    """
    axis = axis / np.linalg.norm(axis)
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    around = np.linspace(0.0, 2.0 * np.pi, samples)
    ring = np.outer(np.cos(around), first) + np.outer(np.sin(around), second)
    rays = np.cos(theta_rad) * axis + np.sin(theta_rad) * ring
    curve = np.full((samples, 2), np.nan)
    down = rays[:, 2] < -1e-6
    length = -apex_m[2] / rays[down, 2]
    offset = rays[down, :2] * length[:, None]
    offset[np.hypot(offset[:, 0], offset[:, 1]) > reach_m] = np.nan
    curve[down] = apex_m[:2] + offset
    return curve

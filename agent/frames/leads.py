"""Lead of a drone's satellite fixes over its autopilot's track.

An autopilot that follows its receiver does not jump with it: its position slides after the fixes, within some seconds. If fixes
lead the track, the receiver is wrong or has just been, and the local frame moves faster than any drift.
"""

from __future__ import annotations

import numpy as np

from radron.agent.frames.residuals import Fixes, turned
from radron.agent.geometry import Array

_LEAD_M = 1.0  # corrections of a filter stay below it
_SIGMAS = 3.0  # of the heading
_FEWEST = 4  # fixes for a median place of a frame


def leads_m(fixes: Fixes, yaw_rad: float, yaw_sigma_rad: float) -> Array:
    """Return the distances (F,) in m by which satellite positions run ahead of the drone's own track; 0 for positions that agree.

    Such a lead shows a wrong receiver: the autopilot follows it only slowly. Each position gives a place of the drone's local
    frame, constant while the track follows; a lead is the horizontal distance from the median of these places.

    fixes: F positions of one drone within one epoch (period without a jump). yaw_rad, yaw_sigma_rad: heading of the drone's
    continuous frame in the mission frame, and its 1 sigma.
    """
    if len(fixes) < _FEWEST:
        return np.zeros(len(fixes))
    arms = turned(np.full(len(fixes), yaw_rad), fixes.at)
    arms_m = np.hypot(*_off_median(arms[:, :2]).T)
    leads = np.hypot(*_off_median((fixes.place - arms)[:, :2]).T)
    most = _LEAD_M + np.sqrt(fixes.var[:, 0]) + _SIGMAS * yaw_sigma_rad * arms_m
    leading: Array = np.where(leads > most, leads, 0.0)
    return leading


def _off_median(places: Array) -> Array:
    off: Array = places - np.median(places, axis=0)
    return off

"""Samples of which the time series of a flight consists."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from radron.protocol.messages import Stage
from radron.protocol.stages import CIRCLING
from radron.sim.geometry import Array
from radron.sim.scoring.score import Belief, rms_m


class Row:
    """State of all drones and of the source estimates at one time, as a sample of the time series of a flight."""

    __slots__ = (
        "activity_bq", "activity_sigma_bq", "covariance", "evidence", "first", "hypothesis", "own_error_m", "position", "sigma_m",
        "source", "spacing_error_deg", "stages", "time_s", "velocity",
    )  # fmt: skip

    def __init__(self, time_s: float, position: Array, velocity: Array, stages: list[Stage]) -> None:
        self.time_s = time_s
        self.position = position.copy()
        self.velocity = velocity.copy()
        self.stages = stages
        self.first = 0
        self.source = np.full(3, np.nan)
        self.hypothesis = np.full(position.shape, np.nan)
        self.sigma_m = self.activity_bq = self.activity_sigma_bq = self.evidence = self.own_error_m = np.nan
        self.covariance = np.full((2, 2), np.nan)
        self.spacing_error_deg = np.full(len(position), np.nan)

    @staticmethod
    def of(
        time_s: float, position: Array, velocity: Array, source: tuple[float, float, float] | None, stages: list[Stage],
        beliefs: Sequence[Belief | None], first: int = 0,
    ) -> Row:  # fmt: skip
        """Make the sample of the flight's time series for one time.

        Arrays are (N, 3) in the mission frame; stages and estimates (``beliefs``) have one item for each of N drones. ``first``:
        the drone whose estimate is compared with the truth.
        """
        row = Row(time_s, position, velocity, stages)
        row.first = first
        if source is not None:
            row.source[:] = source
        for drone, belief in enumerate(beliefs):
            if belief is not None:
                row.hypothesis[drone] = belief.position
        judged = beliefs[first]
        if judged is not None:
            row.sigma_m = rms_m(judged)
            row.covariance[:] = judged.covariance[:2, :2]
            row.activity_bq = np.nan if judged.activity_bq is None else judged.activity_bq
            row.activity_sigma_bq = np.nan if judged.activity_sigma_bq is None else judged.activity_sigma_bq
            row.evidence = np.nan if judged.evidence is None else judged.evidence
        circling = [stage in CIRCLING for stage in stages]
        if judged is not None and sum(circling) > 1:
            row.spacing_error_deg[circling] = spacing_error_deg(position[circling], judged.position)
        return row


def spacing_error_deg(position: Array, centre: Array) -> Array:
    """Return how far the gaps between N drones on a circle differ from equal gaps, (N,) in degrees.

    A drone's gap reaches to the next drone counter-clockwise around ``centre``; equal gaps are 360 / N degrees.
    """
    angle = np.degrees(np.arctan2(position[:, 1] - centre[1], position[:, 0] - centre[0]))
    count = len(angle)
    order = np.argsort(angle, kind="stable")
    ordered = angle[order]
    error = np.empty(count)
    error[order[:-1]] = ordered[1:] - ordered[:-1]
    error[order[-1]] = ordered[0] + 360.0 - ordered[-1]
    error -= 360.0 / count
    return error

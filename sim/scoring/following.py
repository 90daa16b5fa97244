"""Distances of the vehicles from their planned trajectories, from the plans and poses that the drones publish."""

from __future__ import annotations

from collections.abc import Mapping
from math import sqrt

from radron.protocol.messages import Plan, Pose, Stage

_MAX_PLAN_AGE_NS = 1_000_000_000  # age limit of a plan in use
PHASES: Mapping[Stage, str] = {Stage.SURVEY: "search", Stage.TRACK: "circle", Stage.REACQUIRE: "circle"}


class Following:
    """Measures the horizontal distances of the drones' published positions from their published plans.

    Each distance is measured in the drone's own local frame.
    """

    def __init__(self) -> None:
        self._plans: dict[str, Plan] = {}
        self._squares: dict[str, list[float]] = {"search": [], "circle": []}

    def plan(self, plan: Plan) -> None:
        """Record a published plan."""
        self._plans[plan.drone] = plan

    def pose(self, pose: Pose, stage: Stage) -> None:
        """Record a published pose, and its distance from the drone's plan. ``stage``: mission stage of the drone."""
        plan, phase = self._plans.get(pose.drone), PHASES.get(stage)
        if plan is None or phase is None or plan.epoch != pose.epoch or abs(pose.stamp_ns - plan.stamp_ns) > _MAX_PLAN_AGE_NS:
            return
        place = (pose.stamp_ns - plan.stamp_ns) / plan.step_ns
        index = min(max(int(place), 0), len(plan.positions_m) - 2)
        if index < 0:
            return
        (x, y, _), (u, v, _) = plan.positions_m[index], plan.positions_m[index + 1]
        share = place - index
        dx, dy = pose.position_m[0] - x - share * (u - x), pose.position_m[1] - y - share * (v - y)
        self._squares[phase].append(dx * dx + dy * dy)

    def rms_m(self, phase: str) -> float | None:
        """Return the RMS distance from the plans over all drones, in metres; None without samples.

        ``phase``: ``search`` or ``circle``.
        """
        squares = self._squares[phase]
        return sqrt(sum(squares) / len(squares)) if squares else None

    @property
    def most_m(self) -> float | None:
        """Largest distance of a drone from its plan, in metres; None without samples."""
        squares = [square for phase in self._squares.values() for square in phase]
        return sqrt(max(squares)) if squares else None

"""Deviation of the vehicles from their plans, from the plans and poses that the drones publish."""

from __future__ import annotations

from collections.abc import Mapping
from math import sqrt

from radron.protocol.messages import Plan, Pose, Stage

_OLDEST_NS = 1_000_000_000  # age limit of a plan in use
PHASES: Mapping[Stage, str] = {Stage.SURVEY: "search", Stage.TRACK: "circle", Stage.REACQUIRE: "circle"}


class Following:
    """Horizontal distances of all drones' poses from their plans, in each drone's own frame."""

    def __init__(self) -> None:
        self._plans: dict[str, Plan] = {}
        self._squares: dict[str, list[float]] = {"search": [], "circle": []}

    def plan(self, plan: Plan) -> None:
        """Note a plan."""
        self._plans[plan.drone] = plan

    def pose(self, pose: Pose, stage: Stage) -> None:
        """Note a pose; ``stage``: of its drone."""
        plan, phase = self._plans.get(pose.drone), PHASES.get(stage)
        if plan is None or phase is None or plan.epoch != pose.epoch or abs(pose.stamp_ns - plan.stamp_ns) > _OLDEST_NS:
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
        """Return the RMS over all drones in ``search`` or ``circle``, m; None without samples."""
        squares = self._squares[phase]
        return sqrt(sum(squares) / len(squares)) if squares else None

    @property
    def most_m(self) -> float | None:
        """Return the largest deviation, m."""
        squares = [square for phase in self._squares.values() for square in phase]
        return sqrt(max(squares)) if squares else None

"""What agents believe: not against the truth, and the same from the same log."""

from __future__ import annotations

from collections.abc import Iterator
from math import sqrt

from agent.pilot import Pilot
from sim.faults.base import Family
from sim.scoring.invariants.base import Breach, Invariant, Setting
from sim.scoring.moment import Member, Moment, Scene

EXCLUDED_SIGMAS, EXCLUDED_S = 6.0, 5.0
_BELIEF_FAULTS: tuple[Family, ...] = ("camera", "pose", "liar")


class TruthPossible(Invariant[Scene]):
    """No hypothesis excludes the true source at 6 sigma for 5 s: the operator is told where it is, and how surely.

    Exempt from the first fault of a camera, of an own position or of a liar on: these put wrong measurements into every log.
    """

    name = "six-sigma"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self._until_s = setting.began_s(_BELIEF_FAULTS)
        self._since_s: list[float | None] = [None] * len(setting.names)

    def breaches(self, moment: Scene) -> Iterator[Breach]:
        """Drones that have excluded the truth for too long."""
        if moment.source is None or moment.time_s >= self._until_s:
            return
        for drone, pilot in enumerate(moment.pilots):
            sigmas = _sigmas(pilot, moment.source) if pilot is not None else 0.0
            since_s = self._since_s[drone]
            if sigmas <= EXCLUDED_SIGMAS:
                self._since_s[drone] = None
            elif since_s is None:
                self._since_s[drone] = moment.time_s
            elif moment.time_s - since_s > EXCLUDED_S:
                yield Breach((drone,), f"the truth is {sigmas:.1f} sigma away for {EXCLUDED_S:g} s")


class SameLogSameHypothesis(Invariant[Moment]):
    """Agents whose logs have one digest, at one time of the grid, have one hypothesis, to the bit.

    All of the swarm's agreement rests on it. An agent that is still working off a backlog is left out.
    """

    name = "agreement"

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Pairs with equal logs and different hypotheses."""
        first: dict[tuple[str, int], tuple[int, Pilot]] = {}
        for drone, pilot in enumerate(moment.pilots):
            if pilot is None or pilot.hypothesis is None or pilot.fusion.pending:
                continue
            other, same = first.setdefault((pilot.digest, pilot.hypothesis.stamp_ns), (drone, pilot))
            if other != drone and not _equal(pilot, same):
                yield Breach((other, drone), "one digest, two hypotheses")


def _equal(one: Pilot, other: Pilot) -> bool:
    mine, theirs = one.hypothesis, other.hypothesis
    if mine is None or theirs is None:
        return mine is theirs
    return bool(
        (mine.position == theirs.position).all()
        and (mine.covariance == theirs.covariance).all()
        and (mine.velocity == theirs.velocity).all()
    )


def _sigmas(pilot: Member, source: tuple[float, float]) -> float:
    """Mahalanobis distance of the true source from a drone's hypothesis, horizontal; 0 without one."""
    hypothesis = pilot.hypothesis
    if hypothesis is None:
        return 0.0
    x, y, _ = hypothesis.position.tolist()
    (xx, xy, _), (_, yy, _), _ = hypothesis.covariance.tolist()
    east, north = source[0] - x, source[1] - y
    determinant = xx * yy - xy * xy
    if determinant <= 0.0:
        return 0.0
    return sqrt(max(0.0, (yy * east * east - 2.0 * xy * east * north + xx * north * north) / determinant))

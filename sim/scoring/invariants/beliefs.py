"""What agents believe: not against the truth, and the same from the same log."""

from __future__ import annotations

from collections.abc import Iterator
from math import hypot, inf, sqrt

from agent.pilot import Pilot
from sim.faults.agents import Forged
from sim.faults.base import Family
from sim.faults.forgers import BESIDE
from sim.scoring.invariants.base import FRAME_FAULTS, Breach, Invariant, Setting
from sim.scoring.moment import Member, Moment, Scene

EXCLUDED_SIGMAS, EXCLUDED_S = 6.0, 5.0
MISPLACED_M = 1.0
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


class OwnPlace(Invariant[Moment]):
    """No drone excludes its own true place at 6 sigma, and by a metre, for 5 s: separation, fence, and the meaning of all that it
    measures rest on it.

    Exempt is a drone whose own position is faulted; and where frames are estimated, everybody from the first fault of an own
    position, of a liar or of a clock on: these put wrong observations into every log.
    """

    name = "own-place"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        estimated = not all(drone.is_exact for drone in setting.mission.drones)
        self._until_s = setting.began_s(FRAME_FAULTS) if estimated else inf
        self._since_s: list[float | None] = [None] * len(setting.names)

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Drones that have been wrong for too long."""
        if moment.time_s >= self._until_s:
            return
        for drone, pilot in enumerate(moment.pilots):
            place = pilot.own_place if pilot is not None else None
            if place is None or not moment.airborne(drone) or self.setting.lost_itself(drone, moment.time_s):
                self._since_s[drone] = None
                continue
            (x, y, _), sigma_m = place
            off_m = hypot(x - moment.position_m[drone, 0], y - moment.position_m[drone, 1])
            since_s = self._since_s[drone]
            if off_m <= max(MISPLACED_M, EXCLUDED_SIGMAS * sigma_m):
                self._since_s[drone] = None
            elif since_s is None:
                self._since_s[drone] = moment.time_s
            elif moment.time_s - since_s > EXCLUDED_S:
                yield Breach((drone,), f"{off_m:.1f} m from where it takes itself to be, sigma {sigma_m:.2f} m")


class SameLogSameHypothesis(Invariant[Moment]):
    """Agents whose logs have one digest, at one time of the grid, have one hypothesis, to the bit.

    All of the swarm's agreement rests on it. An agent that is still working off a backlog is left out.
    """

    name = "agreement"

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Pairs with equal logs and different hypotheses."""
        first: dict[tuple[str, int], tuple[int, Pilot]] = {}
        for drone, pilot in enumerate(moment.pilots):
            if pilot is None or pilot.hypothesis is None or pilot.pending:
                continue
            other, same = first.setdefault((pilot.digest, pilot.hypothesis.stamp_ns), (drone, pilot))
            if other != drone and not _equal(pilot, same):
                yield Breach((other, drone), "one digest, two hypotheses")


class Refused(Invariant[Moment]):
    """At the end no log holds anything that forgers have sent beside what was measured: each entry had a reason to be refused."""

    name = "refused"

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Nothing in flight: all logs would have to be read at each tick."""
        yield from ()

    def at_end(self, moment: Moment) -> Iterator[Breach]:
        """Drones that have taken some."""
        if not any(isinstance(fault, Forged) for fault in self.setting.scenario.fault):
            return
        for drone, pilot in enumerate(moment.pilots):
            taken = sum(record.entry.sequence >= BESIDE for record in pilot.fusion.log) if pilot is not None else 0
            if taken:
                yield Breach((drone,), f"{taken} forged entries in its log")


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

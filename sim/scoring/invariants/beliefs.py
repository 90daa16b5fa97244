"""The agents' estimates: consistent with the truth, and equal for equal logs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain
from math import hypot, inf, sqrt
from typing import NamedTuple

from radron.agent.pilot import Pilot
from radron.protocol.stages import SEARCHING
from radron.sim.faults.agents import Forged
from radron.sim.faults.base import Family
from radron.sim.faults.forgers import INVALID_NUMBER_OFFSET
from radron.sim.scoring.invariants.base import EXCLUDED_S, EXCLUDED_SIGMAS, LOOK_TICKS, Breach, Invariant, Setting
from radron.sim.scoring.moment import Member, Moment, Scene

MEAN_SQUARE, MEAN_SQUARE_AT_REST = 12.0, 20.0
LAG_S, LAG_SIGMAS = 0.3, 3.0  # half of LAG_S is the time from an exposure to the hypothesis that includes it
CORRELATED_S = 3.0  # the errors of a hypothesis are about the same for 0.7 to 3 s, as measured in six flights
_MIN_LOOKS = 20
_SPELL = 20  # samples in the longest spell, 10 s, of a source wrongly estimated at rest: 0.24 m/s, and two cameras, took 7 s
_ALLOWED = 10  # samples in EXCLUDED_S
_SUMMARY_TICKS = 100
_BELIEF_FAULTS: tuple[Family, ...] = ("camera", "pose", "liar")
_SLOWING: tuple[Family, ...] = ("process",)


class _Behind(NamedTuple):
    """One sample of a hypothesis: its squared Mahalanobis distance, and its terms in the lag's fit and in the fit's
    information.
    """

    square: float
    behind: float
    information: float


class TruthPossible(Invariant[Scene]):
    """Requires that no source estimate excludes the true source at 6 sigma for 5 s.

    The operator relies on position and uncertainty. Exempt is the time from the first fault of a camera, of a drone's own
    position or of a liar on: these put wrong measurements into every log. A revoked drone does not count: without links it may
    not know of the revocation, and nobody receives its estimate.
    """

    name = "six-sigma"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self._until_s = setting.began_s(_BELIEF_FAULTS)
        self._since_s: list[float | None] = [None] * len(setting.names)

    def breaches(self, moment: Scene) -> Iterator[Breach]:
        """Yield the drones whose estimates have excluded the true source for too long."""
        if moment.source is None or moment.time_s >= self._until_s:
            return
        for drone, pilot in enumerate(_told(self.setting, moment)):
            sigmas = _sigmas(pilot, moment.source) if pilot is not None else 0.0
            since_s = self._since_s[drone]
            if sigmas <= EXCLUDED_SIGMAS:
                self._since_s[drone] = None
            elif since_s is None:
                self._since_s[drone] = moment.time_s
            elif moment.time_s - since_s > EXCLUDED_S:
                yield Breach((drone,), f"the truth is {sigmas:.1f} sigma away for {EXCLUDED_S:g} s")


class SourceCalibrated(Invariant[Scene]):
    """Requires that, over a flight, the error of a source estimate matches its covariance.

    The mean squared Mahalanobis distance of the truth, 2 by expectation, is 12 at most, 20 for a source at rest. Exemptions are
    those of :class:`TruthPossible`.

    The error of a source at rest hardly changes in a flight. It is one draw of a chi-squared distribution with two degrees of
    freedom, regardless of the number of samples. An exact estimator exceeds 12 with exp(-6), in one flight of 400, and 20 in one
    of 22,000. The error of a moving source is drawn anew every few seconds.

    The worst 5 s of excluded truth are left out, as :class:`TruthPossible` allows them. A slowly moving source may be estimated
    at rest, rightly 99 times of 100. The hundredth time is a few seconds at 13 sigma, which alone exceed the permitted mean of
    half a minute, although the mean over many flights is 2.
    """

    name = "six-sigma-mean"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self._until_s = setting.began_s(_BELIEF_FAULTS)
        source = setting.scenario.source
        self._most = MEAN_SQUARE if source is not None and source.motion != "static" else MEAN_SQUARE_AT_REST
        self.squares: list[list[float]] = [[] for _ in setting.names]
        self._ticks = 0

    def breaches(self, moment: Scene) -> Iterator[Breach]:
        """Record the normalised errors twice a second; yield nothing in flight."""
        self._ticks += 1
        if self._ticks % LOOK_TICKS == 0 and moment.source is not None and moment.time_s < self._until_s:
            for drone, pilot in enumerate(_told(self.setting, moment)):
                if pilot is not None and pilot.hypothesis is not None and pilot.stage in SEARCHING:
                    self.squares[drone].append(_sigmas(pilot, moment.source) ** 2)
        yield from ()

    def at_end(self, moment: Scene) -> Iterator[Breach]:
        """Yield the drones whose source estimates were overconfident."""
        for drone, squares in enumerate(self.squares):
            most = _most(squares)
            counted = [square for square in squares if square <= most]
            if len(squares) >= _MIN_LOOKS and counted and (mean := sum(counted) / len(counted)) > self._most:
                yield Breach((drone,), f"the mean square of its normalised error is {mean:.0f}, 2 are expected")


class FollowsSource(Invariant[Scene]):
    """Requires that no source estimate lags behind, or leads, a source on a steady circle by more than 0.3 s plus 3 sigma.

    The lag is fitted by least squares to the errors of a whole flight, weighted by the stated covariances, which also give its
    sigma. For a slow or weak source, or in a short flight, hardly any lag is too long. A wandering source turns at any time, and
    any tracker can only be behind then.

    Exemptions are those of :class:`TruthPossible`; also exempt are the time from the first wrong clock on, and an agent with a
    faulted process, whose estimate may be old. Samples are left out as in :class:`SourceCalibrated`: a slow source estimated at
    rest for a moment gives a lag of seconds.

    A longer spell without excluding the truth is unavoidable, and its errors are one event, fewer than the sigma assumes. A lag
    of the estimator itself remains without any such spell, and only such a lag is a violation.
    """

    name = "lag"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        source = setting.scenario.source
        steady = source is not None and source.motion == "circle"
        self._until_s = setting.began_s((*_BELIEF_FAULTS, "clock")) if steady else -inf
        self.looks: list[list[_Behind]] = [[] for _ in setting.names]
        self._ticks = 0
        self._before: tuple[float, tuple[float, float]] | None = None  # time, and place of the source

    def breaches(self, moment: Scene) -> Iterator[Breach]:
        """Record the errors twice a second; yield nothing in flight."""
        self._ticks += 1
        if self._ticks % LOOK_TICKS == 0 and moment.source is not None and moment.time_s < self._until_s:
            if self._before is not None:
                time_s, (x, y) = self._before
                step_s = moment.time_s - time_s
                self._count(moment, moment.source, ((moment.source[0] - x) / step_s, (moment.source[1] - y) / step_s), step_s)
            self._before = moment.time_s, moment.source
        yield from ()

    def _count(self, moment: Scene, source: tuple[float, float], velocity_mps: tuple[float, float], step_s: float) -> None:
        u, v = velocity_mps
        for drone, pilot in enumerate(_told(self.setting, moment)):
            if pilot is None or pilot.hypothesis is None or pilot.stage not in SEARCHING:
                continue
            if self.setting.struck(_SLOWING, drone, moment.time_s):
                continue
            (x, y, _), ((xx, xy, _), (_, yy, _), _) = pilot.hypothesis.position.tolist(), pilot.hypothesis.covariance.tolist()
            determinant = xx * yy - xy * xy
            if determinant > 0.0:
                a, b = (yy * u - xy * v) / determinant, (xx * v - xy * u) / determinant
                behind = (a * (source[0] - x) + b * (source[1] - y)) * step_s
                self.looks[drone].append(_Behind(_sigmas(pilot, source) ** 2, behind, (a * u + b * v) * step_s))

    def at_end(self, moment: Scene) -> Iterator[Breach]:
        """Yield the drones whose source estimates lagged behind, or led, the source."""
        for drone, looks in enumerate(self.looks):
            most = _most([look.square for look in looks])
            counted = [look for look in looks if look.square <= most]
            lag_s, sigma_s = _lag(counted)
            if abs(lag_s) > LAG_S + LAG_SIGMAS * sigma_s and _is_throughout(counted):
                where = "behind" if lag_s > 0.0 else "ahead of"
                yield Breach((drone,), f"its hypothesis is {abs(lag_s):.2f} s {where} the source, sigma {sigma_s:.2f}")


class SameLogSameHypothesis(Invariant[Moment]):
    """Requires that agents with equal logs, at equal times, have bitwise equal source estimates.

    The swarm's agreement rests on this. An agent that has not yet processed its whole log is left out.
    """

    name = "agreement"

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Yield the pairs of drones with equal logs and different estimates."""
        first: dict[tuple[str, int], tuple[int, Pilot]] = {}
        for drone, pilot in enumerate(moment.pilots):
            if pilot is None or pilot.hypothesis is None or pilot.pending:
                continue
            other, same = first.setdefault((pilot.digest, pilot.hypothesis.stamp_ns), (drone, pilot))
            if other != drone and not _equal(pilot, same):
                yield Breach((other, drone), "one digest, two hypotheses")


class Summarised(Invariant[Moment]):
    """Requires that the summary of an agent's log matches the log's content; checked every 5 s.

    Peers do not send an entry unless the summary shows that it is missing.
    """

    name = "summary"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self._ticks = 0
        self._found: list[Breach] = []

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Yield the drones whose summaries claim more, or less, than their logs contain."""
        self._ticks += 1
        if self._ticks % _SUMMARY_TICKS == 0:
            pilots = enumerate(moment.pilots)
            self._found = [Breach((drone,), text) for drone, pilot in pilots if pilot is not None and (text := _unheld(pilot))]
        yield from self._found


class Refused(Invariant[Moment]):
    """Requires that at the end of the flight no log contains forged entries."""

    name = "refused"

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Yield nothing in flight: all logs would have to be read at each time step."""
        yield from ()

    def at_end(self, moment: Moment) -> Iterator[Breach]:
        """Yield the drones that have accepted forged entries."""
        if not any(isinstance(fault, Forged) for fault in self.setting.scenario.fault):
            return
        for drone, pilot in enumerate(moment.pilots):
            taken = sum(record.entry.sequence >= INVALID_NUMBER_OFFSET for record in pilot.fusion.log) if pilot is not None else 0
            if taken:
                yield Breach((drone,), f"{taken} forged entries in its log")


def _unheld(pilot: Pilot) -> str:
    """Report a publisher with other numbers in the log's summary than in the log; empty without one."""
    log = pilot.fusion.log
    for publisher, told in log.summary().items():
        held = set(log.numbers(publisher))
        if held != set(chain.from_iterable(range(first, last + 1) for first, last in told.ranges)):
            return f"its summary tells other entries of {publisher[0]} than the {len(held)} that it holds"
    return ""


def _equal(one: Pilot, other: Pilot) -> bool:
    mine, theirs = one.hypothesis, other.hypothesis
    if mine is None or theirs is None or mine is theirs:  # mostly from the same fold (``radron.sim.lockstep.sharing``)
        return mine is theirs
    return bool(
        (mine.position == theirs.position).all()
        and (mine.covariance == theirs.covariance).all()
        and (mine.velocity == theirs.velocity).all()
    )


def _told(setting: Setting, moment: Scene) -> list[Member | None]:
    """Return the agents by drone; None for an agent that has ended, or is revoked: nobody receives its estimate."""
    return [None if moment.time_s >= setting.unheard_s(drone) else pilot for drone, pilot in enumerate(moment.pilots)]


def _sigmas(pilot: Member, source: tuple[float, float]) -> float:
    """Return the horizontal Mahalanobis distance of the true source from a drone's hypothesis; 0 without one."""
    hypothesis = pilot.hypothesis
    if hypothesis is None:
        return 0.0
    x, y, _ = hypothesis.position.tolist()
    (xx, xy, _), (_, yy, _), _ = hypothesis.covariance.tolist()
    east, north = source[0] - x, source[1] - y
    determinant = xx * yy - xy * xy
    if xx == yy == 0.0:  # given by the mission
        return 0.0
    if determinant <= 0.0:  # overconfident beyond any reality
        return inf if hypot(east, north) > 0.0 else 0.0
    return sqrt(max(0.0, (yy * east * east - 2.0 * xy * east * north + xx * north * north) / determinant))


def _lag(looks: Sequence[_Behind]) -> tuple[float, float]:
    """Return the lag of a hypothesis, s, and its 1 sigma, infinite without information."""
    information = sum(look.information for look in looks)
    if information <= 0.0:
        return 0.0, inf
    return sum(look.behind for look in looks) / information, sqrt(CORRELATED_S / information)


def _is_throughout(looks: Sequence[_Behind]) -> bool:
    """Return whether a lag shows without any one spell of samples that do not exclude the truth."""
    for first in range(max(1, len(looks) - _SPELL + 1)):
        spell = looks[first : first + _SPELL]
        excluding = [look for look in spell if look.square > EXCLUDED_SIGMAS**2]
        lag_s, sigma_s = _lag([*looks[:first], *excluding, *looks[first + _SPELL :]])
        if abs(lag_s) <= LAG_SIGMAS * sigma_s:
            return False
    return True


def _most(squares: Sequence[float]) -> float:
    """Return the squared Mahalanobis distance above which samples are left out: all that exclude the truth, but no more than
    six-sigma allows in a row.
    """
    within = sorted(squares)[: max(0, len(squares) - _ALLOWED)]
    return max(EXCLUDED_SIGMAS**2, within[-1] if within else 0.0)

"""All conditions that a simulated flight must fulfil, judged together."""

from __future__ import annotations

from radron.sim.scoring.invariants.base import Invariant, Setting, Violation
from radron.sim.scoring.invariants.beliefs import (
    FollowsSource,
    Refused,
    SameLogSameHypothesis,
    SourceCalibrated,
    Summarised,
    TruthPossible,
)
from radron.sim.scoring.invariants.care import Accused, Impersonated, Memory, Named, Reserve, Told
from radron.sim.scoring.invariants.commands import Finite, FreshSetpoint, Queues
from radron.sim.scoring.invariants.convergence import Converged
from radron.sim.scoring.invariants.doubts import Mistimed, PlaceBound, WideBerth
from radron.sim.scoring.invariants.liveness import Landed
from radron.sim.scoring.invariants.place import Calibrated, KnowsHome, KnowsItsPlace, OwnPlace
from radron.sim.scoring.invariants.poison import PoisonNamed
from radron.sim.scoring.invariants.reckoning import Confined, FreshTelemetry, Reckoned
from radron.sim.scoring.invariants.space import Collision, Fence, Heights, Separation
from radron.sim.scoring.moment import Moment

ANY = "any"  # invariant


class Judge:
    """Judges all conditions during a simulated flight (``radron.sim.lockstep.flight.fly(watch=...)``).

    ``violations``: reports of violated conditions in order of time.
    """

    def __init__(self, setting: Setting, until: str | None = None) -> None:
        """``until``: name of a condition; the flight ends at its first violation, or with ``ANY`` at the first violation of any
        condition.
        """
        self._setting, self._until = setting, until
        self.separation, self.converged, self.landed = Separation(setting), Converged(setting), Landed(setting)
        self.invariants: tuple[Invariant[Moment], ...] = (
            self.separation, Collision(setting), Fence(setting), Heights(setting),
            FreshSetpoint(setting), Finite(setting), Queues(setting),
            TruthPossible(setting), SourceCalibrated(setting), FollowsSource(setting), SameLogSameHypothesis(setting),
            Summarised(setting), Refused(setting),
            OwnPlace(setting), Calibrated(setting), KnowsItsPlace(setting), KnowsHome(setting),
            Mistimed(setting), PlaceBound(setting), WideBerth(setting),
            Reckoned(setting), Confined(setting), FreshTelemetry(setting),
            Reserve(setting), Named(setting), Accused(setting), Impersonated(setting), PoisonNamed(setting),
            Told(setting), Memory(setting),
            self.converged, self.landed,
        )  # fmt: skip
        self.violations: list[Violation] = []
        self._last: Moment | None = None

    def __call__(self, moment: Moment) -> bool:
        """Judge a moment; return True if the flight need not continue."""
        self._last = moment
        for invariant in self.invariants:
            found = invariant.look(moment)
            if found:
                self.violations += found
        if self._until is not None and any(self._until in (violation.invariant, ANY) for violation in self.violations):
            self._last = None  # the flight has not ended: no judgement of its end
            return True
        return moment.time_s >= self._setting.end_s or self.landed.is_over(moment)

    def finish(self) -> None:
        """Judge the conditions that are evaluated at the end of the flight."""
        if self._last is not None:
            for invariant in self.invariants:
                self.violations += invariant.finish(self._last)

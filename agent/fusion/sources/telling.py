"""Reports of ``sources`` on sources at rest: a selection of the fitted ones, with errors in the form of other packages."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping

import numpy as np
from msgspec.structs import replace

from radron.agent.config.mission import MissionConfig
from radron.agent.fusion.bayes.apparent import Sights
from radron.agent.fusion.bayes.motion import ACTIVITY, BIASES, GAIN
from radron.agent.fusion.bayes.motion import BIAS as ERRORS
from radron.agent.fusion.bayes.response import REFERENCE_BQ
from radron.agent.fusion.estimator import GridStep, Hypothesis
from radron.agent.fusion.sources.data import Rows
from radron.agent.fusion.sources.fit import Fitted
from radron.agent.fusion.sources.solution import BIAS
from radron.agent.fusion.sources.spectra import Spectra
from radron.agent.fusion.sources.state import SourcesState
from radron.agent.geometry import Array
from radron.agent.motion.orbit import ring_radius_m
from radron.agent.terrain.ground import Ground

_BESIDE_M = 1.0  # margin of a camera's distance on the circle around a source
_SURE = 0.25  # 1 sigma of the log activity up to which a source differs from errors of the model
_REMEMBERED = 2  # fits: agents that share an estimator, as in simulations, may differ by an observation


class Telling:
    """Reports of the sources of a fit, as hypotheses."""

    def __init__(self, mission: MissionConfig, spectra: Spectra, ground: Ground, numbers: Mapping[str, int]) -> None:
        """``spectra``: of the candidates. ``numbers``: of the drones."""
        self._config, self._spectra, self._ground, self._numbers = mission.fusion.sources, spectra, ground, numbers
        outermost, fits = len(mission.drones) - 1, mission.encirclement.law == "smooth"
        self._circle_m = ring_radius_m(mission, 0, fits_hypothesis=False) + _BESIDE_M
        self._outermost_m = max(ring_radius_m(mission, outermost, fits) + _BESIDE_M, self._circle_m)
        self._recent: deque[tuple[SourcesState, list[Hypothesis]]] = deque(maxlen=_REMEMBERED)

    def hypothesis(self, state: SourcesState, step: GridStep) -> Hypothesis | None:
        """Return the first source with the further ones in ``others``; None before its place is known to ``declared_rms_m``."""
        if state.refinement is not None and state.x0_stamp_ns:
            state = state.refinement.state
        if state.x0_stamp_ns == 0 or state.fitted is None:
            return None
        known = self._known(state, state.fitted)
        if not known:
            return None
        first, *others = (replace(one, stamp_ns=step.middle_ns) for one in known)
        return replace(first, evidence=state.fitted.evidence - state.none, others=tuple(others))

    def _known(self, state: SourcesState, fitted: Fitted) -> list[Hypothesis]:
        """Return the sources known well enough for a report, without stamps. Cached, as many steps report one fit."""
        for before, known in self._recent:
            if before.fitted is fitted and before.rows is state.rows and before.cones is state.cones:
                return known
        known = [self.told(state, fitted, k, 0) for k in range(len(fitted.solution)) if self.is_known(fitted, k)]
        self._recent.append((state, known))
        return known

    def is_declared(self, fitted: Fitted) -> bool:
        """Return whether the first source is known; its first report requires this."""
        return len(fitted.solution) > 0 and self.is_known(fitted, 0)

    def is_known(self, fitted: Fitted, k: int) -> bool:
        """Return whether place and activity of source k are known well enough for a report.

        A weak source beside a strong one may stand for errors of the strong one's spectrum.
        """
        return self.is_located(fitted, k) and bool(fitted.sigma_of(k)[2] <= _SURE)

    def is_located(self, fitted: Fitted, k: int) -> bool:
        """Return whether the place of source k is known well enough for a report."""
        return math.hypot(*fitted.sigma_of(k)[:2].tolist()) <= self._config.declared_rms_m

    def watched_s(self, rows: Rows, place: Array) -> float:
        """Return the live time of all cameras near a source, s.

        On the circle and inside, the live time counts in full. Farther out it counts by the inverse square of the distance, up to
        the outermost ring of drones without links to each other.
        """
        away_m = np.hypot(*(rows.place[:, :2] - place).T)
        share = np.where(away_m < self._outermost_m, (self._circle_m / np.maximum(away_m, self._circle_m)) ** 2, 0.0)
        return float(rows.live_s @ share)

    def told(self, state: SourcesState, fitted: Fitted, k: int, stamp_ns: int) -> Hypothesis:
        """Return source k of a fit to the state's measurements, alone, as a hypothesis."""
        solution = fitted.solution
        mean, covariance = self._as_of_bayes(fitted, k)
        (x, y), height_m = solution.place[k].tolist(), solution.height_of(k)
        spectra = self._spectra.plus(state.unknown)
        relative = math.sqrt(float(covariance[ACTIVITY, ACTIVITY]) + self._config.area_sigma**2)
        lines_kev = spectra.lines_of(solution.nuclide[k])
        activity = math.exp(solution.log_activity[k]) * REFERENCE_BQ
        return Hypothesis(
            stamp_ns=stamp_ns,
            position=np.array((x, y, self._ground.height_m(x, y) + height_m)),
            covariance=self._of_place(fitted, k),
            velocity=np.zeros(3),
            cones=len(state.cones),
            x0_stamp_ns=state.x0_stamp_ns,
            activity_bq=activity if lines_kev is None else None,
            activity_sigma_bq=activity * relative if lines_kev is None else None,
            sights=Sights(self._numbers, mean, covariance, self._ground, height_m),
            nuclide=spectra.name_of(solution.nuclide[k]),
            lines_kev=lines_kev,
            watched_s=self.watched_s(state.rows, solution.place[k]),
        )

    def _of_place(self, fitted: Fitted, k: int) -> Array:
        """Return the (3, 3) covariance of the place of source k: J P J', with an estimated height above the ground in P."""
        size = fitted.solution.size
        own = [size * k, size * k + 1, size * k + 3][: size - 1]
        jacobian = np.eye(3)[:, : size - 1]
        jacobian[2, :2] = self._ground.slope(*fitted.solution.place[k].tolist())
        result: Array = jacobian @ fitted.covariance[np.ix_(own, own)] @ jacobian.T
        return result

    def _as_of_bayes(self, fitted: Fitted, k: int) -> tuple[Array, Array]:
        """Return mean and covariance of source k and the biases in the order of ``bayes``.

        The order: x, y, velocity, log activity, and of each drone x, y, heading, sensitivity; velocity and headings are 0.
        """
        size = fitted.solution.size
        own = [size * k, size * k + 1, size * k + 2]
        theirs, first = [0, 1, ACTIVITY], fitted.solution.unbiased
        for number in range(len(self._numbers)):
            own += [first + BIAS * number + part for part in range(BIAS)]
            theirs += [BIASES + ERRORS * number + part for part in (0, 1, GAIN)]
        whole = BIASES + ERRORS * len(self._numbers)
        mean, covariance = np.zeros(whole), np.zeros((whole, whole))
        mean[theirs] = fitted.solution.vector[own]
        covariance[np.ix_(theirs, theirs)] = fitted.covariance[np.ix_(own, own)]
        return mean, covariance

"""The estimator ``paper``: the paper's linear Kalman filter (Sec. IV-B, eqs. (4) to (7)), track-by-detection."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from radron.agent.config.estimators import PaperEstimatorConfig
from radron.agent.fusion.estimator import GridStep, Hypothesis, Outlook
from radron.agent.fusion.initial import InitialSearch
from radron.agent.fusion.observation import ConeObservation, ConeSurface, Observation
from radron.agent.fusion.projection import Rule, project
from radron.agent.geometry import Vector3
from radron.protocol.entries import AnyEntry, Cone

_NS = 1e9
AREA_MARGIN_M = 200.0  # margin around the area: twice the distance at which a camera detects a source


@dataclass(frozen=True, slots=True)
class Track:
    """The Kalman filter's estimate after its last cone: x and y of the source x_k (m), and its horizontal covariance P_k (m2)."""

    stamp_ns: int
    x: float
    y: float
    pxx: float
    pxy: float
    pyy: float
    cones: int
    x0_stamp_ns: int


@dataclass(frozen=True, slots=True)
class PaperState:
    """State of the estimator: the cones gathered for the first estimate x0 (paper, Sec. V-A), and the track once it exists."""

    gathered: tuple[ConeSurface, ...] = ()
    seen: int = 0  # cones so far, including cones too close together for x0
    track: Track | None = None


class PaperEstimator:
    """The estimator of the paper: a linear Kalman filter that corrects the source's position by one Compton cone after the other.

    With x_k the position and S_k its covariance (P is the paper's rotation):

        prediction   x_k = F x_k-1, F = I (eq. (4));   S <- S + q dt I
        measurement  z = the projection of x_k onto the cone (eq. (6)), H = I
                     R = P R_C P', R_C = diag(rho, 1e4 rho, 1e4 rho) (eq. (7)); first column of P: the direction of projection
        correction   K = S (S + R)^-1,   x <- x + K (z - x),   S <- (I - K) S.

    Names: q = ``process_noise_m2ps``, rho = ``measurement_variance_m2``, 1e4 = ``cross_axis_factor``. The paper prints no process
    noise; q dt is its predecessor's (Baca et al. 2021). The first ``initial_cones`` (M) cones of pairwise baseline
    ``initial_baseline_m`` give x0 (Sec. V-A, ``initial.InitialSearch``) with the variance ``initial_variance_m2``.

    The filter needs one reading of a cone. The paper does not say how it distinguishes the electron from the photon. The default
    is the reading with the smaller scattering angle (``PaperEstimatorConfig.order``).

    The source stays on the ground (z = 0, as in the predecessor, unless the mission has an elevation model). As z follows from x
    and y, a correction moves the hypothesis (source estimate) along the ground only.

    The hypothesis stays in the area's bounding box enlarged by ``AREA_MARGIN_M``. A cone is ignored if its apex lies outside of
    that box, where no drone can be. A cone that would move the hypothesis out of the box is also ignored. Otherwise a single cone
    of a drone with a wrong position (messages allow up to 100 km) could take the hypothesis away."""

    reads: tuple[type[AnyEntry], ...] = (Cone,)
    grid_s: float | None = None
    hold_s = 0.0

    def __init__(self, config: PaperEstimatorConfig, search: InitialSearch, rule: Rule, name: str = "paper") -> None:
        self.name = name
        self._config = config
        self._search = search
        self._ground = search.ground
        self._rule: Rule = rule
        west, south, east, north = search.bounds
        self._region = (west - AREA_MARGIN_M, south - AREA_MARGIN_M, east + AREA_MARGIN_M, north + AREA_MARGIN_M)

    def initial(self, start_ns: int | None) -> PaperState:
        """Return the estimator's state before the first cone, which does not depend on the mission's start."""
        return PaperState()

    def step(self, state: PaperState, step: GridStep, observations: Sequence[Observation]) -> PaperState:
        """Return the estimator's state after a grid step's cones, which are processed one after another."""
        gathered, seen, track = state.gathered, state.seen, state.track
        for observation in observations:
            if not isinstance(observation, ConeObservation):
                continue
            cone = observation.forward if self._config.order == "forward" else observation.probable
            if not self._is_near(cone.apex[0], cone.apex[1]):
                continue
            seen += 1
            if track is not None:
                track = self._correct(self._predict(track, cone.stamp_ns), cone)
            elif self._is_apart(cone, gathered):
                gathered = (*gathered, cone)
                if len(gathered) >= self._config.initial_cones:
                    track = self._begin(gathered, seen)
                    gathered = ()
        return PaperState(gathered, seen, track)

    def work(self, state: PaperState, observations: int) -> int:
        """Return the cost of a step: about one unit for the step, and one for each observation."""
        return 1 + observations

    def hypothesis(self, state: PaperState, step: GridStep) -> Hypothesis | None:
        """Return the source estimate, predicted to the beginning of ``step`` (or to its last cone, if that is newer); None
        without a track.
        """
        if state.track is None:
            return None
        track = self._predict(state.track, max(step.start_ns, state.track.stamp_ns))
        return Hypothesis(
            stamp_ns=track.stamp_ns,
            position=np.array([track.x, track.y, self._ground.height_m(track.x, track.y)]),
            covariance=np.array([[track.pxx, track.pxy, 0.0], [track.pxy, track.pyy, 0.0], [0.0, 0.0, 0.0]]),
            velocity=np.zeros(3),
            cones=track.cones,
            x0_stamp_ns=track.x0_stamp_ns,
        )

    def outlook(self, state: PaperState, step: GridStep) -> Outlook | None:
        """Return None: this estimator has no posterior of a search."""
        return None

    def _is_near(self, x: float, y: float) -> bool:
        west, south, east, north = self._region
        return west <= x <= east and south <= y <= north

    def _is_apart(self, cone: ConeSurface, gathered: Sequence[ConeSurface]) -> bool:
        baseline = self._config.initial_baseline_m
        return all(math.dist(cone.apex, other.apex) >= baseline for other in gathered)

    def _begin(self, gathered: Sequence[ConeSurface], seen: int) -> Track:
        x, y = self._search.solve(gathered)
        variance = self._config.initial_variance_m2
        stamp_ns = gathered[-1].stamp_ns
        return Track(stamp_ns, x, y, variance, 0.0, variance, seen, stamp_ns)

    def _predict(self, track: Track, stamp_ns: int) -> Track:
        grown = self._config.process_noise_m2ps * (stamp_ns - track.stamp_ns) / _NS
        return Track(stamp_ns, track.x, track.y, track.pxx + grown, track.pxy, track.pyy + grown, track.cones, track.x0_stamp_ns)

    def _correct(self, track: Track, cone: ConeSurface) -> Track:
        """LKF correction, as three scalar corrections in turn.

        R is diagonal in the axes p_a of P, so the measurement is three independent scalars p_a . z of variance R_a. On ground of
        slope (east, north), p_a . (x, y, z(x, y)) has the gradient h = (p_ax + p_az east, p_ay + p_az north); for each a

            g = S h,   s = h . g + R_a,   x <- x + g (p_a . (z - x)) / s,   S <- S - g g' / s.

        The result equals the correction with the whole R, without a matrix to invert. ``dx, dy, dz``: correction of x so far.
        """
        x, y, pxx, pxy, pyy = track.x, track.y, track.pxx, track.pxy, track.pyy
        correction = project((x, y, self._ground.height_m(x, y)), cone.apex, cone.axis, cone.theta_rad, self._rule)
        if correction is not None:
            ix, iy, iz = correction.innovation
            east, north = self._ground.slope(x, y)
            dx = dy = dz = 0.0
            for (ax, ay, az), variance in self._axes(correction.normal):
                hx, hy = ax + az * east, ay + az * north  # the source follows the ground
                gx, gy = pxx * hx + pxy * hy, pxy * hx + pyy * hy
                spread = hx * gx + hy * gy + variance
                move = (ax * (ix - dx) + ay * (iy - dy) + az * (iz - dz)) / spread
                dx, dy = dx + gx * move, dy + gy * move
                dz = east * dx + north * dy
                pxx, pxy, pyy = pxx - gx * gx / spread, pxy - gx * gy / spread, pyy - gy * gy / spread
            x, y = x + dx, y + dy
            if not self._is_near(x, y):
                return track
        return Track(track.stamp_ns, x, y, pxx, pxy, pyy, track.cones + 1, track.x0_stamp_ns)

    def _axes(self, normal: Vector3) -> tuple[tuple[Vector3, float], ...]:
        """Return the columns of P with the diagonal of R_C (eq. (7))."""
        rho = self._config.measurement_variance_m2
        first, second = _perpendicular(normal)
        return (normal, rho), (first, rho * self._config.cross_axis_factor), (second, rho * self._config.cross_axis_factor)


def _perpendicular(n: Vector3) -> tuple[Vector3, Vector3]:
    """Return two unit vectors that make an orthonormal basis with n: the second and third column of P."""
    flat = math.hypot(n[0], n[1])
    if flat < 1e-6:  # n is vertical: any horizontal pair
        return (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    side = (-n[1] / flat, n[0] / flat, 0.0)
    return side, (-n[2] * side[1], n[2] * side[0], flat)

"""The state after a step of the estimator ``bayes``."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import Struct

from radron.agent.frames.transform import Transform
from radron.agent.fusion.bayes.contradicted import Rejections, is_contradicted
from radron.agent.fusion.bayes.doubted import Sure
from radron.agent.fusion.bayes.exposed import Exposed
from radron.agent.fusion.bayes.mixture import Mixture
from radron.agent.fusion.bayes.search import SearchState
from radron.agent.fusion.bayes.turned import Turns
from radron.agent.geometry import Array


class BayesState(Struct, frozen=True, eq=False):
    """The state of the Bayesian estimator after a step: a search (probability grid), or a track (sum of Gaussians) once a source
    is found.

    evidence: log Bayes factor of a source against no source by the observations since the last search from the prior (a
    reacquisition starts at the odds 1 - doubt : doubt). recent_evidence: of the last seconds. background: expected strength of
    the background relative to the tables, at the end of the search; a track keeps it. bias_variance: (BIAS V,) prior variances of
    the errors (biases) of the V vehicles observed in the search; a track has its own. frames: by vehicle, epoch (period without a
    jump of the localisation) and estimated frame of its last observation in the track. waiting: by vehicle, its last exposure if
    that waits for the next one (``Mixture.waits``). sure: see ``doubted``; rejections, contrary: of exposures and by cones, see
    ``contradicted``. turns: of cameras, see ``turned``. moments: mean and covariance of the track after the step, for the
    estimates until the next step.
    """

    search: SearchState | None = None
    track: Mixture | None = None
    cones: int = 0
    x0_stamp_ns: int = 0
    evidence: float = 0.0
    recent_evidence: float = 0.0
    background: float = 1.0
    bias_variance: Array | None = None
    frames: Mapping[int, tuple[int, Transform]] = {}
    waiting: Mapping[int, Exposed] = {}
    sure: Sure = {}
    rejections: Rejections = {}
    contrary: Rejections = {}
    turns: Turns = {}
    moments: tuple[Array, Array] | None = None

    def leaves_out(self, vehicle: int, stamp_ns: int) -> bool:
        """Return whether a vehicle's measurements are left out, because the other vehicles' measurements contradict them."""
        return any(is_contradicted(found, self.sure, vehicle, stamp_ns) for found in (self.rejections, self.contrary))

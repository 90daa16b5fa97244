"""The whole posterior of an estimator as arrays, for analysis: cells of a grid, or components of a Gaussian sum."""

from __future__ import annotations

from typing import Literal

import numpy as np
from msgspec import Struct

from radron.agent.fusion.engine import Fusion
from radron.agent.geometry import Array


class Posterior(Struct, frozen=True, eq=False):
    """The probability distribution of the source's horizontal position (mission frame) as arrays of C components, for analysis.

    kind: ``grid``: cells of the search; ``sum``: a Gaussian sum; ``gaussian``: one Gaussian, the estimator's complete result.
    stamp_ns: time of the source estimate; of a grid the time of the request. position: (C, 2) metres. weight: (C,) probabilities,
    adding up to 1 - ``none``. covariance: (C, 2, 2) m2, of each component; for a square cell of side a, a^2 / 12 per axis. none:
    probability that there is no source.
    """

    kind: Literal["grid", "sum", "gaussian"]
    stamp_ns: int
    position: Array
    weight: Array
    covariance: Array
    none: float = 0.0


def posterior_of(fusion: Fusion, now_ns: int) -> Posterior | None:
    """Return the present posterior of an estimator; None before the estimator has one."""
    hypothesis, outlook = fusion.hypothesis, fusion.outlook
    if hypothesis is not None:
        one = hypothesis.position[None, :2].copy(), np.ones(1), hypothesis.covariance[None, :2, :2].copy()
        return _sum_of(fusion, hypothesis.stamp_ns) or Posterior("gaussian", hypothesis.stamp_ns, *one)
    if outlook is None:
        return None
    spread = outlook.cell_m[:, None, None] ** 2 / 12.0 * np.eye(2)
    return Posterior("grid", now_ns, outlook.places.copy(), outlook.weight.copy(), spread, outlook.none)


def _sum_of(fusion: Fusion, stamp_ns: int) -> Posterior | None:
    """Return the Gaussian sum of ``bayes``, with components of all sites and modes of motion; None for another estimator."""
    mixture = getattr(fusion.estimator, "mixture", None)
    track = None if mixture is None else mixture(fusion.state, stamp_ns)
    if track is None:
        return None
    weight = track.weight.ravel()
    mean, covariance = track.mean[..., :2].reshape(-1, 2), track.covariance[..., :2, :2].reshape(-1, 2, 2)
    return Posterior("sum", stamp_ns, mean, weight / weight.sum(), covariance)

"""What errors of the model that neighbouring measurements have in common do to a fit.

Each row's weight reckons with an error of its own (``counts``). But what a camera counts of a source depends on the direction in
which it sees it, by the vehicle around it and by what is not in the tables; and on a circle around one source, all others are
seen in directions that turn with the way around. So of what a drone counts of source k in a patch, rows within ``_SIDE`` voxels,
the share that the model is wrong by is the same: independent from patch to patch and source to source, with the standard
deviation ``_COMMON_ERROR``. To first order, a relative error 1 of patch c moves the solution by P g_ck,

    g_ck = sum_r w_r sum_e S_kre / M_re dM_re / d theta,

P the covariance of the fit, w_r the rows' weights. The fit remains as it is, and its covariance becomes
P + sigma^2 sum_ck P g_ck (P g_ck)': the "sandwich" of a likelihood that is not quite right.
"""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from agent.fusion.sources.data import Rows, summing
from agent.fusion.sources.fit import Fitted, Problem, by_bias
from agent.fusion.sources.solution import BIAS
from agent.geometry import Array

_COMMON_ERROR = 0.05
_SIDE = 12  # voxels, 6 m: on a circle, about an eighth of the way around


def misled(fitted: Fitted, problem: Problem, rows: Rows) -> Fitted:
    """The fit with the covariance that such errors leave; ``problem``: of these rows."""
    solution = fitted.solution
    if not len(solution):
        return fitted
    patches, index = np.unique(np.column_stack((rows.drone, rows.table[:, 1:4] // _SIDE)), axis=0, return_inverse=True)
    sums = summing(index.ravel(), len(patches))
    by_patch = np.stack([sums @ each for each in _by_source(fitted, problem)])  # (K, C, p)
    pull = np.zeros((len(solution), len(patches), len(fitted.covariance)))
    count = by_patch.shape[2]
    pull[..., :count] = by_patch
    biased = by_patch @ by_bias(solution)
    for drone in range(len(solution.bias)):
        own = patches[:, 0] == drone
        pull[:, own, count + BIAS * drone : count + BIAS * (drone + 1)] = biased[:, own]
    moved = _COMMON_ERROR * pull.reshape(-1, pull.shape[2]) @ fitted.covariance
    return replace(fitted, covariance=fitted.covariance + moved.T @ moved)


def _by_source(fitted: Fitted, problem: Problem) -> list[Array]:
    """Of each source, (R, p) what an error of its counts in each row adds to the gradient by the p numbers but the biases."""
    counts, solution = problem.counts, fitted.solution
    expected = counts.expected(solution)
    relative = counts.views(expected).information[:, None] / expected.clear
    changes = np.stack(list(counts.derivatives(solution)), axis=1)  # (R, p, BINS)
    sources = [counts.of_source(solution, k) * relative for k in range(len(solution))]
    return [np.matmul(changes, one[..., None])[..., 0] for one in sources]

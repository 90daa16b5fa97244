"""What errors of the model that neighbouring measurements have in common do to a fit.

Each row's weight reckons with an error of its own (``counts``). But what a camera counts of a source depends on the direction in
which it sees it, by the vehicle around it and by what is not in the tables; and on a circle around one source, all others are
seen in directions that turn with the way around. So of what a drone counts of source k in a patch, rows within ``_SIDE`` voxels,
the share that the model is wrong by is the same: independent from patch to patch and source to source, with the standard
deviation ``_COMMON_ERROR``. So is the share by which the spectrum of source k is wrong in each of the energy bins, at all places;
beside a strong source, a weak one of another nuclide can make good for that. To first order, a relative error 1 of patch c or
bin e moves the solution by P g_ck or P g_ek,

    g_ck = sum_(r in c) sum_e w_r S_kre / M_re dM_re / d theta,    g_ek = sum_r w_r S_kre / M_re dM_re / d theta,

P the covariance of the fit, w_r the rows' weights. The fit remains as it is, and its covariance becomes
P + sigma^2 [sum_ck P g_ck (P g_ck)' + sum_ek P g_ek (P g_ek)']: the "sandwich" of a likelihood that is not quite right.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from agent.fusion.sources.data import Rows, summing
from agent.fusion.sources.fit import Fitted, Problem, by_bias
from agent.fusion.sources.solution import BIAS, Solution
from agent.geometry import Array
from protocol.spectrum import BINS

_COMMON_ERROR = 0.05
_SIDE = 12  # voxels, 6 m: on a circle, about an eighth of the way around


def misled(fitted: Fitted, problem: Problem, rows: Rows) -> Fitted:
    """The fit with the covariance that such errors leave; ``problem``: of these rows."""
    solution = fitted.solution
    if not len(solution):
        return fitted
    drones = np.arange(len(solution.bias))
    patches, index = np.unique(np.column_stack((rows.drone, rows.table[:, 1:4] // _SIDE)), axis=0, return_inverse=True)
    by_patch = summing(index.ravel(), len(patches))
    edges = np.searchsorted(rows.drone, np.arange(len(drones) + 1)).tolist()
    changes, shares = _changes(fitted, problem)
    pulls = []
    for share in shares:
        pulls.append(_with_biases(by_patch @ np.matmul(changes, share[..., None])[..., 0], patches[:, 0], solution))
        each = [
            _with_biases(np.einsum("rpe,re->ep", changes[start:end], share[start:end]), np.full(BINS, drone), solution)
            for drone, (start, end) in zip(drones, pairwise(edges), strict=True)
        ]
        pulls.append(np.sum(each, axis=0))
    moved = _COMMON_ERROR * np.vstack(pulls) @ fitted.covariance
    return replace(fitted, covariance=fitted.covariance + moved.T @ moved)


def _changes(fitted: Fitted, problem: Problem) -> tuple[Array, list[Array]]:
    """(R, p, BINS) derivatives of the expected counts by the p numbers but the biases, and of each source (R, BINS) what errors
    of its counts weigh. Their product is what these errors add to the gradient.
    """
    counts, solution = problem.counts, fitted.solution
    expected = counts.expected(solution)
    relative = counts.views(expected).information[:, None] / expected.clear
    changes = np.stack(list(counts.derivatives(solution)), axis=1)
    return changes, [counts.of_source(solution, k) * relative for k in range(len(solution))]


def _with_biases(pull: Array, drone: NDArray[np.int64], solution: Solution) -> Array:
    """(N, d) with the biases, of (N, p) without: those of the drone (N,) of each."""
    count, biased = pull.shape[1], pull @ by_bias(solution)
    whole = np.zeros((len(pull), count + BIAS * len(solution.bias)))
    whole[:, :count] = pull
    for part in range(BIAS):
        whole[np.arange(len(pull)), count + BIAS * drone + part] = biased[:, part]
    return whole

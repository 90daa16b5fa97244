"""Effect on a fit of model errors that neighbouring measurements have in common.

Each row's weight accounts for an error of its own (``counts``). But a camera's counts of a source depend on its direction of
view: by the vehicle around it and by effects outside the tables. On a circle around one source, the directions of all others turn
with the way around. So the relative model error of a drone's counts of source k is common to a patch, rows within ``_SIDE``
voxels. It is independent from patch to patch and source to source, with the standard deviation ``_COMMON_ERROR``. The same holds
for the relative error of the spectrum of source k in each of the energy bins, at all places. Beside a strong source, a weak one
of another nuclide can compensate for that. To first order, a relative error 1 of patch c or bin e moves the solution by P g_ck or
P g_ek,

    g_ck = sum_(r in c) sum_e w_r S_kre / M_re dM_re / d theta,    g_ek = sum_r w_r S_kre / M_re dM_re / d theta,

P the covariance of the fit, w_r the rows' weights. The fit remains as it is, and its covariance becomes
P + sigma^2 [sum_ck P g_ck (P g_ck)' + sum_ek P g_ek (P g_ek)']: the "sandwich" of a likelihood that is not quite right.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from radron.agent.fusion.sources.data import Rows, summing
from radron.agent.fusion.sources.fit import Fitted, Problem, by_bias
from radron.agent.fusion.sources.solution import BIAS, Solution
from radron.agent.geometry import Array
from radron.protocol.spectrum import BINS

_COMMON_ERROR = 0.05
_SIDE = 12  # voxels, 6 m: on a circle, about an eighth of the way around


def misled(fitted: Fitted, problem: Problem, rows: Rows) -> Fitted:
    """Return the fit with the covariance enlarged by such errors; ``problem``: of these rows."""
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
    """Return (R, p, BINS) derivatives of the expected counts by the p numbers but the biases, and of each source (R, BINS)
    weights of its count errors. The product of both is the errors' contribution to the gradient.
    """
    counts, solution = problem.counts, fitted.solution
    expected = counts.expected(solution)
    relative = counts.views(expected).information[:, None] / expected.clear
    changes = np.stack(list(counts.derivatives(solution)), axis=1)
    return changes, [counts.of_source(solution, k) * relative for k in range(len(solution))]


def _with_biases(pull: Array, drone: NDArray[np.int64], solution: Solution) -> Array:
    """Return (N, d) with the biases, from (N, p) without: each with the biases of its drone (N,)."""
    count, biased = pull.shape[1], pull @ by_bias(solution)
    whole = np.zeros((len(pull), count + BIAS * len(solution.bias)))
    whole[:, :count] = pull
    for part in range(BIAS):
        whole[np.arange(len(pull)), count + BIAS * drone + part] = biased[:, part]
    return whole

"""Reduction of a Gaussian mixture: Gaussians that lie close together are replaced by one of the same moments."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radron.agent.geometry import Array

MIN_SITE_WEIGHT = 1e-4  # relative to the heaviest site; lighter ones are dropped
MERGED_SIGMAS = 0.5  # sites nearer than this multiple of their sigma are merged


def moments_of(weight: Array, mean: Array, covariance: Array) -> tuple[Array, Array]:
    """Return mean (d,) and covariance (d, d) of a mixture of N Gaussians of d variables.

        m = sum_n w_n m_n / W,   P = sum_n w_n (P_n + (m_n - m) (m_n - m)') / W,   W = sum_n w_n.

    weight: (N,) w_n. mean: (N, d) m_n. covariance: (N, d, d) P_n.
    """
    count, d = mean.shape
    share = weight / max(float(weight.sum()), 1e-300)
    middle = share @ mean
    apart = mean - middle
    spread = (share @ covariance.reshape(count, d * d)).reshape(d, d)
    return middle, spread + (apart.T * share) @ apart


def clusters(weight: Array, mean: Array, covariance: Array) -> list[NDArray[np.intp]]:
    """Return groups of sites (candidate places of the source) that lie so close together that they can be merged, as arrays of
    indices.

    Sites of less than ``MIN_SITE_WEIGHT`` are in no group. Salmond's clustering [S90] with a Euclidean distance: the heaviest
    site left takes all sites within ``MERGED_SIGMAS`` sigma of its own place, unless they are more than twice as wide; sigma: RMS
    of the horizontal axes in its widest mode. Cheaper than merging pairs by Kullback-Leibler distance [R07]: at the hand-over
    from the grid there are hundreds of sites.

    weight: (S, M), mean: (S, M, d), covariance: (S, M, d, d) of S sites, M motion modes and d state variables.
    """
    total = weight.sum(axis=1)
    kept = np.flatnonzero(total > MIN_SITE_WEIGHT * total.max())
    order = kept[np.argsort(-total[kept], kind="stable")]
    place = np.sum(weight[..., None] * mean[..., :2], axis=1) / np.maximum(total, 1e-300)[:, None]
    sigma = np.sqrt(0.5 * np.trace(covariance[..., :2, :2], axis1=-2, axis2=-1).max(axis=1))
    groups: list[NDArray[np.intp]] = []
    while len(order):
        first = order[0]
        away = np.hypot(place[order, 0] - place[first, 0], place[order, 1] - place[first, 1])
        joins = (away < MERGED_SIGMAS * sigma[first]) & (sigma[order] < 2.0 * sigma[first])
        joins[0] = True
        groups.append(order[joins])
        order = order[~joins]
    return groups


def merged(groups: list[NDArray[np.intp]], weight: Array, mean: Array, covariance: Array) -> tuple[Array, Array, Array]:
    """Merge each group of sites into one site with equal moments, mode by mode; return weights, means and covariances.

    weight: (S, M), mean: (S, M, d), covariance: (S, M, d, d) of S sites, M motion modes and d state variables; the result has
    len(groups) sites, of weights that add up to 1.
    """
    total = np.empty((len(groups), *weight.shape[1:]))
    middle, spread = np.empty((*total.shape, *mean.shape[2:])), np.empty((*total.shape, *covariance.shape[2:]))
    for site, mode in np.ndindex(*total.shape):
        parts = groups[site], mode
        total[site, mode] = weight[parts].sum()
        middle[site, mode], spread[site, mode] = moments_of(weight[parts], mean[parts], covariance[parts])
    return total / total.sum(), middle, spread

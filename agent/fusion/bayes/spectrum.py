"""The scatter factor of the ground, from how an exposure's counts divide into the two channels.

Nearly all photons that soil scatters are counted in the partial-energy channel; the full-energy channel hardly depends on kind,
moisture and roughness of the ground. With the counts S_c expected of the source, N_c of them by photons that soil scatters at
the scatter factor exp(q), and B_c of the background, the Poisson likelihood has along q and along the logarithm z of the
source's rate the scores

    dl/dz = sum_c r_c,   dl/dq = g dl/dz + sum_c r_c (g_c - g),   r_c = (k_c - S_c - B_c) S_c / (S_c + B_c),
    g_c = N_c / S_c,   g = sum_c w_c g_c / sum_c w_c,   w_c = S_c^2 / (S_c + B_c).

Both terms of dl/dq are uncorrelated: the first is that of the rate, whose gradient has g along q (``exposed``); the second, the
channels' contrast, depends neither on activity nor on the camera's sensitivity. It has the Fisher information
I = sum_c w_c (g_c - g)^2.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from agent.geometry import Array


class Contrast(Struct, frozen=True, eq=False):
    """Of the clear view, score (S, M) u and information (S, M) I about q at each mean."""

    score: Array
    information: Array

    @staticmethod
    def of(counts: Array, expected: Array, background: Array, by_soil: Array, variance: Array) -> tuple[Contrast, Array]:
        """The contrast, and what it adds to the logarithm (C, S, M) of each component's likelihood, with V_q the prior variance:

            u^2 V_q / (2 (1 + V_q I)) - ln(1 + V_q I) / 2.

        counts: (2,). expected, by_soil: (C, S, M, 2) S and N. background: (2,). variance: (S, M) V_q.
        """
        total = expected + background
        weight, share = expected * expected / total, by_soil / expected
        apart = share - _mean(weight, share)[..., None]
        score = ((counts - total) * expected / total * apart).sum(axis=-1)
        information = (weight * apart * apart).sum(axis=-1)
        known = 1.0 + variance * information
        return Contrast(score[0], information[0]), 0.5 * (score * score * variance / known - np.log(known))


def soil_gradient(by_soil: Array, expected: Array, background: Array) -> Array:
    """g (...), the derivative of the logarithm of the rate along q. by_soil, expected: (..., 2). background: (2,)."""
    return _mean(expected * expected / (expected + background), by_soil / expected)


def _mean(weight: Array, share: Array) -> Array:
    result: Array = (weight * share).sum(axis=-1) / weight.sum(axis=-1)
    return result

"""The scatter factor of the ground, from the division of an exposure's counts into the two channels.

Nearly all photons scattered by soil are counted in the partial-energy channel. The full-energy channel hardly depends on kind,
moisture and roughness of the ground. Of the counts S_c expected of the source let N_c be of photons scattered by soil, and B_c of
the background. The contrast is the logarithm of N_c over S_c - N_c; it grows with the scatter factor, and falls with the source's
height. The Poisson likelihood has along the logarithm z of the source's rate and along the contrast d the scores

    dl/dz = sum_c r_c,   dl/dd = sum_c r_c (g_c - g),   r_c = (k_c - S_c - B_c) S_c / (S_c + B_c),
    g_c = N_c / S_c,   g = sum_c w_c g_c / sum_c w_c,   w_c = S_c^2 / (S_c + B_c),

which are uncorrelated; z has along the contrast the derivative g (``exposed``). The second score depends neither on activity nor
on the camera's sensitivity. Its Fisher information is I = sum_c w_c (g_c - g)^2.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from radron.agent.geometry import Array


class Contrast(Struct, frozen=True, eq=False):
    """The information on the soil's scatter factor, at each Gaussian of a track (posterior of a found source), from two kinds of
    events.

    Partial-energy events contain most photons scattered by soil, full-energy events hardly any; the contrast is the logarithm of
    the counts from soil's scatter over all other counts from the source. For a clear view: score: (S, M) u, derivative of the log
    likelihood by the contrast, and information: (S, M) I, its variance, for S sites (places) and M motion modes; gradient: (S, M,
    d) h_d, derivatives of the contrast by the d state variables.
    """

    score: Array
    information: Array
    gradient: Array

    @staticmethod
    def of(
        counts: Array, expected: Array, background: Array, by_soil: Array, gradient: Array, covariance: Array
    ) -> tuple[Contrast, Array]:
        """Return the contrast (division of counts into two kinds of events), and its contribution (C, S, M) to the log
        likelihood.

            u^2 V / (2 (1 + V I)) - ln(1 + V I) / 2,   V = h_d' P h_d,

        for each of C components (ways of attenuation by unknown obstacles), S sites (places) and M motion modes. counts: (2,)
        measured. expected, by_soil: (C, S, M, 2) counts expected from the source, and of these by soil's scatter. background:
        (2,) expected. gradient: (S, M, d) h_d. covariance: (S, M, d, d) P of the track.
        """
        total = expected + background
        weight, share = expected * expected / total, by_soil / expected
        apart = share - _mean(weight, share)[..., None]
        score = ((counts - total) * expected / total * apart).sum(axis=-1)
        information = (weight * apart * apart).sum(axis=-1)
        variance = np.vecdot(np.matvec(covariance, gradient), gradient)
        known = 1.0 + variance * information
        return Contrast(score[0], information[0], gradient), 0.5 * (score * score * variance / known - np.log(known))


def soil_share(by_soil: Array, expected: Array, background: Array) -> Array:
    """Return g (...), the derivative of the logarithm of the source's rate by the contrast.

    by_soil, expected: (..., 2) counts expected from soil's scatter, and from the source in all. background: (2,) expected.
    """
    return _mean(expected * expected / (expected + background), by_soil / expected)


def _mean(weight: Array, share: Array) -> Array:
    result: Array = (weight * share).sum(axis=-1) / weight.sum(axis=-1)
    return result

"""How likely counts are, given what a source is expected to add to the background.

Poisson, with an unknown factor on the source's part.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Powers to which the likelihoods of the channels are taken. While it is not known from which side the photons come, events of
# less than a photon's energy count for less: cameras see 14 % fewer from the edge, and many are of scattered photons.
TRACK_TRUST: Array = np.array([1.0, 1.0])
SEARCH_TRUST: Array = np.array([0.3, 1.0])
MODEL_VARIANCE = 0.03**2  # of the logarithm of a camera's rate, in each exposure: its area differs a little from side to side
_LARGEST_SHIFT = 1.5  # of one round
_SETTLED = 1e-3
_LARGEST_VARIANCE = 10.0  # of the log rate: with more, nothing surprises


def log_nothing(counts: Array, background: Array, trust: Array) -> Array:
    """Log likelihood (...) of counts (2,) of a background (..., 2) alone, but for terms that are the same for every source."""
    result: Array = (counts * np.log(background) - background) @ trust
    return result


def surprise(counts: Array, expected: Array, background: Array, variance: Array) -> Array:
    """(...): square of how far all counts together are off what was expected, in units of what both may vary; as for fit_rate.

    Of the counts themselves, not of the fit: the better a track is known, the less it is moved by counts that do not fit.
    """
    signal = expected.sum(axis=-1)
    mean = signal + background.sum()
    off = counts.sum() - mean
    result: Array = off * off / (mean + signal * signal * np.expm1(np.minimum(variance, _LARGEST_VARIANCE)))
    return result


def fit_rate(
    counts: Array, expected: Array, background: Array, variance: Array, trust: Array, rounds: int
) -> tuple[Array, Array, Array]:
    """Fit the factor e^z by which a source counts more than expected, where z ~ N(0, variance) beforehand.

    Args:
        counts: (2,) what was counted, by the channels of Response.
        expected: (..., 2) signal for z = 0.
        background: (2,) or more axes, to which the others are broadcast.
        variance: (...) of z before the counts.
        trust: (2,).
        rounds: of Fisher scoring, at most.

    Returns:
        z (...), its variance afterwards (...), and the log likelihood (...) by Laplace's method, without the terms that are the
        same for every source.
    """
    weight = trust * counts
    precision = 1.0 / variance
    z = np.zeros(variance.shape)
    signal = expected
    for _ in range(rounds):
        share = signal / (signal + background)
        slope = share @ weight - signal @ trust - z * precision
        shift = slope / ((signal * share) @ trust + precision)
        shift = np.minimum(np.maximum(shift, -_LARGEST_SHIFT), _LARGEST_SHIFT)
        z = z + shift
        signal = expected * np.exp(z)[..., None]
        if np.abs(shift).max() < _SETTLED:
            break
    total = signal + background
    after = 1.0 / ((signal * signal / total) @ trust + precision)
    likelihood = np.log(total) @ weight - total @ trust - 0.5 * z * z * precision + 0.5 * np.log(after * precision)
    return z, after, likelihood

"""The likelihood of an exposure's counts: Poisson, with an uncertain factor exp(z) on the source's part.

For the two channels c of a camera (``response.Response``): k_c ~ Poisson(S_c exp(z) + B_c), z ~ N(0, V). S_c are the counts
expected of the source, B_c of the background, V the variance of the logarithm of the source's part. Names: k = ``counts``,
S = ``expected``, B = ``background``, V = ``variance``. Each channel's likelihood is raised to a power t_c (``temper``), a
tempered or power likelihood. Terms that do not depend on the source, such as ln(k_c!), are left out everywhere.
"""

from __future__ import annotations

import numpy as np

from radron.agent.geometry import Array

# t_c. While the direction of the photons is unknown, events of less than a photon's energy are down-weighted: cameras
# see 14 % fewer from the edge, and many of them are of scattered photons.
TRACK_TEMPER: Array = np.array([1.0, 1.0])
SEARCH_TEMPER: Array = np.array([0.3, 1.0])
MODEL_VARIANCE = 0.03**2  # of the logarithm of a camera's rate, in each exposure: its area differs a little from side to side
_MAX_LOG_STEP = 1.5  # of one iteration
_CONVERGED = 1e-3
_MAX_LOG_VARIANCE = 10.0  # of the log rate in the gate, against overflow: with more every count is accepted


def background_log_likelihood(counts: Array, background: Array, temper: Array) -> Array:
    """Return the log likelihood (...) of a camera's counts in an exposure without a source.

    It is ln P(k | H0) = sum_c t_c (k_c ln B_c - B_c). counts: (2,) k in the two channels c (partial-energy and full-energy
    events). background: (..., 2) expected counts B. temper: (2,) exponents t.
    """
    result: Array = (counts * np.log(background) - background) @ temper
    return result


def innovation_squared(counts: Array, expected: Array, background: Array, variance: Array) -> Array:
    """Return how far the total count is from its expectation: the normalised innovation squared (NIS) (...) [BSLK01, Sec. 5.4].

        (k - S - B)^2 / (S + B + S^2 (exp(V) - 1)),   k, S, B summed over the channels:

    variance of the Poisson distribution plus that of a log-normal factor (with its mean exp(V / 2) assumed as 1). The gate
    rejects counts by it. The residual after the fit would not serve: the better a track (posterior of a found source) is known,
    the less contradicting counts move it. Arguments as for ``fit_rate``.
    """
    signal = expected.sum(axis=-1)
    mean = signal + background.sum()
    off = counts.sum() - mean
    result: Array = off * off / (mean + signal * signal * np.expm1(np.minimum(variance, _MAX_LOG_VARIANCE)))
    return result


def fit_rate(
    counts: Array, expected: Array, background: Array, variance: Array, temper: Array, iterations: int
) -> tuple[Array, Array, Array]:
    """Fit the factor exp(z) by which a source counts more or less than expected; return the posterior of z and the likelihood of
    the counts.

    Laplace's method [TK86]. With s_c = S_c exp(z) in the two channels c of a camera, maximise

        l(z) = sum_c t_c (k_c ln(s_c + B_c) - s_c - B_c) - z^2 / (2 V)

    by Fisher scoring, z <- z + l'(z) / I(z), each step at most ``_MAX_LOG_STEP``, where

        l'(z) = sum_c t_c (k_c s_c / (s_c + B_c) - s_c) - z / V
        I(z)  = sum_c t_c s_c^2 / (s_c + B_c) + 1 / V.

    At the maximum z^: z | k ~ N(z^, v) with v = 1 / I(z^), and ln P(k) = l(z^) + ln(v / V) / 2.

    Args:
        counts: (2,) k, measured.
        expected: (..., 2) S, expected from the source.
        background: (2,) or more axes, B, to which the other arrays are broadcast.
        variance: (...) V, prior variance of z.
        temper: (2,) t, exponents of the channels' likelihoods.
        iterations: at most so many.

    Returns:
        z^ (...), v (...) and ln P(k) (...).
    """
    weight = temper * counts
    precision = 1.0 / variance
    z = np.zeros(variance.shape)
    signal = expected
    for _ in range(iterations):
        share = signal / (signal + background)
        slope = share @ weight - signal @ temper - z * precision
        shift = slope / ((signal * share) @ temper + precision)
        shift = np.minimum(np.maximum(shift, -_MAX_LOG_STEP), _MAX_LOG_STEP)
        z = z + shift
        signal = expected * np.exp(z)[..., None]
        if np.abs(shift).max() < _CONVERGED:
            break
    total = signal + background
    after = 1.0 / ((signal * signal / total) @ temper + precision)
    likelihood = np.log(total) @ weight - total @ temper - 0.5 * z * z * precision + 0.5 * np.log(after * precision)
    return z, after, likelihood

"""Unknown obstacles between the source and a camera: a hidden Markov chain [R89] over the attenuation along its flight.

The optical depth t of the obstacle between the source and a vehicle's camera is one of L levels ``DEPTHS``. The first is 0, a
clear view. In an exposure of duration T the level is drawn anew with the probability 1 - exp(-r T), r = ``RATE_PS``, from
``PRIOR``: the chain's transition matrix is exp(-r T) I + (1 - exp(-r T)) 1 prior'. The transmission of an exposure is one of C
components. The level is the same throughout, or the view becomes hidden or clear at some instant, and any share of the direct
photons may pass:

    l throughout         share exp(-t_l),           1 sigma exp(-t_l) sigma_l, of the depths that a level stands for
    clear, then l        share (1 + exp(-t_l)) / 2,  1 sigma (1 - exp(-t_l)) / sqrt(12)
    l, then clear        the same.

A change from one hidden level to another counts as if it came at the beginning.
"""

from __future__ import annotations

import numpy as np

from radron.agent.fusion.bayes.shielding import Shielding
from radron.agent.geometry import Array

# By level: t, its 1 sigma, prior probability, and the share of the scattered photons that pass. Scattered photons come around
# walls, but neither through a hill nor into a dead camera.
_TABLE: Array = np.array(
    [
        (0.0, 0.00, 0.944, 1.0),
        (0.4, 0.15, 0.010, 1.0),
        (0.9, 0.17, 0.010, 1.0),
        (1.6, 0.23, 0.010, 1.0),
        (2.5, 0.30, 0.010, 1.0),
        (4.0, 0.50, 0.010, 1.0),
        (8.0, 1.00, 0.006, 0.01),
    ]
)
DEPTHS, _SPREAD, PRIOR, _AROUND = _TABLE.T
RATE_PS = 0.1
_SCATTER_SIGMA = 0.3  # relative, of the scattered photons behind an unknown obstacle
_TINY = 1e-12

_LEVELS = len(DEPTHS)
_PASSING: Array = np.exp(-DEPTHS)
_BLOCKED: Array = 1.0 - _PASSING[1:]
DIRECT_SHARE: Array = np.concatenate((_PASSING, 1.0 - _BLOCKED / 2.0, 1.0 - _BLOCKED / 2.0))  # (C,), of the direct photons
SHARE_SIGMA: Array = np.concatenate((_PASSING * _SPREAD, _BLOCKED / 12**0.5, _BLOCKED / 12**0.5))  # (C,)
SCATTERED_SHARE: Array = np.concatenate(
    (_AROUND, (1.0 + _AROUND[1:]) / 2.0, (1.0 + _AROUND[1:]) / 2.0)
)  # (C,), of scattered photons
_FROM = np.concatenate((np.arange(_LEVELS), np.zeros(_LEVELS - 1, np.intp), np.arange(1, _LEVELS)))  # (C,)
_TO = np.concatenate((np.arange(_LEVELS), np.arange(1, _LEVELS), np.zeros(_LEVELS - 1, np.intp)))
_ENDS: Array = np.eye(_LEVELS)[_TO]  # (C, L)
_SAME: Array = np.eye(_LEVELS, len(_TO))  # (L, C) probabilities of the components given the level before, without a new draw
_DRAWN: Array = PRIOR[_TO] * (np.arange(_LEVELS)[:, None] == _FROM)  # with a new draw, which may yield the same level
_DRAWN[1:, 1:_LEVELS] = PRIOR[1:]


def components(chance: Array, duration_s: float) -> Array:
    """Return the probabilities (S, C) of the C ways in which an unknown obstacle may attenuate an exposure, for S sites.

    A site is one candidate place of the source. The ways (components): one attenuation level throughout, or a change from clear
    to hidden, or from hidden to clear. chance: (S, L) probabilities of the L levels before the exposure. duration_s: of the
    exposure.
    """
    result: Array = np.maximum(chance @ _moves(duration_s), _TINY)
    return result


def levels(chance: Array) -> Array:
    """Return the probabilities (S, L) of the L attenuation levels after an exposure, for S sites (candidate places of the
    source).

    chance: (S, C) weights of the exposure's C components (ways of attenuation), of any sum.
    """
    total = chance @ _ENDS
    result: Array = total / np.maximum(total.sum(axis=1, keepdims=True), _TINY)
    return result


def given_level(likelihood: Array, duration_s: float) -> Array:
    """Return the likelihood (S, L) of an exposure given the attenuation level before it, for S sites and L levels.

    likelihood: (S, C) of the exposure given its component (way of attenuation).
    """
    result: Array = likelihood @ _moves(duration_s).T
    return result


def at_end(given: Array) -> Array:
    """Expand likelihoods (S, L), given the attenuation level after an exposure, to the components (S, C) of that exposure."""
    result: Array = np.maximum(given[:, _TO], _TINY)
    return result


def passing(chance: Array) -> Array:
    """Return the expected share (S,) of direct photons that pass, E[exp(-t)] with t the optical depth of the unknown obstacle.

    chance: (S, L) probabilities of the L attenuation levels, for S sites.
    """
    result: Array = chance @ _PASSING
    return result


def _moves(duration_s: float) -> Array:
    """Return (L, C): probability of each component given the level before."""
    kept = np.exp(-RATE_PS * duration_s)
    result: Array = kept * _SAME + (1.0 - kept) * _DRAWN
    return result


def behind(direct: Array, scattered: Array, known: Shielding | None) -> tuple[Array, Array]:
    """Return the counts (C, S, M, 2) expected behind unknown obstacles, and the variance (C, S, M) of the logarithm of their sum.

    C components (ways of attenuation), S sites, M motion modes, 2 kinds of events. Obstacles attenuate direct photons. Scattered
    photons come around them, with a change of up to ``_SCATTER_SIGMA``. direct, scattered: (S, M, 2) expected counts without
    obstacles; known: walls and buildings.
    """
    share, sigma = DIRECT_SHARE[:, None, None], SHARE_SIGMA[:, None, None]
    scattered = scattered * SCATTERED_SHARE[:, None, None, None]
    if known is not None:
        share, sigma = known.share * share, np.hypot(known.sigma * share, known.share * sigma)
    expected, variance = Shielding(share, sigma).counts(direct, scattered)
    unsure = _SCATTER_SIGMA * (1.0 - DIRECT_SHARE[:, None, None]) * scattered.sum(axis=-1) / expected.sum(axis=-1)
    return expected, variance + unsure * unsure

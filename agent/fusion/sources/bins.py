"""Spectra by bin of the exposures' coarse spectra: another energy scale, the softest bins together, shares of bins."""

from __future__ import annotations

import numpy as np

from agent.geometry import Array
from protocol.spectrum import EDGES_KEV

LEAST_MM2 = 1e-9  # of an area, so that nothing is divided by 0
_POOLED = 2  # bins, up to 69 keV
_MOST_CHANGE = 2.5  # of the logarithm of a bin


def scaled(shape: Array, by_scale: Array, scale: float) -> Array:
    """The shape at another energy scale: exponential in it, as the flanks of peaks nearly are, and so never negative."""
    change = scale * by_scale / np.maximum(shape, LEAST_MM2)
    result: Array = shape * np.exp(np.clip(change, -_MOST_CHANGE, _MOST_CHANGE))
    return result


def pooled(by_bin: Array) -> Array:
    """(..., BINS) with the softest bins as if they were one: each is their mean, so that a Poisson likelihood is that of the sum.

    Between them lies the peak of Am-241, less the charge that is lost. From the front of the sensor that is more than in the mean
    over front and back: on a circle, where cameras face the source, half as many events again are below that edge as expected.
    """
    result = by_bin.copy()
    result[..., :_POOLED] = by_bin[..., :_POOLED].mean(axis=-1, keepdims=True)
    return result


def overlap(low_kev: float, high_kev: float) -> Array:
    """(BINS,) share of each bin that lies between two energies."""
    edges = np.array(EDGES_KEV)
    inside = np.minimum(edges[1:], high_kev) - np.maximum(edges[:-1], low_kev)
    result: Array = np.maximum(inside, 0.0) / np.diff(edges)
    return result

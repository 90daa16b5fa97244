"""Operations on spectra by bin of the exposures' coarse spectra: change of energy scale, pooled softest bins, shares of bins."""

from __future__ import annotations

import numpy as np

from radron.agent.geometry import Array
from radron.protocol.spectrum import EDGES_KEV

LEAST_MM2 = 1e-9  # lower limit of an area, against division by 0
_POOLED = 2  # bins, up to 69 keV
_MOST_CHANGE = 2.5  # limit of the change of a bin's logarithm


def scaled(shape: Array, by_scale: Array, scale: float) -> Array:
    """Return the shape at another energy scale: exponential in the scale, as flanks of peaks nearly are; never negative."""
    change = scale * by_scale / np.maximum(shape, LEAST_MM2)
    result: Array = shape * np.exp(np.clip(change, -_MOST_CHANGE, _MOST_CHANGE))
    return result


def pooled(by_bin: Array) -> Array:
    """Return (..., BINS) with each of the softest bins replaced by their mean; a Poisson likelihood is then that of their sum.

    The peak of Am-241, less the lost charge, lies between these bins. From the front of the sensor the loss is larger than in the
    mean over front and back. On a circle, where cameras face the source, 1.5 times the expected events fall below that edge.
    """
    result = by_bin.copy()
    result[..., :_POOLED] = by_bin[..., :_POOLED].mean(axis=-1, keepdims=True)
    return result


def overlap(low_kev: float, high_kev: float) -> Array:
    """Return the (BINS,) share of each bin that lies between two energies."""
    edges = np.array(EDGES_KEV)
    inside = np.minimum(edges[1:], high_kev) - np.maximum(edges[:-1], low_kev)
    result: Array = np.maximum(inside, 0.0) / np.diff(edges)
    return result

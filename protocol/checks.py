"""Consistency checks on the numbers of a message, apart from their ranges."""

from __future__ import annotations

import math
from collections.abc import Sequence


def is_unit(vector: Sequence[float]) -> bool:
    """Return whether a direction or quaternion has the norm 1, within the rounding of single precision."""
    return abs(math.hypot(*vector) - 1.0) < 1e-3


def flaw_of_covariance(rows: Sequence[Sequence[float]]) -> str | None:
    """Return why a square matrix (given by rows) is no covariance matrix; None if it is one, within rounding.

    Checked are the signs of the variances, the symmetry and the size of the correlations.
    """
    if any(row[place] < 0.0 for place, row in enumerate(rows)):
        return "a variance is negative"
    for i, row in enumerate(rows):
        for j in range(i):
            largest = math.sqrt(row[i] * rows[j][j])
            if abs(row[j] - rows[j][i]) > 1e-6 * largest:
                return "its covariance is not symmetric"
            if abs(row[j]) > 1.000001 * largest:
                return "a correlation is greater than 1"
    return None

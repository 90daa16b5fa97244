"""Regions of a Gaussian posterior over the plane that contain the source with a given probability."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse
from numpy.typing import NDArray

from radron.sim.figures.style import ESTIMATE

REGIONS = ((0.9, 0.10), (0.5, 0.18))  # probability, and opacity


def draw_regions(axes: Axes, centre: tuple[float, float], covariance: NDArray[np.float64]) -> None:
    """Draw the ellipses that contain the source with probabilities of 50 % and 90 %.

    ``centre``: estimated position. ``covariance``: (2, 2).
    """
    variances, vectors = np.linalg.eigh(covariance)
    angle_deg = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
    for probability, alpha in REGIONS:
        across, along = 2.0 * np.sqrt(-2.0 * np.log(1.0 - probability) * np.maximum(variances, 0.0))
        for filled in (True, False):
            axes.add_patch(
                Ellipse(
                    centre, float(along), float(across), angle=angle_deg, fill=filled, facecolor=ESTIMATE,
                    edgecolor="none" if filled else ESTIMATE, alpha=alpha if filled else 1.0, linewidth=0.9, zorder=3,
                )
            )  # fmt: skip


def reach_m(covariance: NDArray[np.float64]) -> float:
    """Return the largest distance of the 90 % region's outline from its centre."""
    return float(np.sqrt(-2.0 * np.log(0.1) * max(float(np.linalg.eigvalsh(covariance)[-1]), 0.0)))

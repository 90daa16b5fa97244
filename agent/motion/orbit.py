"""How near to encircle a source, and how high: by what is known of it. A camera learns about as the inverse fourth power of the
distance, so the nearer the better; but not nearer than the hypothesis is known, for then the source is outside of the circle.
"""

from __future__ import annotations

from math import sqrt

from agent.config import EncirclementConfig
from agent.motion.informative import BACKGROUND_PS, HITS_PER_BQ

_RADIUS_MPS = 2.0  # at most; the tracker follows, and neighbours that change at different times keep apart
_HEIGHT_MPS = 0.5
_TIME_S = 1.5  # time constant in the end
_LONGEST_S = 1.0  # without an update; as if it had been so long
_OVER_FLOOR_M = 0.8  # what gusts and turns take is up to 0.5 m
_WIDEST_M = 40.0
_CLEAR_OF_BACKGROUND = 4.0  # times the background: what a source should count at least


class Orbit:
    """Radius and height of one drone's circle; they change gradually. At first those configured."""

    def __init__(self, config: EncirclementConfig, floor_m: float) -> None:
        """``floor_m``: least height above the ground."""
        self._config = config
        self._lowest_m = min(floor_m + _OVER_FLOOR_M, config.height_m)
        self._nearest_m = min(config.nearest_m, config.radius_m)
        self.radius_m, self.height_m = config.radius_m, config.height_m
        self._stamp_ns: int | None = None

    def update(self, now_ns: int, rms_m: float, activity_bq: float | None, lost: bool = False) -> None:
        """Come nearer to the circle that is best now.

        Args:
            now_ns: UTC.
            rms_m: of the hypothesis.
            activity_bq: of the source, where known.
            lost: the circle may be wider than configured: the source is within ``rms_m``, not more is known.
        """
        elapsed_s = 0.0 if self._stamp_ns is None else min((now_ns - self._stamp_ns) * 1e-9, _LONGEST_S)
        self._stamp_ns = now_ns
        radius_m = min(max(rms_m, self._nearest_m), _WIDEST_M) if lost else self._radius(rms_m, activity_bq)
        height_m = max(self._lowest_m, self._config.height_m * min(radius_m / self._config.radius_m, 1.0))
        self.radius_m += _step(radius_m - self.radius_m, _RADIUS_MPS, elapsed_s)
        self.height_m += _step(height_m - self.height_m, _HEIGHT_MPS, elapsed_s)

    def _radius(self, rms_m: float, activity_bq: float | None) -> float:
        """As near as the hypothesis is known; and where that is not near enough for so weak a source to be seen, nearer."""
        most = self._config.radius_m
        if activity_bq is not None:
            most = min(most, sqrt(HITS_PER_BQ * activity_bq / (_CLEAR_OF_BACKGROUND * BACKGROUND_PS)))
        return max(self._nearest_m, min(self._nearest_m + rms_m, most))


def _step(way: float, most_mps: float, elapsed_s: float) -> float:
    """So much of the way in this time: at most at that speed, and slowly at the end, so that the vehicle does not overshoot."""
    return min(max(way / _TIME_S, -most_mps), most_mps) * elapsed_s

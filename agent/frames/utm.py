"""From UTM coordinates to latitude and longitude, WGS84: maps and elevation models come in them.

Krueger's series to the fourth order in the third flattening (Karney 2011, "Transverse Mercator with an accuracy of a few
nanometers", eq. 7-11 and 36): within a zone wrong by micrometres.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SEMI_MAJOR_M, _FLATTENING = 6378137.0, 1.0 / 298.257223563
_SCALE, _FALSE_EAST_M, _FALSE_NORTH_M = 0.9996, 500_000.0, 10_000_000.0
_N = _FLATTENING / (2.0 - _FLATTENING)
_RADIUS_M = _SEMI_MAJOR_M / (1.0 + _N) * (1.0 + _N**2 / 4.0 + _N**4 / 64.0)
_UNBEND = (
    _N / 2.0 - 2.0 / 3.0 * _N**2 + 37.0 / 96.0 * _N**3 - _N**4 / 360.0,
    _N**2 / 48.0 + _N**3 / 15.0 - 437.0 / 1440.0 * _N**4,
    17.0 / 480.0 * _N**3 - 37.0 / 840.0 * _N**4,
    4397.0 / 161280.0 * _N**4,
)
_GEODETIC = (
    2.0 * _N - 2.0 / 3.0 * _N**2 - 2.0 * _N**3 + 116.0 / 45.0 * _N**4,
    7.0 / 3.0 * _N**2 - 8.0 / 5.0 * _N**3 - 227.0 / 45.0 * _N**4,
    56.0 / 15.0 * _N**3 - 136.0 / 35.0 * _N**4,
    4279.0 / 630.0 * _N**4,
)


def geodetic_from_utm(zone: int, south: bool, east_m: Array, north_m: Array) -> tuple[Array, Array]:
    """Latitude and longitude (degrees) of eastings and northings (...) in a zone 1 .. 60 of the northern or southern half."""
    xi = (north_m - (_FALSE_NORTH_M if south else 0.0)) / (_SCALE * _RADIUS_M)
    eta = (east_m - _FALSE_EAST_M) / (_SCALE * _RADIUS_M)
    straight, across = xi.copy(), eta.copy()
    for j, term in enumerate(_UNBEND, start=1):
        straight -= term * np.sin(2 * j * xi) * np.cosh(2 * j * eta)
        across -= term * np.cos(2 * j * xi) * np.sinh(2 * j * eta)
    conformal = np.arcsin(np.sin(straight) / np.cosh(across))
    latitude = conformal + sum(term * np.sin(2 * j * conformal) for j, term in enumerate(_GEODETIC, start=1))
    longitude = np.arctan2(np.sinh(across), np.cos(straight))
    return np.degrees(latitude), (np.degrees(longitude) + 6.0 * zone - 183.0 + 180.0) % 360.0 - 180.0

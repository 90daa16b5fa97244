"""From the mission frame back to geodetic coordinates: the inverse that tests check conversions with."""

import numpy as np
import pymap3d


def geodetics_from_mission(datum, points):
    """Latitudes, longitudes (degrees, -180 .. 180) and heights above the ellipsoid (..., 3) of points (..., 3)."""
    place = datum.latitude_deg, datum.longitude_deg, datum.altitude_m
    return np.stack(pymap3d.enu2geodetic(points[..., 0], points[..., 1], points[..., 2], *place), axis=-1)


def geodetic_from_mission(datum, point):
    return tuple(geodetics_from_mission(datum, np.array(point)).tolist())

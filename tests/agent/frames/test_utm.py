import numpy as np
import pytest

from agent.frames.utm import geodetic_from_utm

# zone, south, east, north, longitude, latitude: by pyproj 3.7.2, Transformer.from_crs(4326, 32600 (south: 32700) + zone)
KNOWN = [
    (33, False, 464240.924111, 5549868.957358, 14.5, 50.1),
    (33, False, 712100.793009, 5431508.447966, 17.9, 49.0),
    (19, True, 472102.339045, 6304327.387083, -69.3, -33.4),
    (1, False, 395727.639176, 7902201.671985, -179.9, 71.2),
    (60, False, 778272.522942, 33190.819606, 179.5, 0.3),
    (33, True, 177163.806005, 9999889.327266, 12.1, -0.001),
]


@pytest.mark.parametrize(("zone", "south", "east", "north", "longitude", "latitude"), KNOWN)
def test_places_are_where_another_implementation_has_them(zone, south, east, north, longitude, latitude):
    found = geodetic_from_utm(zone, south, np.array([east]), np.array([north]))
    assert found[0][0] == pytest.approx(latitude, abs=2e-11)  # 2 micrometres; the figures have one
    assert found[1][0] == pytest.approx(longitude, abs=5e-11)

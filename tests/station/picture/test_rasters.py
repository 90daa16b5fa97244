import base64
from types import MappingProxyType

import msgspec
import numpy as np
import pytest

from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from radron.agent.fusion.estimator import Hypothesis, Outlook
from radron.agent.fusion.posterior import Posterior
from radron.station.picture.frame import Raster
from radron.station.picture.rasters import Rasters

MISSION = MissionConfig(
    name="m", area=AreaConfig(polygon_m=((0.0, 0.0), (60.0, 0.0), (60.0, 40.0), (0.0, 40.0))), drones=(DroneInMission(id="d1"),)
)
RASTERS = Rasters(MISSION)


def values_of(raster):
    values = np.frombuffer(base64.b64decode(raster.values), np.uint8)
    assert len(values) == raster.columns * raster.rows
    return values.reshape(raster.rows, raster.columns).astype(float)


def centres(raster):
    x = raster.origin[0] + raster.cell_m * (np.arange(raster.columns) + 0.5)
    y = raster.origin[1] + raster.cell_m * (np.arange(raster.rows) + 0.5)
    return np.meshgrid(x, y)


def track(*places, covariance=((4.0, 1.0), (1.0, 2.0))):
    weight = np.full(len(places), 1.0 / len(places))
    return Posterior("sum", 0, np.array(places, dtype=float), weight, np.array([covariance] * len(places)))


def found(place=(20.0, 30.0), activity_bq=1e9):
    position = np.array([*place, 0.0])
    return Hypothesis(0, position, np.eye(3), np.zeros(3), 10, 0, activity_bq, 1e8, None, MappingProxyType({}))


@pytest.mark.parametrize("places", [((20.0, 30.0),), ((20.0, 30.0), (26.0, 30.0))])
def test_the_belief_of_a_track_adds_up_to_one_and_is_highest_where_it_should(places):
    raster = RASTERS.belief(track(*places), 5)
    density = values_of(raster) * raster.scale / 255.0
    assert density.sum() * raster.cell_m**2 == pytest.approx(1.0, abs=0.02)
    row, column = np.unravel_index(density.argmax(), density.shape)
    x, y = centres(raster)
    assert min(np.hypot(x[row, column] - px, y[row, column] - py) for px, py in places) < raster.cell_m
    assert raster.at_ms == 5


def grid_of(cells, sides_m, weight, none):
    spread = sides_m[:, None, None] ** 2 / 12.0 * np.eye(2)
    return Posterior("grid", 0, cells, weight, spread, none=none)


def test_large_cells_around_the_area_have_their_own_density():
    cells, sides_m = np.array([[1.25, 1.25], [3.75, 1.25], [-5.0, 5.0]]), np.array([2.5, 2.5, 10.0])
    raster = RASTERS.belief(grid_of(cells, sides_m, np.array([0.1, 0.2, 0.6]), 0.1), 0)
    density, (x, y) = (values_of(raster) * raster.scale / 255.0).ravel(), map(np.ravel, centres(raster))
    assert density[np.hypot(x + 9.0, y - 9.0).argmin()] == pytest.approx(0.6 / 100.0, rel=0.1)
    assert density[np.hypot(x - 3.75, y - 1.25).argmin()] == pytest.approx(0.2 / 6.25, rel=0.1)
    assert density.sum() * raster.cell_m**2 == pytest.approx(0.9, rel=0.1)


def test_the_belief_of_a_search_covers_the_area_and_adds_up_to_its_probability():
    x, y = np.meshgrid(np.arange(1.25, 60.0, 2.5), np.arange(1.25, 40.0, 2.5))
    cells = np.column_stack((x.ravel(), y.ravel()))
    posterior = grid_of(cells, np.full(len(cells), 2.5), np.full(len(cells), 0.6 / len(cells)), none=0.4)
    raster = msgspec.json.decode(msgspec.json.encode(RASTERS.belief(posterior, 0)), type=Raster)  # as the page gets it
    density = values_of(raster) * raster.scale / 255.0
    assert density.sum() * raster.cell_m**2 == pytest.approx(0.6, rel=0.1)
    assert values_of(raster).max() < 100  # nothing is known: faintly everywhere
    x, y = centres(raster)
    assert not density[(x < -3.0) | (x > 63.0) | (y < -3.0) | (y > 43.0)].any()


def test_the_dose_raster_tells_the_rates_in_steps_of_a_32nd_of_a_decade():
    posterior = track((20.0, 30.0), covariance=((1e-4, 0.0), (0.0, 1e-4)))
    raster = RASTERS.dose(posterior, found(), None, 0)
    x, y = centres(raster)
    expected = 90.9 / ((x - 20.0) ** 2 + (y - 30.0) ** 2 + 1.0)
    assert 1e-3 * 10 ** (values_of(raster) / 32.0) == pytest.approx(expected, rel=0.04)
    assert (raster.origin, raster.columns * raster.cell_m) == ((-30.0, -30.0), pytest.approx(120.0, rel=0.01))  # to the fence


def test_a_search_has_a_dose_rate_too():
    cells, weight = np.array([[10.0, 10.0], [50.0, 30.0]]), np.array([0.5, 0.3])
    outlook = Outlook(cells, np.full(2, 2.5), np.ones(2, np.bool_), weight, np.array([1e9, 2e9]), 0.2, None)
    raster = RASTERS.dose(Posterior("grid", 0, cells, weight, np.zeros((2, 2, 2)), 0.2), None, outlook, 0)
    x, y = centres(raster)
    rates = 0.5 * 90.9 / ((x - 10.0) ** 2 + (y - 10.0) ** 2 + 1.0) + 0.6 * 90.9 / ((x - 50.0) ** 2 + (y - 30.0) ** 2 + 1.0)
    assert 1e-3 * 10 ** (values_of(raster) / 32.0) == pytest.approx(rates, rel=0.04)


def test_without_an_activity_there_is_no_dose_rate():
    assert RASTERS.dose(track((20.0, 30.0)), found(activity_bq=None), None, 0) is None

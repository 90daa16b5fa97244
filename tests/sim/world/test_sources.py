"""Several true sources: configured and drawn ones."""

import itertools
import math

import numpy as np
import pytest
from msgspec.structs import replace
from shapely import Point, Polygon

from radron.agent.errors import ConfigError
from radron.sim.scenario import load_scenario
from radron.sim.world.sources import Sources, place_of
from radron.sim.world.sourcetruth import RandomSourcesTruth, SourceTruth
from radron.sim.world.streams import streams
from radron.sim.world.terrain import HillTruth, TerrainTruth

MANY = load_scenario("many-ideal")


def drawn(scenario, seed):
    return Sources(scenario, 600.0, streams(seed, 3)).at(0.0)


@pytest.mark.parametrize("name", ["many-ideal", "many-contrast", "many-high"])
def test_drawn_sources_keep_the_distances_that_their_nuclides_and_activities_ask_for(name):
    scenario = load_scenario(name)
    truth, area = scenario.random_sources, Polygon(scenario.mission.area.polygon_m)
    numbers = set()
    for seed in range(60):
        sources = drawn(scenario, seed)
        numbers.add(len(sources))
        for source in sources:
            assert source.nuclide in truth.nuclides
            assert truth.activity_bq[0] <= source.activity_bq <= truth.activity_bq[1]
            assert truth.height_m[0] <= source.place_m[2] <= truth.height_m[1]
            assert area.contains(Point(source.place_m[:2]))
        for one, other in itertools.combinations(sources, 2):
            apart_m = math.dist(one.place_m[:2], other.place_m[:2])
            assert one.nuclide != other.nuclide or apart_m >= 5.0
            contrast = max(one.activity_bq / other.activity_bq, other.activity_bq / one.activity_bq)
            assert contrast <= 10.0 or apart_m >= 20.0
    assert numbers == set(range(truth.least, truth.most + 1))


def test_a_seed_draws_the_same_sources_and_another_one_others():
    assert drawn(MANY, 1) == drawn(MANY, 1) != drawn(MANY, 2)


def test_further_sources_change_nothing_about_the_first():
    static = load_scenario("ideal-moving-swarm")
    alone = Sources(static, 100.0, streams(7, 3))
    more = replace(static, sources=(SourceTruth(activity_bq=1e9, nuclide="Co-60"),), random_sources=MANY.random_sources)
    beside = Sources(more, 100.0, streams(7, 3))
    assert [beside.at(time_s)[0] for time_s in (0.0, 31.7)] == [alone.at(time_s)[0] for time_s in (0.0, 31.7)]
    assert beside.at(31.7)[1:] == beside.at(0.0)[1:]
    assert beside.at(0.0)[1].nuclide == "Co-60"
    assert place_of(beside.at(31.7)) == alone.at(31.7)[0].place_m[:2]


def test_a_source_above_ground_is_above_the_ground_below_it():
    hill = TerrainTruth(hills=(HillTruth(centre_m=(50.0, 50.0), height_m=8.0),))
    high = SourceTruth(activity_bq=1e9, start_m=(50.0, 50.0), height_m=6.5)
    (source,) = drawn(replace(MANY, terrain=hill, source=high, random_sources=None), 1)
    assert source.place_m == pytest.approx((50.0, 50.0, 14.5))
    assert drawn(replace(MANY, random_sources=None), 1) == ()
    assert place_of(()) is None


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"nuclides": ("Cs-137", "Cs-173")}, r"file: random_sources.nuclides: unknown nuclide 'Cs-173'; known: .*Cs-137"),
        ({"least": 3, "most": 2}, "file: random_sources.least and most: 3 is more than 2; give the smaller one first"),
        ({"activity_bq": (2e9, 1e9)}, r"random_sources.activity_bq: 2e\+09 is more than 1e\+09"),
        ({"height_m": (5.0, 2.0)}, "random_sources.height_m: 5 is more than 2"),
        ({"apart_m": 40.0}, "random_sources: the area of 10000 m2 has no room for 6 sources 40 m apart"),
    ],
)
def test_what_cannot_be_drawn_is_refused(values, message):
    truth = replace(RandomSourcesTruth(activity_bq=(1e9, 2e9)), **values)
    with pytest.raises(ConfigError, match=message):
        truth.check(Polygon([(0, 0), (100, 0), (100, 100), (0, 100)]), "file")


def test_the_densest_random_sources_that_are_accepted_find_their_places():
    dense = replace(RandomSourcesTruth(activity_bq=(1e9, 1e9), least=8, most=8), apart_m=25.0)
    dense.check(Polygon(MANY.mission.area.polygon_m), "file")
    places = np.array([source.place_m for source in drawn(replace(MANY, random_sources=dense), 3)])
    assert min(math.dist(one, other) for one, other in itertools.combinations(places, 2)) >= 25.0

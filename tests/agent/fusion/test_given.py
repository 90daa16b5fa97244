import pytest

from radron.agent.config.estimators import GivenHypothesisConfig
from radron.agent.errors import ConfigError
from radron.agent.fusion.given import GivenEstimator
from support.flights.fusions import fusion_of


@pytest.fixture
def fusion(kit):
    mission = kit.mission_of(estimator="given", schedule=((2.0, 10.0, 20.0), (60.0, 20.0, 20.0)))
    return fusion_of(mission)


def place_at(kit, fusion, time_s):
    fusion.advance(kit.T0_NS + round(time_s * 1e9))
    return None if fusion.hypothesis is None else tuple(fusion.hypothesis.position)


def test_it_follows_the_schedule_from_the_missions_start(kit, fusion):
    assert place_at(kit, fusion, 1.0) is None
    fusion.start(kit.T0_NS + 10_000_000_000)
    assert place_at(kit, fusion, 11.9) is None
    assert place_at(kit, fusion, 12.0) == (10.0, 20.0, 0.0)
    assert place_at(kit, fusion, 69.9) == (10.0, 20.0, 0.0)
    assert place_at(kit, fusion, 70.0) == (20.0, 20.0, 0.0)
    assert place_at(kit, fusion, 500.0) == (20.0, 20.0, 0.0)
    assert fusion.hypothesis.x0_stamp_ns == kit.T0_NS + 12_000_000_000
    assert not fusion.hypothesis.covariance.any()


def test_a_later_start_begins_anew_and_an_earlier_one_does_not_count(kit, fusion):
    fusion.start(kit.T0_NS)
    assert place_at(kit, fusion, 2.0) == (10.0, 20.0, 0.0)
    fusion.start(kit.T0_NS + 10_000_000_000)
    assert place_at(kit, fusion, 11.9) is None
    fusion.start(kit.T0_NS)
    assert place_at(kit, fusion, 11.9) is None
    assert place_at(kit, fusion, 12.0) == (10.0, 20.0, 0.0)


def test_cones_change_nothing(kit, fusion):
    mission = kit.mission_of(estimator="given", schedule=((2.0, 10.0, 20.0), (60.0, 20.0, 20.0)))
    fusion.start(kit.T0_NS)
    assert all(kit.feed(fusion, [kit.cone_entry(mission, 3.0, (0.0, 0.0, 3.0), (1.0, 0.0, 0.0), 1.0)]))
    assert place_at(kit, fusion, 5.0) == (10.0, 20.0, 0.0)
    assert len(fusion.log) == 1


@pytest.mark.parametrize("schedule", [((5.0, 0.0, 0.0), (1.0, 0.0, 0.0)), ((5.0, 0.0, 0.0), (5.0, 1.0, 0.0))])
def test_times_must_ascend(schedule):
    with pytest.raises(ConfigError, match=r"fusion\.given\.schedule: times must ascend"):
        GivenEstimator(GivenHypothesisConfig(schedule=schedule))

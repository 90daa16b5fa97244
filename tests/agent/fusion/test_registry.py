import pytest

from radron.agent.errors import ConfigError
from radron.agent.fusion.registry import ESTIMATORS, estimator_named


def test_every_estimator_carries_its_name(kit):
    mission = kit.mission_of(schedule=((0.0, 1.0, 2.0),))
    assert [estimator_named(name, mission).name for name in ESTIMATORS] == [
        "paper",
        "paper-geometric",
        "bayes",
        "sources",
        "field",
        "given",
    ]


def test_the_name_is_the_projection_rule(kit):
    assert estimator_named("paper", kit.mission_of())._rule == "paper"
    assert estimator_named("paper-geometric", kit.mission_of())._rule == "geometric"


def test_what_is_wrong_is_said(kit):
    with pytest.raises(
        ConfigError, match="unknown estimator 'bayse'; known: paper, paper-geometric, bayes, sources, field, given"
    ):
        estimator_named("bayse", kit.mission_of())
    with pytest.raises(ConfigError, match=r"needs fusion\.given\.schedule"):
        estimator_named("given", kit.mission_of())

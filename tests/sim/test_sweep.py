"""Sweeps: their options on the command line, and the resulting cases."""

from __future__ import annotations

import pytest

from radron.agent.errors import ConfigError
from radron.sim.sweep import cases, parse_settings, parse_sweep, without_effect


def test_values_keep_their_order_and_kind() -> None:
    assert parse_sweep(["radius_m=12,8,10.5", "drones=1,3"]) == {"radius_m": (12, 8, 10.5), "drones": (1, 3)}
    assert parse_sweep(["mission.encirclement.law=paper, smooth"]) == {"mission.encirclement.law": ("paper", "smooth")}
    assert parse_settings(["speed_mps=4", "source.activity_bq=2e9"]) == {"speed_mps": 4, "source.activity_bq": 2e9}


@pytest.mark.parametrize("text", ["radius_m", "radius_m=", "=8", "radius_m=8,,9", "radius_m=8,8", "radius_m=8,8.0"])
def test_what_is_no_sweep(text: str) -> None:
    with pytest.raises(ConfigError, match="--sweep"):
        parse_sweep([text])


def test_a_parameter_given_twice() -> None:
    with pytest.raises(ConfigError, match="given twice"):
        parse_sweep(["radius_m=8", "radius_m=9"])


def test_every_scenario_at_every_point() -> None:
    found = cases(["paper-static-swarm", "paper-moving-swarm"], parse_sweep(["radius_m=8,12", "drones=2,3,4"]))
    assert len(found) == 12
    assert found[4].label == "paper-static-swarm radius_m=12 drones=3"
    assert found[4].scenario.mission.encirclement.radius_m == 12.0
    assert [len(case.scenario.mission.drones) for case in found[:3]] == [2, 3, 4]
    assert len({case.key for case in found}) == 12


def test_settings_hold_at_every_point() -> None:
    found = cases(["paper-static-swarm"], parse_sweep(["radius_m=8,12"]), parse_settings(["source.activity_bq=1e9"]))
    assert [case.scenario.source and case.scenario.source.activity_bq for case in found] == [1e9, 1e9]


@pytest.mark.parametrize(
    ("names", "sweep", "named"),
    [
        (["paper-static-swarn"], [], "unknown scenario 'paper-static-swarn'"),
        (["paper-static-swarm"], ["radios_m=8"], "radios_m"),
        (["paper-static-swarm"], ["radius_m=8,-1"], "radius_m"),
        (["paper-static-swarm"], ["drones=0"], "drones"),
        (["paper-static-swarm", "paper-static-swarm"], [], "each scenario once"),
    ],
)
def test_what_cannot_be_flown_is_told_before_anything_flies(names: list[str], sweep: list[str], named: str) -> None:
    with pytest.raises(ConfigError, match=named) as caught:
        cases(names, parse_sweep(sweep))
    assert "\n" not in str(caught.value)


def notes(scenario: str, key: str, estimator: str | None = None, law: str | None = None) -> list[str]:
    return without_effect(cases([scenario], {key: (8, 10)}), (), estimator, law)


def test_a_radius_that_follows_the_estimate_is_told() -> None:
    (note,) = notes("demo", "radius_m")
    assert "mission.encirclement.nearest_m" in note
    assert notes("demo", "mission.encirclement.radius_m")
    assert not notes("demo", "radius_m", estimator="paper")
    assert not notes("demo", "radius_m", law="paper")
    assert not notes("demo", "mission.encirclement.nearest_m")
    assert notes("demo", "mission.encirclement.nearest_m", law="paper")


def test_parameters_of_another_estimator_are_told() -> None:
    assert notes("demo", "mission.fusion.paper.process_noise_m2ps")
    assert not notes("demo", "mission.fusion.paper.process_noise_m2ps", estimator="paper-geometric")
    assert notes("demo", "mission.fusion.bayes.velocity_mps", estimator="paper")
    assert without_effect(cases(["demo"], {}), ["mission.fusion.paper.process_noise_m2ps"], None, None)

"""Reasons against a flight that are found in the files alone."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from radron.agent.config.drone import DetectorConfig, DroneConfig
from radron.agent.config.estimators import FusionConfig, GivenHypothesisConfig
from radron.agent.config.launchplaces import check_launch_places
from radron.agent.config.mission import AreaConfig, DroneInMission, LimitsConfig, MissionConfig
from radron.agent.errors import ConfigError
from radron.agent.shell.startable import camera_missing, check_for_drone

AREA = AreaConfig(polygon_m=((0.0, 0.0), (50.0, 0.0), (50.0, 50.0), (0.0, 50.0)))


def mission(*places: tuple[float, float], separation_m: float = 3.0, **drone: object) -> MissionConfig:
    drones = tuple(
        DroneInMission(**{"id": f"d{number}", "origin_m": (*place, 0.0), **drone}) for number, place in enumerate(places, 1)
    )
    return MissionConfig(name="test", drones=drones, area=AREA, limits=LimitsConfig(separation_m=separation_m))


def refusal(of: MissionConfig) -> str:
    with pytest.raises(ConfigError) as found:
        check_launch_places(of, "yard.toml")
    return str(found.value)


def test_drones_apart_and_inside_may_fly() -> None:
    check_launch_places(mission((10.0, 2.0), (16.0, 2.0), (25.0, -29.0)), "yard.toml")


def test_two_at_one_place_may_not() -> None:
    text = refusal(mission((10.0, 2.0), (16.0, 2.0), (10.0, 2.0)))
    assert text.startswith("yard.toml: drones: d1 and d3 are launched 0.0 m apart, which is less than limits.separation_m = 3; ")
    assert "5.0 m apart" in refusal(mission((10.0, 2.0), (15.0, 2.0), separation_m=6.0))


def test_places_that_the_mission_does_not_know_say_nothing() -> None:
    lost = mission((0.0, 0.0), (0.0, 0.0), (60.0, 90.0), localization="slam", origin_sigma_m=20.0)
    check_launch_places(lost, "yard.toml")
    assert "0.0 m apart" in refusal(mission((0.0, 0.0), (0.0, 0.0), localization="gnss"))


def test_a_drone_without_a_camera_cannot_search() -> None:
    yard = mission((10.0, 2.0))
    assert camera_missing(DroneConfig(id="d1", detector=DetectorConfig(driver="pypixet")), yard) is None
    assert "cannot search" in str(camera_missing(DroneConfig(id="d1"), yard))
    given = FusionConfig(estimator="given", given=GivenHypothesisConfig(schedule=((0.0, 1.0, 1.0),)))
    exercise = MissionConfig(name="test", drones=yard.drones, area=AREA, fusion=given)
    assert camera_missing(DroneConfig(id="d1"), exercise) is None


@pytest.mark.parametrize("estimator", ["bayes", "sources"])
def test_a_drone_flies_by_any_estimator_that_there_is(estimator: str) -> None:
    check_for_drone(replace(mission((10.0, 2.0)), fusion=FusionConfig(estimator=estimator)), "d1", "yard.toml")


def test_an_estimator_that_nobody_knows_is_one_line() -> None:
    with pytest.raises(ConfigError, match=r"^yard.toml: fusion.estimator: unknown estimator 'bayse'; known: "):
        check_for_drone(replace(mission((10.0, 2.0)), fusion=FusionConfig(estimator="bayse")), "d1", "yard.toml")

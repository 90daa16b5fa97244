"""Preflight: the launch place by the autopilot's geodetic origin, against the mission's layout."""

import pytest
from msgspec.structs import replace

from radron.agent.config.mission import AreaConfig, DatumConfig, DroneInMission, MissionConfig
from radron.agent.preflight.layout import layout_finding
from radron.agent.vehicle.interface import LaunchPlace
from support.flights.geodetic import geodetic_from_mission

DATUM = DatumConfig(latitude_deg=50.1, longitude_deg=14.5, altitude_m=230.0)
AREA = AreaConfig(polygon_m=((0.0, 0.0), (60.0, 0.0), (60.0, 40.0)))


def mission(datum=DATUM, **drone):
    drones = (DroneInMission(**{"id": "d1", "origin_m": (20.0, 5.0, 0.0), "localization": "gnss", **drone}),)
    return MissionConfig(name="test", drones=drones, area=AREA, datum=datum)


def place(x, y):
    """The launch place of a vehicle standing there; its autopilot was switched on 300 m east of the mission's datum."""
    latitude, longitude, altitude = geodetic_from_mission(DATUM, (300.0, 0.0, 0.0))
    return LaunchPlace(
        north_m=y, east_m=x - 300.0, down_m=0.0,
        origin_latitude_deg=latitude, origin_longitude_deg=longitude, origin_altitude_m=altitude,
    )  # fmt: skip


def test_a_vehicle_that_stands_where_it_should_is_ok():
    finding = layout_finding(mission(), "d1", place(22.0, 4.0))
    assert finding.verdict == "ok"
    assert "(22.0, 4.0) m in the mission frame, 2.2 m from" in finding.text


def test_one_that_stands_elsewhere_is_not():
    finding = layout_finding(mission(), "d1", place(50.0, 4.0))
    assert finding.verdict == "failed"
    assert "30.0 m from" in finding.text
    assert layout_finding(mission(origin_sigma_m=15.0), "d1", place(50.0, 4.0)).verdict == "ok"


def test_a_frame_that_satellites_would_not_turn_is_named():
    finding = layout_finding(mission(yaw_deg=90.0), "d1", place(20.0, 5.0))
    assert finding.verdict == "failed"
    assert "turned by -90 degrees" in finding.text


@pytest.mark.parametrize("case", ["no datum", "slam", "no place", "no origin"])
def test_where_there_is_nothing_to_compare_there_is_no_finding(case):
    here = place(50.0, 4.0)
    told = {"no place": None, "no origin": replace(here, origin_latitude_deg=None)}.get(case, here)
    flown = {"no datum": mission(datum=None), "slam": mission(localization="slam")}.get(case, mission())
    assert layout_finding(flown, "d1", told) is None

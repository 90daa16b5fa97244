"""How much of the area the swarm has covered, in the report."""

import asyncio
import math

import pytest

from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from radron.agent.config.survey import SurveyConfig
from radron.protocol.entries import Coverage
from radron.station.findings.facts import Source, facts_of
from radron.station.findings.html import report_html
from radron.station.hub import Hub
from radron.station.picture.picture import Picture
from support.page import shown_drone
from support.page.shown_drone import D1, NOW_NS

MISSION = MissionConfig(
    name="m",
    area=AreaConfig(polygon_m=((0.0, 0.0), (60.0, 0.0), (60.0, 40.0), (0.0, 40.0))),
    drones=(D1, DroneInMission(id="d2")),
    survey=SurveyConfig(lane_spacing_m=10.0),
)


def findings(*paths_m):
    picture = Picture(MISSION, None)
    for number, path_m in enumerate(paths_m):
        given = {"stamp_ns": NOW_NS + number, "drone": "d1", "mission": MISSION.mission_id, "boot": "0" * 16, "sequence": number}
        entry = Coverage(**given, epoch=0, path_m=path_m, swath_m=1000.0)  # the mission's value counts, not a drone's
        shown_drone.give(picture, MISSION, entry)
    picture.advance(NOW_NS + 10**9)
    hub = Hub(picture, replay=True)
    hub.show(NOW_NS + 10**9)
    return asyncio.run(facts_of(hub, Source({"radron": "1"})))


def test_lanes_that_overlap_count_once_and_only_within_the_area():
    """The drone's frame is turned by 90 degrees: its lane leads from (10, 20) to the north, out of the area."""
    found = findings(((0.0, 0.0), (15.0, 0.0)), ((10.0, 0.0), (30.0, 0.0)))
    assert found.surveyed == pytest.approx((10.0 * 20.0 + 0.5 * math.pi * 5.0**2) / (60.0 * 40.0), rel=2e-3)  # arcs have corners
    assert "<th>Surveyed in lanes</th><td>10 % of the area</td>" in report_html(found)


def test_where_no_lanes_were_flown_nothing_is_said_of_them():
    assert findings().surveyed is None
    assert "Surveyed" not in report_html(findings())

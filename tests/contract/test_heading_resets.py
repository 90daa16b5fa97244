"""Resets of the heading alone, in the takeoffs of a stable PX4 v1.16.1: they correct the attitude, and the local frame stays."""

from __future__ import annotations

from functools import cache

import pytest

from radron.agent.frames.graph import FrameGraph
from support.flights.one_pilot import MISSION, own_pose
from support.px4.recorded_flown import MAIN, V1_16, FlownReplay

NEAR_M = 0.6  # error of an estimate in flight, and of the mean on the ground from which it is counted


@cache
def replay(name: str) -> FlownReplay:
    return FlownReplay(name, exact=True).run()


@pytest.mark.parametrize("name", V1_16)
def test_v1_16_resets_its_heading_alone_in_a_takeoff(name: str) -> None:
    (reset,) = replay(name).resets
    assert 1.45 < reset.up_m < 1.8  # at 1.5 m; the climb is 1 m/s, reported at 10 Hz, its truth at 5 Hz
    assert reset.moved_m < 0.1


@pytest.mark.parametrize("name", MAIN)
def test_main_does_not(name: str) -> None:
    assert replay(name).resets == []


@pytest.mark.parametrize("name", V1_16)
def test_a_heading_that_is_reset_alone_turns_no_frame(name: str) -> None:
    flown = replay(name)
    assert [epoch for _, epoch in flown.changes(lambda state: state.epoch)] == [0]
    member = MISSION.drones[0]
    graph = FrameGraph.from_launch_layout(MISSION)
    own = own_pose(member.id, graph, member)
    launch = graph.mission_from_local(member.id, 0)
    for _, state in flown.states:
        own.take(state)
        assert own.frame is not None
        assert own.problems(state.stamp_ns) == ()
        assert own.frame.mission_from_local == launch


@pytest.mark.parametrize("name", V1_16)
def test_the_position_says_that_the_frame_has_not_turned(name: str) -> None:
    """A frame turned by the largest of these resets would be 1.2 m off at the flights' farthest places."""
    assert replay(name).largest_error_m < NEAR_M


@pytest.mark.parametrize("name", V1_16)
def test_nobody_says_that_satellites_were_lost(name: str) -> None:
    flown = replay(name)
    assert all(look.state.position_trusted for look in flown.looks if look.state is not None)
    assert not [text for look in flown.looks for text in look.problems if "satellites" in text or "jumped" in text]


@pytest.mark.parametrize("name", V1_16)
def test_after_a_landing_the_next_mission_is_not_refused(name: str) -> None:
    last = replay(name).looks[-1]
    assert last.state is not None
    assert not last.state.armed
    assert last.state.healthy
    assert [text for text in last.problems if "parameter" not in text] == []

"""The process's reports to its pilot on the parts around it, and their log lines."""

from __future__ import annotations

from unittest.mock import Mock, call

import pytest

from radron.agent.config.drone import DroneConfig, PeerMeshConfig
from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from radron.agent.shell.problems import LATE_S, LATE_STEP_S, LateSteps, Problems, no_contact
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText


@pytest.fixture
def told() -> tuple[Problems, Mock, Mock]:
    """The problems of a pilot, that pilot, and the log."""
    pilot, log = Mock(), Mock()
    return Problems(pilot, log), pilot, log


A, B, C, D = (CodedText(Code.COMPUTER_SLOW, words) for words in "abcd")


def test_the_pilot_is_told_each_kind_when_it_changes(told: tuple[Problems, Mock, Mock]) -> None:
    problems, pilot, _ = told
    for _ in range(3):
        problems.tell([A, None, B], [None], [C])
    problems.tell([], [], [C])
    assert pilot.mock_calls == [call.warn(("a", "b")), call.notice(("c",)), call.warn(())]
    problems.tell([], [D], [C])
    assert pilot.mock_calls[3:] == [call.block(("d",))]


def test_each_is_logged_when_it_begins_and_when_it_is_over(told: tuple[Problems, Mock, Mock]) -> None:
    problems, _, log = told
    problems.tell([A, B], [], [])
    problems.tell([B], [A], [])
    assert log.mock_calls == [
        call.warning("warning", text="a", code="computer-slow"),
        call.warning("warning", text="b", code="computer-slow"),
        call.info("warning is over", text="a", code="computer-slow"),
        call.warning("problem", text="a", code="computer-slow"),
    ]


def test_a_late_step_is_told_for_some_seconds() -> None:
    now_s = [100.0]
    late = LateSteps(lambda: now_s[0])
    late.note(LATE_STEP_S)
    assert late.problems == ()
    late.note(1.01 * LATE_STEP_S)
    assert late.problems == ("the computer is too slow: setpoints were over 0.2 s late in the last 5 s",)
    now_s[0] += 0.99 * LATE_S
    late.note(0.01)
    assert len(late.problems) == 1
    now_s[0] += 0.02 * LATE_S
    assert late.problems == ()


def test_members_that_are_not_on_the_mesh_are_told_with_their_endpoints() -> None:
    members = tuple(DroneInMission(id=f"d{place}", origin_m=(10.0 * place, 0.0, 0.0)) for place in (1, 2, 3, 4))
    mission = MissionConfig(name="test", drones=members, area=AreaConfig(polygon_m=((0.0, 0.0), (50.0, 0.0), (50.0, 50.0))))
    drone = DroneConfig(id="d1", mission="yard.toml", mesh=PeerMeshConfig(endpoints={"d2": "tls/10.0.0.2:7447"}))
    silent = ["no contact with d2 (tls/10.0.0.2:7447)", "no contact with d3 (no endpoint given)"]
    assert no_contact(drone, mission, {"d4"}) == silent
    assert no_contact(drone, mission, {"d2", "d3", "d4", "operator"}) == []

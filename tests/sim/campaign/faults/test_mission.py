"""Missions that are flown: judged, recorded, and ended where nothing more is to be seen."""

import shutil
from pathlib import Path
from typing import Any

import pytest

import radron.sim.lockstep.flight
from radron.agent.pilot import Pilot
from radron.protocol.messages import Stage
from radron.sim.campaign.faults.course import SHORT
from radron.sim.campaign.faults.draw import draw
from radron.sim.campaign.faults.mission import Log, Mission, fly_mission
from radron.sim.campaign.faults.recording import Recording
from radron.sim.scenario import parse_scenario
from radron.sim.scoring.moment import Moment
from support.flights.moments import hypothesis, moment, pilot


def document(*faults):
    return draw(3, SHORT) | {"fault": list(faults)}


def fly_until(end_s: float, make=Pilot, *faults) -> list[Moment]:
    seen = []

    def watch(moment: Moment) -> bool:
        seen.append(moment)
        return moment.time_s > end_s

    radron.sim.lockstep.flight.watched(parse_scenario(document(*faults), "test"), 1, watch, make)
    return seen


def test_an_observer_sees_the_truth_after_every_tick_and_ends_the_flight() -> None:
    kill = {"kind": "kill", "at_s": 1.0, "target": "d2"}
    seen = fly_until(2.0, Pilot, kill)
    assert [moment.time_s for moment in seen[:3]] == pytest.approx([0.05, 0.10, 0.15])
    last = seen[-1]
    assert last.time_s == pytest.approx(2.05)
    assert last.position_m.shape == last.velocity_mps.shape == (3, 3)
    assert last.source is not None
    assert [pilot is None for pilot in last.pilots] == [command is None for command in last.commands] == [False, True, False]
    assert last.autopilots[0].armed
    assert last.autopilots[0].setpoint_age_s is None  # takeoff
    assert last.sent[0] > 0 == last.sent[1]
    assert len(last.batteries) == 3
    assert all(0.5 < level <= 1.0 for level in last.batteries)


def test_the_error_is_that_at_the_end_of_the_able_drones_tracking() -> None:
    """d2 has returned without any link, with an estimate of its own; after the heal it holds the others' estimate again."""
    log, source = Log(3), (30.0, 30.0)
    deaf, healed = (pilot(Stage.RETURN, hypothesis(x)) for x in (35.0, 30.5))
    tracking, lost = pilot(believed=hypothesis(30.5)), pilot(believed=hypothesis(50.0))
    log.see(moment(49.0, source=source, pilots=[tracking, deaf, lost]), None)
    assert log.error_m == pytest.approx([0.5, 5.0, 20.0])
    log.see(moment(55.0, source=source, pilots=[tracking, healed, lost]), (0, 1))
    assert log.error_m == pytest.approx([0.5, 0.5, 20.0])
    log.see(moment(70.0, source=(10.0, 10.0), pilots=[healed, healed, lost]), (0, 1))  # only the third, not able, still tracks
    assert log.error_m == pytest.approx([0.5, 0.5, 20.0])


def test_a_recorded_flight_is_replayed_bit_for_bit(tmp_path: Path) -> None:
    recording = Recording("d1", tmp_path)
    fly_until(1.5, recording.make)
    assert len(list(tmp_path.iterdir())) == 1
    assert recording.differences() == []
    shutil.rmtree(tmp_path)
    (difference,) = recording.differences()
    assert difference.startswith("cannot be replayed")


def test_an_agent_that_starts_late_is_recorded_from_then_on(tmp_path: Path) -> None:
    """In its place stands a pilot of the same boot, which is never flown."""
    recording = Recording("d1", tmp_path)

    def made_twice(*args: Any, **kwargs: Any) -> Pilot:
        recording.make(*args, **kwargs)
        return recording.make(*args, **kwargs)

    fly_until(1.5, made_twice)
    assert len(list(tmp_path.iterdir())) == 1
    assert recording.differences() == []


def test_a_pilot_that_is_not_the_same_again_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recording = Recording("d1", tmp_path)
    fly_until(1.5, recording.make)
    monkeypatch.setattr("radron.agent.mission.stages.REQUESTS", {})
    (difference,) = recording.differences()
    assert "flown" in difference


def test_an_exception_of_an_agent_is_a_violation(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError("in a pilot")

    monkeypatch.setattr(Pilot, "step", fail)
    verdict = fly_mission(Mission(3, SHORT, document()))
    (violation,) = verdict.violations
    assert violation.invariant == "exception"
    assert violation.text.startswith("ZeroDivisionError: in a pilot")

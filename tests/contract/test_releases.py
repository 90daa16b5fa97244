"""The versions of the emulated PX4, each held to the recordings of that version, and the agent with them."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from radron.agent.vehicle.interface import FlightMode
from radron.protocol.messages import Action, Stage
from radron.sim.vehicle.px4.filter.heading import STEP_RAD
from radron.sim.vehicle.px4.mavlink.status import extended_sys_state
from radron.sim.vehicle.px4.mavlink.telemetry import attitude, hil_state, local_position
from radron.sim.vehicle.px4.release import ReleaseName
from radron.sim.world.localization import LocalizationTruth
from support.px4.linked import Solo
from support.px4.recorded_flown import MAIN, V1_16, HeadingReset, Recorded, heading_resets, recorded

SEEDS = range(8)
RECORDED: dict[ReleaseName, tuple[str, ...]] = {"1.16": V1_16, "1.17": MAIN}
LEVEL = LocalizationTruth(vertical_m=0.0, drift_m=0.0)  # heights were right in the recordings, and show where a heading is reset
TOLD_S = 0.1  # between two messages in the recordings


@cache
def taken_off(release: ReleaseName, seed: int) -> tuple[Solo, list[HeadingReset]]:
    """Three seconds into the survey, and the resets of the heading until then, found as in the recordings."""
    solo = Solo(seed, localization=LEVEL, release=release)
    solo.ready()
    solo.order(Action.START)
    messages: list[Recorded] = []
    while solo.pilot.stage is not Stage.SURVEY or solo.states[-1].mode is not FlightMode.OFFBOARD:
        assert solo.time_s < 60.0
        solo.run(TOLD_S)
        told = (extended_sys_state, hil_state, local_position, attitude)
        messages += [Recorded(solo.time_s, build(solo.face._state)) for build in told]
    solo.run(3.0)
    return solo, heading_resets(messages)


@pytest.mark.parametrize("release", RECORDED)
def test_headings_are_reset_in_takeoffs_as_recorded(release: ReleaseName) -> None:
    real = [heading_resets(list(recorded(name))) for name in RECORDED[release]]
    emulated = [taken_off(release, seed)[1] for seed in SEEDS]
    assert max(map(len, emulated)) == max(map(len, real))
    for reset in (reset for flight in (*real, *emulated) for reset in flight):
        assert 1.45 < reset.up_m < 1.8
        assert reset.moved_m < 0.1
    if release == "1.16":
        steps_rad = [abs(reset.step_rad) for flight in emulated for reset in flight]
        assert len(steps_rad) > 0.6 * len(emulated)  # smaller ones are not seen
        assert max(steps_rad) < 0.25  # of 15 recorded ones the largest was 0.163
        drawn = np.abs(np.random.default_rng(1).normal(0.0, STEP_RAD, 1000))
        assert 0.2 < np.mean(drawn > 0.05) < 0.6  # five of 15


@pytest.mark.parametrize("seed", SEEDS)
def test_agent_on_v1_16_keeps_its_frame_and_says_nothing(seed: int) -> None:
    solo, _ = taken_off("1.16", seed)
    assert {state.epoch for state in solo.states} == {0}
    begun_s = solo.began(Stage.TAKEOFF)
    assert begun_s is not None
    assert all(state.position_trusted for state in solo.states[-100:])
    assert [
        status.problems for status in solo.statuses if status.stage in (Stage.TAKEOFF, Stage.SURVEY) and status.problems
    ] == []


def test_agent_on_v1_16_flies_a_second_mission() -> None:
    solo, _ = taken_off("1.16", 1)
    solo.order(Action.RETURN)
    solo.until(lambda: solo.pilot.stage is Stage.LANDED, 90.0)
    solo.until(lambda: solo.told == (), 10.0)
    solo.run(3.0)
    solo.order(Action.START)
    solo.until(lambda: solo.pilot.stage is Stage.SURVEY and solo.states[-1].mode is FlightMode.OFFBOARD, 40.0)
    assert solo.told == ()
    assert {state.epoch for state in solo.states} == {0}


def test_versions_tell_their_numbers() -> None:
    for release, text in (("1.16", "PX4 1.16.1"), ("1.17", "PX4 1.17.0")):
        version = taken_off(release, 1)[0].vehicle.messages.version  # type: ignore[arg-type]
        assert version is not None
        assert version.text == text

"""Flights in which each drone has its own localisation: its pilot's input, and flight by it."""

import numpy as np
import pytest

from radron.agent.pilot import Pilot
from radron.sim.lockstep.flight import fly
from radron.sim.scenario import load_scenario, override

JUMP_S = 9.0


class Listening(Pilot):
    """A pilot that keeps its inputs."""

    def __init__(self, mission, drone, *args, **kwargs):
        super().__init__(mission, drone, *args, **kwargs)
        self.name = drone.id
        self.states, self.fixes, self.seen = [], [], []

    def observe_vehicle(self, state):
        self.states.append(state)
        return super().observe_vehicle(state)

    def observe_fix(self, fix):
        self.fixes.append(fix)
        return super().observe_fix(fix)

    def observe_sightings(self, seen):
        self.seen.extend(seen)
        return super().observe_sightings(seen)


@pytest.fixture(scope="module")
def flight():
    """Eight seconds of search by a GNSS, an RTK and a SLAM drone; the SLAM frame jumps by 15 m and turns on the way."""
    events = [{"at_s": JUMP_S, "jump_m": 15.0, "turn_deg": 40.0}]
    changes = {"localization.vehicles.d3.events": events, "end.search_s": 8.0, "source.activity_bq": 1e3}
    pilots = []

    def listening(*args, **kwargs):
        pilots.append(Listening(*args, **kwargs))
        return pilots[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("radron.sim.lockstep.flight.Pilot", listening)
        done = fly(override(load_scenario("mixed-frames"), changes), seed=4)
    return done, pilots


def test_pilots_are_told_places_in_frames_of_their_own(flight):
    """Position estimates at the start: near the layout's place by satellites; by SLAM in a frame of any heading."""
    _, pilots = flight
    for pilot in pilots:
        x, y, z = pilot.states[0].position_m
        assert np.hypot(x, y) < 6.0
        assert abs(z) < 2.0
    headings = [2.0 * np.arctan2(pilot.states[0].quaternion[3], pilot.states[0].quaternion[0]) for pilot in pilots]
    assert headings[:2] == pytest.approx([0.0, 0.0], abs=1e-6)  # all stand facing east
    assert abs(headings[2]) > 0.1
    assert pilots[0].states[0].position_sigma_m > 1.0
    assert pilots[1].states[0].position_sigma_m < 0.05


def test_fixes_come_to_those_with_satellites_and_sightings_to_all(flight):
    done, pilots = flight
    seconds = done.result.sim_s
    assert [len(pilot.fixes) for pilot in pilots] == pytest.approx([seconds, seconds, 0], abs=1.0)
    for pilot in pilots:
        rate = len(pilot.seen) / (2 * seconds)
        assert 2.0 < rate <= 5.0  # of 5 a second some are missed or hidden
        assert {one.target for one in pilot.seen} == {"d1", "d2", "d3"} - {pilot.name}
    assert pilots[0].fixes[0].latitude_deg == pytest.approx(47.397742, abs=1e-3)


def test_a_frame_that_jumps_is_a_new_epoch_and_shakes_no_vehicle(flight):
    done, pilots = flight
    first, second = (np.array([state.epoch for state in pilot.states]) for pilot in pilots[1:])
    assert not first.any()
    jumped = int(np.argmax(second))
    assert jumped * 0.05 == pytest.approx(JUMP_S, abs=0.11)
    before, after = pilots[2].states[jumped - 1], pilots[2].states[jumped]
    assert np.hypot(*np.subtract(after.position_m, before.position_m)[:2]) == pytest.approx(15.0, abs=0.6)
    trace = done.trace
    near = np.abs(trace.time_s - JUMP_S) < 2.5
    assert np.hypot(*trace.velocity_mps[near, 2, :2].T).max() < 8.5
    assert (
        np.abs(np.diff(trace.velocity_mps[near, 2, :2], axis=0)).max() < 5.0 * 0.2 + 0.1
    )  # the change that its tilt allows between two samples


def test_the_result_says_how_well_frames_are_known(flight):
    done, _ = flight
    assert done.result.frames_known_s is not None
    assert done.result.frames_known_s < 10.0
    assert done.result.fence_breaches == 0

"""Tracks that slide, by little in each keyframe: a slide is told from a sound track, and drags no other drone along."""

import numpy as np
import pytest

from radron.protocol.entries import Fix, Sighting
from support.flights.estimated_frames import DRIFT
from support.flights.sighted_swarm import SECOND, START_NS, Drone, Sensor, fly, run

RTK = {"kind": "rtk", "fixes": True, "yaw_sigma_deg": 5.0, "wander_m": 0.03}
GNSS = {**RTK, "kind": "gnss", "wander_m": 1.0}
SENSOR = Sensor(rate_hz=5.0)


def slide(x_m, y_m, seconds=20.0, **more):
    """From 8 s on."""
    return {"shift_m": (x_m, y_m, 0.0), "shift_s": 8.0, "shift_lasts_s": seconds, **more}


def worst_m(flown, frames, drones, time=44.0):
    return max(np.hypot(*flown.error(frames, drone.id, time)[0][:2]) for drone in drones)


@pytest.mark.parametrize("seed", range(3))
def test_of_three_receivers_the_one_that_slides_is_placed_by_the_others(seed):
    """At 0.7 m/s; all three fixes were left out, and all three places 3.4 m off, halfway between."""
    drones = [Drone("d1", **RTK), Drone("d2", **RTK), Drone("d3", **RTK, **slide(9.0, -12.0))]
    flown = fly(drones, 45.0, seed, SENSOR, datum=True)
    frames = run(flown)
    assert "slid" in frames.suspects()["d3"]
    assert worst_m(flown, frames, drones) < 0.6


@pytest.mark.parametrize("seed", range(3))
def test_two_that_slide_in_different_directions_drag_nobody(seed):
    """A receiver and a SLAM, against one of each: 4.4 m."""
    drones = [Drone("d1", **RTK), Drone("d2", **RTK, **slide(-7.0, -5.3)), Drone("d3", **DRIFT)]
    drones += [Drone("d4", **DRIFT, **slide(2.5, 8.4))]
    flown = fly(drones, 45.0, seed, SENSOR, datum=True)
    frames = run(flown)
    assert {"d2", "d4"} <= set(frames.suspects())
    assert worst_m(flown, frames, drones) < 1.0


def test_two_that_drift_alike_tell_that_the_only_receiver_slides():
    """The slide went unnoticed, and all followed it: 15 m. Measurements until its detection stay where they were put."""
    drones = [Drone("d1", **RTK, **slide(9.0, -12.0)), Drone("d2", **DRIFT), Drone("d3", **DRIFT)]
    flown = fly(drones, 45.0, 1, SENSOR, datum=True)
    frames = run(flown)
    assert list(frames.suspects()) == ["d1"]
    assert worst_m(flown, frames, drones) < 4.0


def test_of_two_groups_that_are_equally_large_each_may_slide():
    drones = [Drone("d1", **GNSS), Drone("d2", **GNSS), Drone("d3", **GNSS, **slide(9.0, -12.0))]
    drones += [Drone("d4", **GNSS, **slide(9.0, -12.0))]
    frames = run(fly(drones, 45.0, 2, SENSOR, datum=True), 24.0)
    assert set(frames.suspects()) == {"d1", "d2", "d3", "d4"}


def test_a_receiver_that_slid_counts_again_when_its_fixes_fit():
    back = slide(9.0, -12.0, 15.0, shift_back_s=30.0)
    drones = [Drone("d1", **GNSS), Drone("d2", **GNSS), Drone("d3", **RTK, **back)]
    flown = fly(drones, 100.0, 4, SENSOR, datum=True)
    found, later = run(flown, 25.0), run(flown)
    assert list(found.suspects()) == ["d3"]
    assert later.suspects() == {}
    _, covariance = flown.error(later, "d3", 99.0)
    assert np.sqrt(covariance.diagonal()[:2].max()) < 0.3  # as well as an exact receiver knows it, and not by the other two
    assert worst_m(flown, later, drones, 99.0) < 1.0


def test_the_only_receiver_that_has_not_slid_moves_nobody_if_it_is_wrong_itself_later():
    """19 m, and no drone was suspected any more: a SLAM had slid before."""
    drones = [Drone("d1", **GNSS, shift_m=(12.0, -16.0, 0.0), shift_s=60.0), Drone("d2", **DRIFT), Drone("d3", **DRIFT)]
    drones += [Drone("d4", **DRIFT, **slide(8.0, 8.0))]
    flown = fly(drones, 90.0, 3, SENSOR, datum=True)
    frames = run(flown)
    assert "d1" in frames.suspects()
    assert worst_m(flown, frames, drones, 89.0) < 3.0


def test_a_receiver_that_slid_and_fell_silent_is_steady_again():
    """Its track is: it was placed by sightings alone for the rest of the flight."""
    drones = [Drone("d1", **RTK), Drone("d2", **RTK), Drone("d3", **RTK, **slide(9.0, -12.0))]
    flown = fly(drones, 100.0, 4, SENSOR, datum=True)
    flown.entries[:] = [one for one in flown.entries if not (isinstance(one, Fix) and one.drone == "d3" and is_after(one, 40.0))]
    found, later = run(flown, 50.0), run(flown)
    assert "slid" in found.suspects()["d3"]
    assert "slid" not in later.suspects()["d3"]  # but its fixes were elsewhere, to the last one
    assert worst_m(flown, later, drones, 99.0) < 0.6


@pytest.mark.parametrize("seed", range(4))
def test_an_honest_drone_that_was_not_seen_for_long_does_not_slide(seed):
    """The drone has drifted meanwhile, by as much as it may, and is put right within seconds."""
    drones = [Drone("d1", **RTK), Drone("d2", **RTK), Drone("d3", **DRIFT)]
    flown = fly(drones, 75.0, seed, SENSOR, datum=True)
    flown.entries[:] = [one for one in flown.entries if not is_hidden(one)]
    assert run(flown).suspects() == {}


def is_after(entry, seconds):
    return entry.stamp_ns - START_NS > seconds * SECOND


def is_hidden(entry):
    """Sightings by and of d3 from 5 to 60 s."""
    is_of_it = isinstance(entry, Sighting) and "d3" in (entry.drone, entry.target)
    return is_of_it and is_after(entry, 5.0) and not is_after(entry, 60.0)

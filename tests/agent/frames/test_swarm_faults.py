"""Frames of a swarm in which a drone lies, jumps, slips away or sees nonsense: it is found out, and drags no other along."""

import math
from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs

from radron.agent.frames.swarm import SwarmFrames
from radron.protocol.codec import encode
from radron.protocol.entries import Exposure, Sighting
from support.flights.estimated_frames import DRIFT, UNKNOWN, anchored, at_once, satellites, slams, told_later
from support.flights.sighted_swarm import SECOND, START_NS, Drone, Sensor, fly, run, settle


@pytest.mark.parametrize("liar", [0, 1, 2])
def test_a_drone_that_lies_by_20_m_is_found_out(liar):
    drones = [Drone("d1", kind="gnss", wander_m=0.5, fixes=True, yaw_sigma_deg=2.0, origin_sigma_m=2.0)]
    drones.append(Drone("d2", kind="rtk", wander_m=0.03, fixes=True, yaw_sigma_deg=2.0, origin_sigma_m=2.0))
    drones.append(Drone("d3", yaw_deg=100.0, origin_sigma_m=2.0, **UNKNOWN, **DRIFT))
    drones[liar].shift_m = (12.0, -16.0, 0.0)
    flown = fly(drones, 45.0, 7, Sensor(rate_hz=5.0), datum=True)
    after_6_s, at_the_end = run(flown, 6.0), run(flown)
    assert f"d{liar + 1}" in after_6_s.suspects()
    assert list(at_the_end.suspects()) == [f"d{liar + 1}"]
    for drone in ("d1", "d2", "d3"):
        for time in (0.0, 2.0, 20.0, 44.0):  # measurements before its detection are placed anew as well
            off, covariance = flown.error(at_the_end, drone, time)
            assert np.linalg.norm(off[:3]) < 2.5
            assert off @ np.linalg.solve(covariance, off) < 25.0


def test_a_liar_does_not_drag_the_honest_ones():
    """Against the same flight without the liar's reports on itself: no fixes, an uncertain launch place."""
    kind = {"kind": "gnss", "fixes": True, "yaw_sigma_deg": 2.0}
    honest = [Drone("d1", **kind), Drone("d2", **kind)]
    lying = Drone("d3", **kind, shift_m=(12.0, -16.0, 0.0))
    with_liar = fly([*honest, lying], 15.0, 4, datum=True)
    without = fly([*honest, replace(lying, shift_m=(0.0, 0.0, 0.0), fixes=False, origin_sigma_m=30.0)], 15.0, 4, datum=True)
    a, b = at_once(with_liar), at_once(without)
    for drone in ("d1", "d2"):
        for time in range(15):
            one, other = with_liar.error(a, drone, time)[0], without.error(b, drone, time)[0]
            assert np.linalg.norm(one[:3] - other[:3]) < 0.3


def test_a_camera_that_is_all_wrong_drags_nobody():
    drones = slams()
    drones[2].false = 1.0
    flown = fly([replace(d, yaw_sigma_deg=3.0, reported_yaw_deg=None) for d in drones], 20.5, 2, Sensor(rate_hz=5.0))
    frames = at_once(flown)
    assert "d3" in frames.suspects()
    for drone in ("d1", "d2", "d3"):
        off, covariance = flown.error(frames, drone, 20.0)
        assert np.linalg.norm(off[:3]) < 1.5
        assert off @ np.linalg.solve(covariance, off) < 20.0


def test_a_jump_of_15_m_is_got_over():
    drones = anchored(yaw_sigma_deg=5.0)
    drones[2] = replace(drones[2], shift_m=(9.0, -12.0, 0.0), shift_yaw_deg=40.0, shift_s=12.0, shift_announced=True)
    flown = fly(drones, 20.0, 6)
    frames = at_once(flown)
    for time in (11.0, 11.9, 12.0, 12.5, 13.0, 16.0, 19.0):  # old observations keep the old frame, new ones have the new
        off, covariance = flown.error(frames, "d3", time)
        assert np.linalg.norm(off[:3]) < 1.0
        assert off @ np.linalg.solve(covariance, off) < 20.0


def test_a_new_epoch_is_known_as_soon_as_its_poses_are():
    drones = anchored(yaw_sigma_deg=5.0)
    drones[2] = replace(drones[2], shift_m=(9.0, -12.0, 0.0), shift_s=12.0, shift_announced=True)
    flown = fly(drones, 20.0, 6)
    frames = run(flown, 12.6)
    off, _ = flown.error(frames, "d3", 12.5, now=True)
    assert np.linalg.norm(off[:3]) < 1.0


def test_a_jump_within_an_epoch_is_found_by_the_others_sightings():
    """A drone begins an epoch where it sees itself jump. A drone that does not is suspected, and placed by the others."""
    drones = anchored(yaw_sigma_deg=5.0)
    drones[2] = replace(drones[2], shift_m=(9.0, -12.0, 0.0), shift_yaw_deg=40.0, shift_s=12.0)
    flown = fly(drones, 18.0, 6)
    frames = at_once(flown)
    assert list(frames.suspects()) == ["d3"]
    for time in (11.0, 11.9, 12.5, 13.0, 17.0):
        assert np.linalg.norm(flown.error(frames, "d3", time)[0][:3]) < 1.0


@pytest.mark.parametrize("liars", [("d2",), ("d2", "d3"), ("d1", "d2", "d3")])
def test_who_tells_poses_of_8_s_before_displaces_nobody(liars):
    """Replayed exposures put a track where it was, and back: neither the liars' frames nor the others' follow."""
    drones = [*anchored(yaw_sigma_deg=5.0), Drone("d4", yaw_deg=100.0, **UNKNOWN, **DRIFT)]
    flown = fly(drones, 40.0, 6)
    flown.entries[:] = [_replayed(one, flown.entries) if one.drone in liars else one for one in flown.entries]
    frames = at_once(flown)
    for drone in ("d2", "d3", "d4"):
        for time in (21.0, 26.0, 33.0, 38.0):
            assert np.linalg.norm(flown.error(frames, drone, time)[0][:3]) < 1.0


def _replayed(entry, entries):
    """Between 20 and 32 s, an exposure with the poses of that 8 s before."""
    if not isinstance(entry, Exposure) or not 20 * SECOND <= entry.stamp_ns - START_NS < 32 * SECOND:
        return entry
    before = (one for one in entries if isinstance(one, Exposure) and one.drone == entry.drone)
    old = max((one for one in before if one.stamp_ns <= entry.stamp_ns - 8 * SECOND), key=lambda one: one.stamp_ns)
    return structs.replace(entry, poses=old.poses, end_ns=entry.stamp_ns + old.end_ns - old.stamp_ns)


def test_a_frame_that_slips_away_is_placed_by_the_others_sightings():
    """No jump that the track itself shows: 20 m within three seconds."""
    drones = slams()
    drones[2] = replace(drones[2], shift_m=(12.0, -16.0, 0.0), shift_s=15.0, shift_lasts_s=3.0)
    flown = fly(drones, 60.0, 8, Sensor(rate_hz=5.0))
    found = run(flown, 25.0)
    assert list(found.suspects()) == ["d3"]
    assert np.linalg.norm(flown.error(found, "d3", 24.0)[0][:3]) < 1.5
    frames = run(flown)
    assert frames.suspects() == {}  # consistent for half a minute
    for drone in ("d1", "d2", "d3"):
        assert np.linalg.norm(flown.error(frames, drone, 59.0)[0][:3]) < 2.5


@pytest.mark.parametrize("seed", [3, 6])  # of twelve, the seeds in which it did
def test_where_most_receivers_were_wrong_for_a_while_they_leave_nobody_behind(seed):
    """Two of three slide by 20 m in nearly one direction, and back: the frames of these two stayed where that put them, as each
    confirmed the other's, against both other drones and their own fixes.
    """
    kind = {"kind": "rtk", "fixes": True, "yaw_sigma_deg": 5.0, "shift_s": 7.0, "shift_back_s": 30.0, "shift_lasts_s": 2.5}
    drones = [Drone("d1", **kind, shift_m=(20.2, -2.9, 0.0)), Drone("d2", **kind, shift_m=(18.9, -7.8, 0.0))]
    drones += [Drone("d3", **kind), Drone("d4", yaw_deg=100.0, **UNKNOWN, **DRIFT)]
    flown = fly(drones, 60.0, seed, Sensor(rate_hz=5.0, range_m=None), datum=True)
    frames = run(flown)
    for drone in ("d1", "d2", "d3", "d4"):
        off, covariance = flown.error(frames, drone, 59.0)
        assert np.linalg.norm(off[:3]) < 1.5
        assert off @ np.linalg.solve(covariance, off) < 25.0


def test_of_two_that_contradict_each_other_both_are_named():
    drones = satellites()[:2]
    drones[1] = replace(drones[1], shift_m=(12.0, -16.0, 0.0))
    frames = at_once(fly(drones, 15.0, 1, datum=True))
    assert set(frames.suspects()) == {"d1", "d2"}


@pytest.mark.slow
def test_honest_swarms_are_not_suspected():
    for seed in range(6):
        assert at_once(fly(satellites(), 30.0, seed, datum=True)).suspects() == {}
        assert at_once(fly(slams(), 30.0, seed)).suspects() == {}


def test_a_frame_that_nobody_can_tell_is_lost_and_found_again():
    """From 10 s to 25 s all sightings of and by d3 are nonsense; its observations then wait, and are placed afterwards."""
    drones = anchored(yaw_sigma_deg=5.0, **DRIFT)
    drones[2] = replace(drones[2], shift_m=(9.0, 12.0, 0.0), shift_s=10.0, shift_lasts_s=4.0)
    flown = fly(drones, 40.0, 5, Sensor(rate_hz=5.0))
    rng = np.random.default_rng(1)
    for place, entry in enumerate(flown.entries):
        if (
            isinstance(entry, Sighting)
            and "d3" in (entry.drone, entry.target)
            and 10.0 < 1e-9 * (entry.stamp_ns - START_NS) < 25.0
        ):
            direction = rng.standard_normal(3)
            direction = tuple((direction / np.linalg.norm(direction)).tolist())
            flown.entries[place] = structs.replace(entry, direction=direction, range_m=rng.uniform(1.0, 60.0))
    lost, found = run(flown, 24.0), run(flown)
    assert "d3" in lost.suspects()
    assert flown.error(lost, "d3", 23.0) is None
    assert np.linalg.norm(flown.error(lost, "d3", 8.0)[0][:3]) < 1.0  # sound measurements stay where they were
    for time in (20.0, 24.0, 30.0, 39.0):
        assert np.linalg.norm(flown.error(found, "d3", time)[0][:3]) < 2.0
    assert np.linalg.norm(flown.error(found, "d2", 23.0)[0][:3]) < 1.0


def test_a_frame_that_falls_apart_drags_nobody():
    """A SLAM that has lost its way: its track is noise."""
    drones = anchored(yaw_sigma_deg=5.0, **DRIFT)
    drones[2] = replace(drones[2], drift_m=3.0)
    flown = fly(drones, 30.0, 5, Sensor(rate_hz=5.0))
    frames = at_once(flown)
    for time in (5.0, 15.0, 29.0):
        assert np.linalg.norm(flown.error(frames, "d2", time)[0][:3]) < 1.0


@pytest.mark.parametrize(("jump_s", "learned_s"), [(0.3, 0.0), (10.5, 0.0), (10.5, 2.5)])
def test_a_clock_that_is_known_to_be_wrong_puts_no_frame_in_the_wrong_place(jump_s, learned_s):
    """Its sightings, and the sightings of it, contradicted its fixes: its frame was turned by 120 degrees to fit them, 20 m off.

    The same holds if the drone learns of its wrong clock only after a while, from the others.
    """
    fixed = {"kind": "rtk", "wander_m": 0.1, "fixes": True, "yaw_sigma_deg": 2.0}
    flown = fly([Drone(name, **fixed) for name in ("d1", "d2", "d3")], 60.0, 3, datum=True)
    set_ns = START_NS + 10 * SECOND
    frames = SwarmFrames(flown.mission)
    for entry in flown.entries:
        wrong = entry.drone == "d2" and entry.stamp_ns >= set_ns
        is_known = entry.stamp_ns >= set_ns + learned_s * SECOND
        told = told_later(entry, jump_s, 3.0 * jump_s if is_known else 0.0) if wrong else entry
        frames.receive(told, encode(told))
    settle(frames, int(flown.stamps_ns[-1]) + 12 * SECOND)
    assert frames.suspects() == {}
    off, _ = flown.error(frames, "d2", 59.0, now=True)
    assert np.hypot(off[0], off[1]) < 0.6
    assert abs(off[3]) < math.radians(3.0)

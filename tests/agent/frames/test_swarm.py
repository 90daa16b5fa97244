"""The frames of a whole swarm, from log entries to transforms; the truth is that of ``sighted_swarm``."""

import math
import random
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs
from sighted_swarm import SECOND, START_NS, Drone, Sensor, arrival_ns, fly, run, settle

from agent.frames.swarm import BEFORE_START_NS, SwarmFrames
from protocol.codec import encode
from protocol.entries import Counts, Entry, Exposure, Fix, PoseSample, Sighting

CHI2_90 = 7.78  # of four numbers, 90 % are below it
DRIFT = {"drift_m": 0.1, "yaw_drift_deg": 0.2}  # 1 % of 100 m, 0.1 degrees by the root of seconds and of metres at 3 m/s each
UNKNOWN = {"reported_yaw_deg": 0.0, "yaw_sigma_deg": 180.0}


def at_once(flown):
    """The frames from all entries of a flight, given before the first estimate."""
    frames = SwarmFrames(flown.mission)
    for entry in flown.entries:
        frames.receive(entry, encode(entry))
    settle(frames, int(flown.stamps_ns[-1]) + SECOND)
    return frames


def anchored(**values):
    """d1 is known exactly; the others begin with any heading."""
    return [Drone("d1", kind="exact"), Drone("d2", yaw_deg=70.0, **values), Drone("d3", yaw_deg=-130.0, **values)]


def satellites(**of_the_third):
    """Three by GNSS."""
    plain = {"kind": "gnss", "wander_m": 1.0, "fixes": True, "yaw_sigma_deg": 2.0}
    return [Drone("d1", **plain), Drone("d2", **plain), Drone("d3", **plain, **of_the_third)]


def slams():
    """d1's first frame is the mission's, all drift."""
    return [
        Drone("d1", origin_sigma_m=0.0, yaw_sigma_deg=0.0, **DRIFT),
        Drone("d2", yaw_deg=70.0, **UNKNOWN, **DRIFT),
        Drone("d3", yaw_deg=-130.0, **UNKNOWN, **DRIFT),
    ]


@pytest.fixture(scope="module")
def after_20_s():
    """(200, 2, 4) errors and (200, 2) normalised squared ones of d2 and d3 after 20 s of flight with unknown headings."""
    errors, squared = [], []
    for seed in range(100):
        flown = fly(anchored(**UNKNOWN, **DRIFT), 20.5, seed)
        frames = at_once(flown)
        found = [flown.error(frames, drone, 20.0) for drone in ("d2", "d3")]
        errors.append([off for off, _ in found])
        squared.append([off @ np.linalg.solve(covariance, off) for off, covariance in found])
    return np.array(errors), np.array(squared)


@pytest.mark.slow
def test_unknown_frames_are_found_within_20_s(after_20_s):
    errors, _ = after_20_s
    level = np.hypot(errors[..., 0], errors[..., 1])
    assert np.sqrt(np.mean(level**2)) < 0.3  # although they drift by 0.17 m of each axis in a second
    assert np.sqrt(np.mean(errors[..., 3] ** 2)) < math.radians(1.0)


@pytest.mark.slow
def test_the_covariance_is_true(after_20_s):
    _, squared = after_20_s
    assert 0.85 <= np.mean(squared < CHI2_90) <= 0.96
    assert 3.0 < squared.mean() < 5.0


def test_many_unknown_frames_are_found_one_after_the_other():
    """Those that nobody hears, the first in the list, keep nobody waiting."""
    unheard = ("d2", "d3")
    drones = [*slams(), *(Drone(f"d{number}", yaw_deg=40.0 * number, **UNKNOWN, **DRIFT) for number in range(4, 9))]
    flown = fly(drones, 15.0, 1)
    frames = SwarmFrames(flown.mission)
    for entry in flown.entries:
        if entry.drone not in unheard:
            frames.receive(entry, encode(entry))
    settle(frames, int(flown.stamps_ns[-1]) + SECOND)
    assert sorted(frames.suspects()) == ["d2", "d3"]
    assert all(flown.error(frames, f"d{number}", 14.0) is not None for number in range(4, 9))


def test_bearings_alone_do():
    flown = fly(anchored(**UNKNOWN), 20.5, 5, Sensor(range_m=None))
    frames = at_once(flown)
    for drone in ("d2", "d3"):
        off, _ = flown.error(frames, drone, 20.0)
        assert np.linalg.norm(off[:3]) < 1.0
        assert abs(off[3]) < math.radians(2.0)


def test_a_single_false_sighting_at_the_launch_does_not_pull_a_swarm_together():
    """The first keyframe has one sighting of each pair. Of d1's own, one was of d2, not of d3: places uncertain by 2 m, 6 m
    apart, fitted that as well, and were 7 m off with a sigma of 0.9 m.
    """
    corners = np.array([[0.0, 0.0, 0.2], [6.0, 0.0, 0.2], [0.0, 6.0, 0.2]])
    told = [(-1.3, 1.8, 0.0), (6.7, 1.3, 0.0), (1.5, 6.5, 0.0)]
    drones = [Drone(f"d{number + 1}", told_origin_m=place, origin_sigma_m=2.0) for number, place in enumerate(told)]
    drones[0] = replace(drones[0], kind="rtk", fixes=True)
    flown = fly(drones, 3.0, 0, Sensor(rate_hz=5.0, range_m=None), np.repeat(corners[:, None], 31, axis=1), datum=True)
    ways = {("d1", "d3"): corners[1], ("d2", "d1"): -corners[1], ("d2", "d3"): corners[2] - corners[1]}
    for place, entry in enumerate(flown.entries):
        way = ways.pop((entry.drone, entry.target), None) if isinstance(entry, Sighting) else None
        if way is not None:
            direction = tuple((way / np.linalg.norm(way)).tolist())
            flown.entries[place] = structs.replace(entry, stamp_ns=START_NS, direction=direction)
    assert not ways
    frames = run(flown)
    for drone in ("d2", "d3"):
        off, covariance = flown.error(frames, drone, 2.5)
        assert off @ np.linalg.solve(covariance, off) < CHI2_90


def test_ranges_alone_do_in_flight():
    flown = fly(anchored(**UNKNOWN), 40.5, 5, Sensor(direction_deg=None, rate_hz=5.0))
    frames = at_once(flown)
    for drone in ("d2", "d3"):
        off, covariance = flown.error(frames, drone, 40.0)
        assert np.linalg.norm(off[:3]) < 2.0
        assert off @ np.linalg.solve(covariance, off) < 20.0


def test_without_sightings_an_unknown_frame_stays_unknown():
    flown = fly(anchored(**UNKNOWN), 10.0, 1, Sensor())
    frames = SwarmFrames(flown.mission)
    for entry in flown.entries:
        if not isinstance(entry, Sighting):
            frames.receive(entry, encode(entry))
    settle(frames, int(flown.stamps_ns[-1]) + SECOND)
    assert frames.graph.mission_from_local("d2", 0) is None
    assert frames.suspects() == {"d2": "its frame is not known yet", "d3": "its frame is not known yet"}


def test_a_frame_known_late_holds_from_the_first_entry_on():
    flown = fly(anchored(**UNKNOWN), 10.0, 1)
    frames = at_once(flown)
    assert frames.graph.mission_from_local("d2", 0, START_NS) is not None
    off, _ = flown.error(frames, "d2", 0.0)
    assert np.linalg.norm(off[:3]) < 1.0


def test_without_support_the_covariance_grows():
    flown = fly([Drone("d1", origin_sigma_m=0.1, **DRIFT)], 60.0, 1)
    frames = run(flown)
    sigmas = [math.sqrt(np.trace(flown.error(frames, "d1", time)[1][:2, :2])) for time in (5.0, 20.0, 59.0)]
    assert sigmas[0] < sigmas[1] < sigmas[2]
    assert sigmas[2] > 1.0


def test_the_mean_drift_is_less_than_the_least():
    """Each drifts for itself; who sees the others knows better where he is than the best of them by himself would."""
    together, alone = [], []
    for seed in range(12):
        flown = fly(slams(), 61.0, seed)
        frames = at_once(flown)
        own = []
        for drone in ("d1", "d2", "d3"):
            off, _ = flown.error(frames, drone, 60.0)
            together.append(np.hypot(off[0], off[1]))
            # By itself: the frame of the start, known exactly, for the whole flight.
            turn = flown.yaw[drone][0]
            c, s = math.cos(turn), math.sin(turn)
            first, last = flown.local[drone][0], flown.local[drone][flown.at(60.0)]
            x, y = last[0] - first[0], last[1] - first[1]
            place = flown.place[drone][0] + np.array([c * x - s * y, s * x + c * y, 0.0])
            own.append(math.dist(place[:2], flown.place[drone][flown.at(60.0)][:2]))
        alone.append(own)
    # The best single drone is one that can be named before the flight, not the one that was lucky.
    assert np.sqrt(np.mean(np.square(together))) < 0.8 * np.sqrt(np.mean(np.square(alone), axis=0)).min()


def test_satellites_place_a_slam_whose_heading_nobody_knows():
    drones = [Drone("d1", kind="gnss", wander_m=1.0, fixes=True, yaw_sigma_deg=2.0)]
    drones += [
        Drone("d2", kind="rtk", wander_m=0.03, fixes=True, yaw_sigma_deg=2.0),
        Drone("d3", yaw_deg=100.0, **UNKNOWN, **DRIFT),
    ]
    flown = fly(drones, 30.0, 3, datum=True)
    frames = at_once(flown)
    off, _ = flown.error(frames, "d3", 29.0)
    assert np.hypot(off[0], off[1]) < 0.6
    off, covariance = flown.error(frames, "d1", 29.0)
    assert math.sqrt(np.trace(covariance[:2, :2])) < 0.6  # better than its receiver: by the one with RTK that it sees


def test_correlated_fixes_do_not_count_as_independent():
    """A receiver that is a metre wrong for a minute stays uncertain by a metre, however often it says so."""
    squared = []
    for seed in range(30):
        flown = fly([Drone("d1", kind="gnss", wander_m=1.0, fixes=True, yaw_sigma_deg=2.0)], 40.0, seed, datum=True)
        off, covariance = flown.error(at_once(flown), "d1", 39.0)
        assert 0.6 < math.sqrt(covariance[0, 0]) < 1.2
        squared.append(off[:3] @ np.linalg.solve(covariance[:3, :3], off[:3]))
    assert 1.5 < np.mean(squared) < 5.0  # 3 if true; its own standard error is 0.45


@pytest.mark.parametrize("announced", [True, False])
def test_who_has_lost_the_satellites_drifts(announced):
    """RTK that goes on by SLAM, with a new epoch or without a word: its centimetres are gone."""
    squared = []
    for seed in range(12):
        drone = Drone("d1", kind="rtk", fixes=True, yaw_sigma_deg=2.0, drift_m=0.1, yaw_drift_deg=0.2)
        drone = replace(drone, shift_m=(1.0, 0.0, 0.0), shift_announced=announced, shift_s=0.5)
        flown = fly([drone], 60.0, seed, datum=True)
        flown.entries[:] = [one for one in flown.entries if not isinstance(one, Fix) or one.stamp_ns < START_NS + SECOND]
        off, covariance = flown.error(at_once(flown), "d1", 59.0)
        assert math.sqrt(covariance[0, 0]) > 0.7
        squared.append(off @ np.linalg.solve(covariance, off))
    assert np.mean(squared) < 8.0  # 4 if true; its own standard error is 0.8


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
        for time in (0.0, 2.0, 20.0, 44.0):  # what was measured before it was found out is placed anew as well
            off, covariance = flown.error(at_the_end, drone, time)
            assert np.linalg.norm(off[:3]) < 2.5
            assert off @ np.linalg.solve(covariance, off) < 25.0


def test_a_liar_does_not_drag_the_honest_ones():
    """Against the same flight in which it says nothing of itself: no fixes, a launch place that nobody is sure of."""
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
    """A drone begins an epoch where it sees itself jump. One that does not is suspected, and placed by the others."""
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


@pytest.mark.parametrize("seed", [3, 6])  # of twelve, those in which it did
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


@pytest.mark.parametrize(
    ("off_m", "moved"),
    [
        ([(15.0, -6.0), (15.0, -6.0), (15.0, -6.0)], True),  # of the swarm as a whole, the sightings told nothing
        ([(15.0, -6.0), (-6.0, 15.0), (0.0, -20.0)], False),
        ([(15.0, -6.0), (15.0, -6.0)], False),  # two may err alike
    ],
)
def test_a_swarm_lies_where_three_receivers_agree_that_it_does(off_m, moved):
    """Their fixes are somewhere else than their launch places are by the layout. d4 has no receiver."""
    receivers = [Drone(f"d{k + 1}", kind="rtk", fixes=True) for k in range(len(off_m))]
    flown = fly([*receivers, Drone("d4", yaw_deg=100.0, **UNKNOWN, **DRIFT)], 20.0, 1, Sensor(rate_hz=5.0), datum=True)
    by = {f"d{k + 1}": one for k, one in enumerate(off_m)}
    flown.entries[:] = [displaced(one, by[one.drone]) if isinstance(one, Fix) else one for one in flown.entries]
    frames = run(flown)
    expected = np.array(off_m[0] if moved else (0.0, 0.0))
    for drone in flown.place:
        off, _ = flown.error(frames, drone, 19.0)
        assert np.linalg.norm(off[:2] - expected) < 2.0


def displaced(fix: Fix, by_m: tuple[float, float]) -> Fix:
    """The same some metres further east and north."""
    east, north = (metres / 111_200.0 for metres in by_m)
    longitude_deg = fix.longitude_deg + east / math.cos(math.radians(fix.latitude_deg))
    return structs.replace(fix, latitude_deg=fix.latitude_deg + north, longitude_deg=longitude_deg)


def test_of_two_that_contradict_each_other_both_are_named():
    drones = satellites()[:2]
    drones[1] = replace(drones[1], shift_m=(12.0, -16.0, 0.0))
    frames = at_once(fly(drones, 15.0, 1, datum=True))
    assert set(frames.suspects()) == {"d1", "d2"}


def test_honest_swarms_are_not_suspected():
    for seed in range(6):
        assert at_once(fly(satellites(), 30.0, seed, datum=True)).suspects() == {}
        assert at_once(fly(slams(), 30.0, seed)).suspects() == {}


def lines(frames, flown):
    """What the graph says, bit for bit."""
    found = []
    for drone in flown.place:
        for epoch in (0, 1):
            for stamp_ns in [*range(START_NS, int(flown.stamps_ns[-1]) + 2 * SECOND, SECOND // 2), None]:
                one = frames.graph.mission_from_local(drone, epoch, stamp_ns)
                found.append(
                    None
                    if one is None
                    else (one.yaw_rad, one.translation, None if one.covariance is None else one.covariance.tobytes())
                )
    return found


@pytest.mark.parametrize("seed", range(12))
def test_any_order_of_arrival_gives_the_same_frames(seed):
    """Bit for bit; with a jump, a liar and unknown headings in it, entries late by anything, estimates in between."""
    drones = [
        Drone("d1", kind="gnss", wander_m=1.0, fixes=True, shift_m=(12.0, -16.0, 0.0)),
        Drone("d2", kind="rtk", wander_m=0.03, fixes=True),
        Drone("d3", yaw_deg=100.0, shift_m=(5.0, 5.0, 0.0), shift_s=8.0, shift_announced=True, **UNKNOWN, **DRIFT),
    ]
    flown = fly(drones, 14.0, seed, datum=True)
    expected = lines(at_once(flown), flown)
    rng = random.Random(seed)
    frames = SwarmFrames(flown.mission)
    entries = sorted(flown.entries, key=lambda entry: arrival_ns(entry) + rng.expovariate(1.0 / 3.0) * SECOND)
    for place, entry in enumerate(entries):
        frames.receive(entry, encode(entry))
        if place % 40 == 0:
            frames.advance(arrival_ns(entry))
            frames.suspects()
    settle(frames, int(flown.stamps_ns[-1]) + SECOND)
    assert lines(frames, flown) == expected
    assert lines(run(flown), flown) == expected


def test_a_frame_that_late_sightings_make_ambiguous_again_is_unknown_for_all_times():
    """d2 and d3 are found, then three of four sightings of their first seconds come late, and are nonsense."""
    flown = fly(anchored(**UNKNOWN), 3.0, 1, Sensor(rate_hz=5.0))
    rng = np.random.default_rng(1)
    late = []
    for place, entry in enumerate(flown.entries):
        if isinstance(entry, Sighting) and rng.random() < 0.75:
            direction = rng.standard_normal(3)
            direction = tuple((direction / np.linalg.norm(direction)).tolist())
            flown.entries[place] = structs.replace(entry, direction=direction, range_m=rng.uniform(1.0, 60.0))
            late.append(flown.entries[place])
    frames = SwarmFrames(flown.mission)
    for entry in flown.entries:
        if entry not in late:
            frames.receive(entry, encode(entry))
    end_ns = int(flown.stamps_ns[-1]) + SECOND
    settle(frames, end_ns)
    assert frames.suspects() == {}
    for entry in late:
        frames.receive(entry, encode(entry))
    settle(frames, end_ns)
    assert frames.graph.mission_from_local("d2", 0, START_NS) is None
    assert lines(frames, flown) == lines(at_once(flown), flown)


def test_what_comes_two_minutes_late_is_counted_as_if_in_time():
    """Longer ago than all checkpoints are kept; the way there is made in slices."""
    drones = slams()[:2]
    flown = fly(drones, 160.0, 1, Sensor(rate_hz=1.0))
    late = [entry for entry in flown.entries if entry.drone == "d2" and 20.0 < 1e-9 * (entry.stamp_ns - START_NS) < 30.0]
    frames = SwarmFrames(flown.mission)
    for entry in flown.entries:
        if entry not in late:
            frames.receive(entry, encode(entry))
    settle(frames, int(flown.stamps_ns[-1]) + SECOND)
    before = lines(frames, flown)
    for entry in late:
        frames.receive(entry, encode(entry))
    frames.advance(int(flown.stamps_ns[-1]) + SECOND)
    assert frames.pending
    settle(frames, int(flown.stamps_ns[-1]) + SECOND)
    assert before != lines(frames, flown) == lines(at_once(flown), flown)


@pytest.mark.parametrize("seed", range(3))
def test_what_is_forgotten_leaves_no_trace_in_the_frames(seed):
    """Forged entries of d2, of which some have the stamps of true ones: forgotten while some wait and others are estimated."""
    flown = fly(satellites(), 14.0, seed, datum=True)
    rng = random.Random(seed)
    of_d2 = [entry for entry in flown.entries if entry.drone == "d2"]
    forged = [structs.replace(entry, sequence=entry.sequence + 100_000, boot="f" * 16) for entry in rng.sample(of_d2, 60)]
    forged = [_moved(entry) if isinstance(entry, Exposure) else entry for entry in forged]
    frames = SwarmFrames(flown.mission)
    for place, entry in enumerate(rng.sample([*flown.entries, *forged], len(flown.entries) + len(forged))):
        frames.receive(entry, encode(entry))
        if place % 200 == 0:
            frames.advance(arrival_ns(entry))
    end_ns = int(flown.stamps_ns[-1]) + SECOND
    if seed == 0:
        settle(frames, end_ns)
        assert lines(frames, flown) != lines(at_once(flown), flown)
    frames.forget([entry.entry_id for entry in forged])
    settle(frames, end_ns)
    assert lines(frames, flown) == lines(at_once(flown), flown)


@pytest.mark.parametrize("seed", range(3))
def test_what_is_taken_back_leaves_no_trace_and_counts_again_if_it_does(seed):
    """Some of it while it waits, some after it has been estimated, some before anything was."""
    flown = fly(satellites(), 14.0, seed, datum=True)
    rng = random.Random(seed)
    gone = rng.sample([entry for entry in flown.entries if entry.drone == "d2"], 40)
    frames, never = SwarmFrames(flown.mission), SwarmFrames(flown.mission)
    for place, entry in enumerate(rng.sample(flown.entries, len(flown.entries))):
        frames.receive(entry, encode(entry))
        if entry not in gone:
            never.receive(entry, encode(entry))
        if place % 200 == 0:
            frames.advance(arrival_ns(entry))
    end_ns = int(flown.stamps_ns[-1]) + SECOND
    frames.retract([entry.entry_id for entry in gone])
    for one in (frames, never):
        settle(one, end_ns)
    assert lines(frames, flown) == lines(never, flown)
    frames.receive_again([(entry, encode(entry)) for entry in gone])
    frames.advance(end_ns)
    frames.retract([entry.entry_id for entry in gone])
    frames.receive_again([(entry, encode(entry)) for entry in gone])
    settle(frames, end_ns)
    assert lines(frames, flown) == lines(at_once(flown), flown)


def test_where_time_goes_back_so_do_the_frames():
    flown = fly(satellites(), 14.0, 0, datum=True)
    frames, never = SwarmFrames(flown.mission), SwarmFrames(flown.mission)
    for entry in flown.entries:
        frames.receive(entry, encode(entry))
        never.receive(entry, encode(entry))
    end_ns = int(flown.stamps_ns[-1]) + SECOND
    settle(frames, end_ns)
    for one in (frames, never):
        settle(one, end_ns - 7 * SECOND)
    assert lines(frames, flown) == lines(never, flown) != lines(at_once(flown), flown)
    settle(frames, end_ns)
    assert lines(frames, flown) == lines(at_once(flown), flown)


def test_a_drone_of_which_nothing_counts_has_no_frame_any_more():
    flown = fly(satellites(), 14.0, 1, datum=True)
    gone = [entry for entry in flown.entries if entry.drone == "d2"]
    frames, never = SwarmFrames(flown.mission), SwarmFrames(flown.mission)
    for entry in flown.entries:
        frames.receive(entry, encode(entry))
        if entry not in gone:
            never.receive(entry, encode(entry))
    end_ns = int(flown.stamps_ns[-1]) + SECOND
    settle(frames, end_ns)
    frames.forget([entry.entry_id for entry in gone])
    for one in (frames, never):
        settle(one, end_ns)
    assert lines(frames, flown) == lines(never, flown)


def _moved(exposure):
    return structs.replace(exposure, poses=tuple(structs.replace(pose, position_m=(9.0, 9.0, -9.0)) for pose in exposure.poses))


def test_until_a_late_entry_is_counted_the_frames_before_serve():
    """In the midst of a replay nobody flies by frames of a minute ago; what comes in meanwhile is not lost."""
    flown = fly(slams(), 80.0, 1, Sensor(rate_hz=1.0))
    end_ns = int(flown.stamps_ns[-1]) + SECOND
    late = [entry for entry in flown.entries if entry.drone == "d2" and 20.0 < 1e-9 * (entry.stamp_ns - START_NS) < 22.0]
    frames = SwarmFrames(flown.mission)
    for entry in flown.entries:
        if entry not in late:
            frames.receive(entry, encode(entry))
    settle(frames, end_ns)
    before, revision, suspects = lines(frames, flown), frames.graph.revision, dict(frames.suspects())
    frames.receive(late[0], encode(late[0]))
    frames.advance(end_ns)
    assert frames.pending
    for entry in late[1:]:
        frames.receive(entry, encode(entry))
    assert (lines(frames, flown), frames.graph.revision, frames.suspects()) == (before, revision, suspects)
    settle(frames, end_ns)
    assert lines(frames, flown) == lines(at_once(flown), flown) != before


def test_a_drone_that_joins_late_has_nothing_estimated_again():
    """Before its first pose nothing of it is known, so nothing can change."""
    flown = fly(slams(), 60.0, 1, Sensor(rate_hz=1.0))
    late_ns, end_ns = START_NS + 55 * SECOND, int(flown.stamps_ns[-1]) + SECOND
    entries = sorted((entry for entry in flown.entries if entry.drone != "d3" or entry.stamp_ns >= late_ns), key=arrival_ns)
    frames = SwarmFrames(flown.mission)
    for entry in entries:
        if arrival_ns(entry) < late_ns + SECOND // 4:
            frames.receive(entry, encode(entry))
    settle(frames, late_ns + SECOND // 4)
    first = next(entry for entry in entries if entry.drone == "d3" and isinstance(entry, Exposure))
    frames.receive(first, encode(first))
    frames.advance(arrival_ns(first))
    assert not frames.pending
    rest = [entry for entry in entries if arrival_ns(entry) >= late_ns + SECOND // 4 and entry is not first]
    for entry in rest:
        frames.receive(entry, encode(entry))
    settle(frames, end_ns)
    whole = SwarmFrames(flown.mission)
    for entry in entries:
        whole.receive(entry, encode(entry))
    settle(whole, end_ns)
    assert lines(frames, flown) == lines(whole, flown)


def test_who_is_behind_with_the_keyframes_says_so():
    """A keyframe becomes due while earlier ones are still being estimated again: it is missing until the next call."""
    flown = fly(slams(), 30.0, 1, Sensor(rate_hz=1.0))
    end_ns = START_NS + 20 * SECOND
    frames = SwarmFrames(flown.mission)
    for entry in flown.entries:
        frames.receive(entry, encode(entry))
    frames.advance(end_ns)
    assert frames.pending
    told = []
    while frames.pending:
        told.append(lines(frames, flown))
        frames.advance(end_ns + SECOND)
    settle(frames, end_ns + SECOND)
    assert told[-1] != lines(frames, flown)
    one_at_a_time = SwarmFrames(flown.mission)
    for entry in flown.entries:
        one_at_a_time.receive(entry, encode(entry))
    settle(one_at_a_time, end_ns + SECOND)
    assert lines(one_at_a_time, flown) == lines(frames, flown)


@pytest.mark.parametrize("share", [0.0, 0.23, 0.77])
def test_a_start_leaves_out_the_same_whenever_it_is_told(share):
    """Also of an exposure that began before the bound, and of the keyframe in which it lies."""
    flown = fly(slams(), 12.0, 2)
    start_ns, end_ns = START_NS + BEFORE_START_NS + round((4.0 + share) * SECOND), int(flown.stamps_ns[-1]) + SECOND
    told_first, told_last = SwarmFrames(flown.mission), SwarmFrames(flown.mission)
    told_first.start(start_ns)
    for entry in flown.entries:
        told_first.receive(entry, encode(entry))
        told_last.receive(entry, encode(entry))
    told_last.advance(end_ns)
    assert told_last.pending  # and in the midst of an estimate
    told_last.start(start_ns)
    for frames in (told_first, told_last):
        settle(frames, end_ns)
    assert lines(told_first, flown) == lines(told_last, flown) != lines(at_once(flown), flown)


@cache
def mission_of_satellites():
    return fly(satellites(), 1.0, 1, datum=True).mission


@given(st.integers(0, 2**32))
@settings(max_examples=40)
def test_nothing_that_a_peer_sends_stops_the_flight(seed):
    """Entries with numbers from all over their ranges: no error, and whatever is said is finite."""
    rng = np.random.default_rng(seed)
    mission = mission_of_satellites()
    frames = SwarmFrames(mission)

    def far():
        return tuple(float(x) for x in rng.choice([0.0, 3.0, -50.0, 1e5, -1e5], 3) * rng.choice([1.0, rng.random()]))

    def unit(count):
        vector = rng.standard_normal(count)
        return tuple((vector / np.linalg.norm(vector)).tolist())

    for number in range(60):
        same = {
            "stamp_ns": int(rng.choice([0, START_NS, START_NS, START_NS, 2**63 - 1 - SECOND])) // 2 * 2,
            "drone": str(rng.choice(["d1", "d2", "d3"])),
            "mission": mission.mission_id,
            "boot": "0" * 16,
            "sequence": number,
            "epoch": int(rng.choice([0, 0, 0, 1, 7])),
        }
        if same["stamp_ns"] == START_NS:
            same["stamp_ns"] += int(rng.uniform(0.0, 8.0) * SECOND)
        kind = rng.integers(3)
        if kind == 0:
            poses = tuple(PoseSample(k * SECOND // 10, far(), unit(4)) for k in range(5))
            rest = {"end_ns": same["stamp_ns"] + SECOND // 2, "live_time_s": 0.0, "counts": Counts(0, 0, 0)}
            entry = Exposure(**same, **rest, poses=poses, position_sigma_m=0.1, yaw_sigma_rad=0.1)
        elif kind == 1:
            seen = {"direction": unit(3), "direction_sigma_rad": float(rng.choice([1e-4, 6.3]))}
            seen |= {"range_m": float(rng.choice([0.0, 10.0, 1e5])), "range_sigma_m": float(rng.choice([1e-3, 1e5]))}
            others = [name for name in ("d1", "d2", "d3") if name != same["drone"]]
            entry = Sighting(**same, target=str(rng.choice(others)), position_m=far(), **seen)
        else:
            place = {"latitude_deg": rng.uniform(-90.0, 90.0), "longitude_deg": rng.uniform(-180.0, 180.0), "altitude_m": -1e5}
            entry = Fix(
                **same, **place, position_m=far(), horizontal_sigma_m=1e-3, vertical_sigma_m=float(rng.choice([1e-3, 1e5]))
            )
        frames.receive(entry, encode(entry))
        if number % 10 == 0:
            frames.advance(START_NS + 4 * SECOND)
    settle(frames, START_NS + 10 * SECOND)
    for drone in ("d1", "d2", "d3"):
        for epoch in (0, 1, 7):
            one = frames.graph.mission_from_local(drone, epoch)
            assert one is None or np.isfinite([*one.translation, one.yaw_rad, *one.covariance.ravel()]).all()


def test_changes_lead_every_reader_to_the_newest_transforms():
    """Who asks again only for what ``changes`` names holds what the graph holds."""
    flown = fly(anchored(**UNKNOWN, **DRIFT), 15.0, 3)
    frames = SwarmFrames(flown.mission)
    rng = random.Random(3)
    entries = sorted(flown.entries, key=lambda entry: arrival_ns(entry) + rng.expovariate(1.0) * SECOND)
    stamps = range(START_NS, START_NS + 15 * SECOND, SECOND // 4)
    held, revision = {}, -1
    for place, entry in enumerate(entries):
        frames.receive(entry, encode(entry))
        if place % 30 == 0:
            frames.advance(arrival_ns(entry))
            for (drone, epoch), since_ns in frames.graph.changes(revision).items():
                for stamp in stamps:
                    if stamp >= since_ns:
                        held[drone, stamp] = frames.graph.mission_from_local(drone, epoch, stamp)
            revision = frames.graph.revision
            for drone in flown.place:
                for stamp in stamps:
                    now = frames.graph.mission_from_local(drone, 0, stamp)
                    then = held.get((drone, stamp))
                    assert (now is None) == (then is None)
                    if now is not None:
                        assert (now.yaw_rad, now.translation) == (then.yaw_rad, then.translation)


def test_what_lies_long_before_the_start_is_left_out():
    flown = fly(anchored(yaw_sigma_deg=5.0), 6.0, 1)
    frames, clean = SwarmFrames(flown.mission), at_once(flown)
    for entry in flown.entries:
        if entry.drone == "d2":
            old = entry.stamp_ns - 10**9 * SECOND
            moved = {"stamp_ns": old, "end_ns": old + SECOND // 2} if hasattr(entry, "end_ns") else {"stamp_ns": old}
            older = type(entry)(**{name: getattr(entry, name) for name in entry.__struct_fields__} | moved)
            frames.receive(older, encode(older))
            break
    for entry in flown.entries:
        frames.receive(entry, encode(entry))
    frames.start(START_NS)
    settle(frames, int(flown.stamps_ns[-1]) + SECOND)
    assert lines(frames, flown) == lines(clean, flown)


def test_where_all_is_exact_nothing_is_done():
    flown = fly([Drone("d1", kind="exact"), Drone("d2", kind="exact", yaw_deg=90.0)], 5.0, 1)
    frames = run(flown)
    assert frames.graph.revision == 2
    assert frames.graph.mission_from_local("d2", 0).covariance is None
    assert frames.suspects() == {}


def test_a_frame_that_nobody_can_tell_is_lost_and_found_again():
    """From 10 s to 25 s all sightings of and by d3 are nonsense; what it observes then waits, and is placed afterwards."""
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
    assert np.linalg.norm(flown.error(lost, "d3", 8.0)[0][:3]) < 1.0  # what was sound stays where it was
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


def told_later(entry: Entry, by_s: float, sigma_m: float) -> Entry:
    """An entry of a drone whose clock is ahead; its exposures tell what error that makes of its motion."""
    by_ns = round(by_s * SECOND)
    later = structs.replace(entry, stamp_ns=entry.stamp_ns + by_ns)
    return structs.replace(later, end_ns=later.end_ns + by_ns, clock_sigma_m=sigma_m) if isinstance(later, Exposure) else later


@pytest.mark.parametrize(("jump_s", "learned_s"), [(0.3, 0.0), (10.5, 0.0), (10.5, 2.5)])
def test_a_clock_that_is_known_to_be_wrong_puts_no_frame_in_the_wrong_place(jump_s, learned_s):
    """Its sightings, and those of it, contradicted its fixes: its frame was turned by 120 degrees to fit them, 20 m off.

    Also where it has learned of it only after a while, from the others.
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


@pytest.mark.parametrize("is_late", [False, True])
def test_clock_errors_that_are_told_late_or_before_the_start_count_as_if_in_time(is_late):
    """Bit for bit. The others are of the same poses, so that nothing but the clock error is new."""
    fixed = {"kind": "rtk", "wander_m": 0.1, "fixes": True, "yaw_sigma_deg": 2.0}
    flown = fly([Drone(name, **fixed) for name in ("d1", "d2", "d3")], 14.0, 3, datum=True)
    entries = [told_later(entry, 0.0, 3.0) if entry.drone == "d2" else entry for entry in flown.entries]
    last = max(entry.sequence for entry in entries)
    others = [
        structs.replace(one, sequence=last + 1 + k, clock_sigma_m=0.5)
        for k, one in enumerate(one for one in entries if isinstance(one, Exposure) and one.drone == "d2")
    ]
    now_ns = int(flown.stamps_ns[-1]) + SECOND

    def frames_after(steps):
        frames = SwarmFrames(flown.mission)
        for step in steps:
            if step is None:
                settle(frames, now_ns)
            elif isinstance(step, int):
                frames.start(step)
            else:
                frames.receive(step, encode(step))
        settle(frames, now_ns)
        return lines(frames, flown)

    if is_late:
        assert frames_after([*entries, None, *others]) == frames_after([*entries, *others])
    else:
        start_ns = START_NS + 66 * SECOND + SECOND // 2  # of what is a minute older, all is left out
        assert frames_after([*entries, *others, start_ns]) == frames_after([start_ns, *entries, *others])

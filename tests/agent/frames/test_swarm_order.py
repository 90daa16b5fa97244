"""Frames are a function of the log: whatever the order, whatever comes late or is taken back, the same bits in the end."""

import random

import numpy as np
import pytest
from msgspec import structs

from radron.agent.frames.swarm import BEFORE_START_NS, SwarmFrames
from radron.protocol.codec import encode
from radron.protocol.entries import Exposure, Sighting
from support.flights.estimated_frames import DRIFT, UNKNOWN, anchored, at_once, lines, satellites, slams, told_later
from support.flights.sighted_swarm import SECOND, START_NS, Drone, Sensor, arrival_ns, fly, run, settle


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
    """Forged entries of d2, some with the stamps of true ones: forgotten while some wait and others are estimated."""
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
    """In the midst of a replay no drone flies by frames of a minute ago; entries that come in meanwhile are not lost."""
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


def test_a_second_mission_has_the_frames_of_one_that_was_there_from_its_start_on():
    """The first start counted for good with the agents that had flown before: with one log the agents had different frames."""
    flown = fly(slams(), 12.0, 2)
    first_ns, second_ns = START_NS, START_NS + BEFORE_START_NS + 4 * SECOND
    end_ns = int(flown.stamps_ns[-1]) + SECOND
    flew_before, restarted = SwarmFrames(flown.mission), SwarmFrames(flown.mission)
    flew_before.start(first_ns)
    for entry in flown.entries:
        flew_before.receive(entry, encode(entry))
    settle(flew_before, end_ns)
    flew_before.start(second_ns)
    flew_before.start(first_ns)  # as another drone still reports
    restarted.start(second_ns)
    for entry in flown.entries:
        restarted.receive(entry, encode(entry))
    for frames in (flew_before, restarted):
        settle(frames, end_ns)
    assert lines(flew_before, flown) == lines(restarted, flown)


def test_of_one_drone_a_bounded_number_of_sightings_counts_in_a_keyframe():
    """A member published a minute's sightings for one moment: all agents stood still, and were ended by their watchdogs."""
    flown = fly(anchored(yaw_sigma_deg=5.0), 6.0, 1)
    seen = next(entry for entry in flown.entries if isinstance(entry, Sighting) and entry.stamp_ns > START_NS + 3 * SECOND)
    last = max(entry.sequence for entry in flown.entries)
    flood = [structs.replace(seen, sequence=last + number) for number in range(1, 5000)]
    few, many = SwarmFrames(flown.mission), SwarmFrames(flown.mission)
    for frames, more in ((few, flood[:100]), (many, flood)):
        for entry in (*flown.entries, *more):
            frames.receive(entry, encode(entry))
        settle(frames, int(flown.stamps_ns[-1]) + SECOND)
    assert lines(few, flown) == lines(many, flown)


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
        start_ns = START_NS + 66 * SECOND + SECOND // 2  # all entries a minute older are left out
        assert frames_after([*entries, *others, start_ns]) == frames_after([start_ns, *entries, *others])

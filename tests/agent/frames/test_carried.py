"""Frames known to the mission, after a jump: a function of the drones' reports with their exposures, in any order."""

import itertools
import math

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.frames.carried import told
from radron.agent.frames.swarm import BEFORE_START_NS, SwarmFrames
from radron.agent.frames.transform import Transform, same
from radron.protocol.codec import encode
from radron.protocol.entries import Counts, Exposure, PoseSample
from support.flights.one_pilot import MISSION, START_NS
from support.flights.sighted_swarm import START_NS as SIGHTED_NS
from support.flights.sighted_swarm import Drone, fly, settle

UNSURE = np.diag([0.04, 0.09, 0.01, 0.0025])
JUMPED, OTHER = Transform(0.6, (20.0, -5.0, 0.1), UNSURE), Transform(-1.0, (3.0, 3.0, 0.0), 2.0 * UNSURE)
LAUNCH = Transform(math.radians(30.0), (5.0, 5.0, 0.0))


def exposure(sequence=1, epoch=1, carried=JUMPED, drone="d1"):
    return Exposure(
        stamp_ns=START_NS,
        drone=drone,
        mission=MISSION.mission_id,
        boot="1" * 16,
        sequence=sequence,
        epoch=epoch,
        end_ns=START_NS + 10**9,
        live_time_s=1.0,
        counts=Counts(5, 1, 0),
        poses=(PoseSample(0, (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0)),),
        position_sigma_m=0.1,
        yaw_sigma_rad=0.01,
        carried=None if carried is None else told(carried),
    )


def frames_of(entries, mission=MISSION):
    frames = SwarmFrames(mission)
    for entry in entries:
        frames.receive(entry, encode(entry))
    return frames.graph


@pytest.mark.parametrize("carried", [JUMPED, Transform()], ids=["jumped", "as it was"])
def test_an_epoch_lies_where_the_drone_tells(carried):
    graph = frames_of([exposure(carried=carried)])
    assert same(graph.mission_from_local("d1", 1), LAUNCH @ carried)
    assert same(graph.mission_from_local("d1", 0), LAUNCH)
    assert graph.mission_from_local("d1", 2) is None


def test_of_several_that_of_the_first_entry_counts_whatever_the_order():
    entries = [exposure(1), exposure(2, carried=OTHER), exposure(3), exposure(4, epoch=2, carried=OTHER)]
    for order in itertools.permutations(entries):
        graph = frames_of(order)
        assert same(graph.mission_from_local("d1", 1), LAUNCH @ JUMPED)
        assert same(graph.mission_from_local("d1", 2), LAUNCH @ OTHER)


@pytest.mark.parametrize("gone", [exposure(1), exposure(1, carried=None), exposure(1, epoch=7)])
@pytest.mark.parametrize("others", [[], [exposure(2, carried=OTHER)], [exposure(2, carried=OTHER), exposure(3)]])
def test_an_entry_that_does_not_count_any_more_leaves_nothing_of_it(gone, others):
    """For example, entries of a drone that is revoked, or that contradicts itself."""
    frames = SwarmFrames(MISSION)
    for entry in (gone, *others):
        frames.receive(entry, encode(entry))
    frames.forget([gone.entry_id])
    afresh = frames_of(others)
    for epoch in (1, 7):
        told_now, without = frames.graph.mission_from_local("d1", epoch), afresh.mission_from_local("d1", epoch)
        assert without is None if told_now is None else same(told_now, without)


def test_what_was_told_in_the_flight_before_counts_in_no_other_one():
    """An autopilot that is booted again counts its epochs from the beginning: another jump got the frame of the first one."""
    start_ns = exposure().stamp_ns + BEFORE_START_NS + 10**9
    before, again = exposure(), replace(exposure(sequence=2, carried=OTHER), stamp_ns=start_ns, end_ns=start_ns + 10**9)
    frames = SwarmFrames(MISSION)
    frames.start(exposure().stamp_ns)
    frames.receive(before, encode(before))
    assert frames.graph.mission_from_local("d1", 1) is not None
    frames.start(start_ns)
    assert frames.graph.mission_from_local("d1", 1) is None
    for entry in (before, again):
        frames.receive(entry, encode(entry))
    only = SwarmFrames(MISSION)
    only.receive(again, encode(again))
    assert same(frames.graph.mission_from_local("d1", 1), only.graph.mission_from_local("d1", 1))


def test_what_a_long_flight_has_told_is_forgotten_at_once():
    """Frame by frame it took seconds, in which the watchdogs of all agents ended them as they started."""
    frames = SwarmFrames(MISSION)
    for second in range(2000):
        told_then = replace(
            exposure(sequence=second), stamp_ns=START_NS + second * 10**9, end_ns=START_NS + second * 10**9 + 10**9
        )
        frames.receive(told_then, encode(told_then))
    before = frames.graph.revision
    frames.start(START_NS + 10**13)
    assert frames.graph.revision <= before + 1
    assert frames.graph.mission_from_local("d1", 1) is None


def test_the_first_epoch_is_the_missions_and_an_estimated_frame_the_logs():
    graph = frames_of([exposure(epoch=0)])
    assert same(graph.mission_from_local("d1", 0), LAUNCH)
    estimated = replace(MISSION, drones=tuple(replace(one, localization="rtk") for one in MISSION.drones))
    assert frames_of([exposure()], estimated).mission_from_local("d1", 1) is None


def test_what_is_the_same_is_no_change_of_the_frame():
    frames = SwarmFrames(MISSION)
    for sequence in (1, 2, 3):
        frames.receive(exposure(sequence), encode(exposure(sequence)))
        assert frames.graph.revision == 3  # the layout's two, and this one


@pytest.mark.parametrize("turn_deg", [0.0, 40.0])
def test_one_that_was_known_exactly_drags_nobody_after_a_jump(turn_deg):
    """The drone jumps while its position goes unheard, on a circle: straight on it would be 1 m off, and its heading 20
    degrees.
    """
    jumping = Drone("d1", kind="exact", shift_m=(9.0, -12.0, 0.0), shift_yaw_deg=turn_deg, shift_s=12.0, shift_announced=True)
    flown = fly([jumping, Drone("d2", yaw_deg=70.0), Drone("d3", yaw_deg=-130.0)], 25.0, 1)
    gap = [SIGHTED_NS + round(limit_s * 1e9) for limit_s in (11.0, 12.3)]
    frames = SwarmFrames(flown.mission)
    for entry in flown.entries:
        if entry.drone != "d1" or not gap[0] < entry.stamp_ns < gap[1]:
            frames.receive(entry, encode(entry))
    settle(frames, int(flown.stamps_ns[-1]) + 10**9)
    assert frames.suspects() == {}
    for drone in ("d2", "d3"):
        for time_s in (11.0, 13.0, 16.0, 24.0):
            off, covariance = flown.error(frames, drone, time_s)
            assert np.linalg.norm(off[:3]) < 0.5
            assert off @ np.linalg.solve(covariance, off) < 20.0

"""A member publishes exposures that mislead a track: contradicted by two others, it is named, and moves nothing."""

import numpy as np
import pytest
from msgspec.structs import replace

from radron.protocol.entries import Counts, Exposure, PoseSample
from support.flights.bayes import SOURCE, entries_of, fusion_of

NONE, MANY = Counts(0, 0, 0), Counts(100_000, 40_000, 5_000)
TRACKED_S = 40.0  # the source is well known by then


@pytest.fixture(scope="module")
def flight(kit):
    mission = kit.mission_of()
    return mission, entries_of(kit, mission, np.random.default_rng(3), 62.0, lambda _: SOURCE, 3e9)


def poisoned(kit, entries, counts, since_s, beside_m=(0.0, 0.0), drone="b"):
    """The drone publishes exposures at the source, or beside it, in the place of its own, and no cones."""
    place = (*(SOURCE + np.array(beside_m)).tolist(), 0.0)
    told = []
    for entry in entries:
        if entry.drone != drone or entry.stamp_ns < kit.T0_NS + since_s * 1e9:
            told.append(entry)
        elif isinstance(entry, Exposure):
            poses = (PoseSample(0, place, entry.poses[0].quaternion),)
            told.append(replace(entry, counts=counts, poses=poses, position_sigma_m=0.0, yaw_sigma_rad=0.0))
    return told


def outcomes(kit, mission, entries, since_s, until_s):
    """Once a second: error (None: it searches), stated RMS, and the drones that are named."""
    fusion, waiting, found = fusion_of(mission), sorted(entries, key=lambda entry: entry.entry_id), []
    for second in range(1, int(until_s)):
        now_ns = kit.T0_NS + second * 1_000_000_000
        late = [entry for entry in waiting if entry.stamp_ns < now_ns - 500_000_000]
        kit.feed(fusion, late)
        waiting = waiting[len(late) :]
        fusion.advance(now_ns, 10**6)
        told = fusion.hypothesis
        if second > since_s:
            error_m = None if told is None else float(np.hypot(*(told.position[:2] - SOURCE)))
            found.append((error_m, None if told is None else told.rms_m, () if told is None else told.contradicted))
    return found


@pytest.mark.parametrize(("counts", "beside_m"), [(NONE, (0.0, 0.0)), (MANY, (0.0, 0.0)), (MANY, (15.0, 0.0))])
def test_of_three_the_one_that_contradicts_is_named_and_moves_nothing(kit, flight, counts, beside_m):
    mission, entries = flight
    found = outcomes(kit, mission, poisoned(kit, entries, counts, TRACKED_S, beside_m), TRACKED_S, 60.0)
    assert all(error_m is not None and error_m < 0.6 for error_m, _, _ in found)
    assert {drones for _, _, drones in found[4:]} == {("b",)}


def test_a_dead_camera_is_not_named(kit, flight):
    """The drone flies where the others fly, and counts nothing."""
    mission, entries = flight
    since_ns = kit.T0_NS + TRACKED_S * 1e9
    is_dead = [entry.drone == "b" and entry.stamp_ns > since_ns for entry in entries]
    dead = [
        replace(entry, counts=NONE) if dies and isinstance(entry, Exposure) else entry
        for entry, dies in zip(entries, is_dead, strict=True)
        if not dies or isinstance(entry, Exposure)
    ]
    found = outcomes(kit, mission, dead, TRACKED_S, 60.0)
    assert all(error_m < 0.6 and not drones for error_m, _, drones in found)


def test_of_two_none_is_left_out_and_the_uncertainty_widens(kit, flight):
    mission, entries = flight
    of_two = [entry for entry in entries if entry.drone in "ab"]
    calm = outcomes(kit, mission, of_two, TRACKED_S + 2.0, 60.0)
    found = outcomes(kit, mission, poisoned(kit, of_two, MANY, TRACKED_S), TRACKED_S + 2.0, 60.0)
    assert not any(drones for _, _, drones in found)
    known = [(error_m, rms_m) for error_m, rms_m, _ in found if error_m is not None]
    assert np.mean([rms_m for _, rms_m in known]) > 1.5 * np.mean([rms_m for _, rms_m, _ in calm])
    assert all(error_m < 3.0 * rms_m for error_m, rms_m in known)


def test_the_counts_of_a_lone_drone_stand(kit, flight):
    mission, entries = flight
    alone = [entry for entry in entries if entry.drone == "b"]
    found = outcomes(kit, mission, poisoned(kit, alone, NONE, TRACKED_S), TRACKED_S + 5.0, 60.0)
    assert not any(error_m is not None and error_m < 2.0 and rms_m < 1.0 for error_m, rms_m, _ in found)


@pytest.mark.parametrize("live_s", [0.002, 0.5])
def test_many_short_exposures_cost_a_track_no_more_than_one(kit, flight, live_s):
    """Each costs a share of its live time: a thousand of a millisecond would else end any track."""
    mission, entries = flight
    fusion = fusion_of(mission)
    until_ns = kit.T0_NS + 45_000_000_000
    own = [entry for entry in entries if entry.stamp_ns < until_ns and entry.drone != "b"]
    kit.feed(fusion, own)
    kit.settle(fusion, until_ns + 1_000_000_000, 10**6)
    before = fusion.state.evidence
    first = next(entry for entry in entries if isinstance(entry, Exposure) and entry.drone == "b")
    place = (*SOURCE.tolist(), 0.0)
    start_ns = until_ns - 1_000_000_000
    poison = [
        replace(
            first, stamp_ns=start_ns + round(number * live_s * 1e9), end_ns=start_ns + round((number + 1) * live_s * 1e9),
            live_time_s=live_s, counts=MANY, poses=(PoseSample(0, place, first.poses[0].quaternion),), sequence=5000 + number,
        )
        for number in range(round(1.0 / live_s))
    ]  # fmt: skip
    kit.feed(fusion, poison)
    kit.settle(fusion, until_ns + 1_000_000_000, 10**6)
    assert -3.0 < fusion.state.evidence - before < 0.0

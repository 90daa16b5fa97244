import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from radron.agent.frames.tracks import ALWAYS, Sample, Track
from radron.agent.frames.transform import Transform

TENTH = 100_000_000


def circling(count=40, first=0, epoch=0, frame=None):
    """Samples at 10 Hz of a flight at 3 m/s on a circle of 10 m; ``frame``: world from local."""
    local = (frame or Transform()).inverse()
    samples = []
    for k in range(first, first + count):
        angle = 0.03 * k
        place = (10.0 * math.cos(angle), 10.0 * math.sin(angle), 3.0)
        heading = angle + math.pi / 2 + local.yaw_rad
        samples.append(Sample((k + 1) * TENTH, epoch, local.apply_point(place), math.remainder(heading, math.tau)))
    return samples


def track_of(samples):
    track = Track()
    for sample in samples:
        track.insert(sample)
    return track


def state(track, stamps):
    return [(track.at(stamp), track.reference(stamp)) for stamp in stamps], [
        (s.stamp_ns, s.epoch, s.joined.yaw_rad, s.joined.translation, s.gap_s) for s in track.segments
    ]


def test_between_samples_it_is_interpolated():
    track = track_of([Sample(0, 0, (0.0, 0.0, 1.0), 0.0), Sample(TENTH, 0, (1.0, 2.0, 1.0), 0.0)])
    assert track.at(TENTH // 4) == pytest.approx((0.25, 0.5, 1.0))
    assert track.at(-1) is None
    assert track.at(TENTH + 1) is None
    place, flown = track.reference(5 * TENTH)
    assert place == (1.0, 2.0, 1.0)
    assert flown == pytest.approx(math.hypot(1.0, 2.0))


def test_in_a_gap_of_seconds_nobody_knows_where_it_was():
    track = track_of([Sample(0, 0, (0.0, 0.0, 1.0), 0.0), Sample(50 * TENTH, 0, (9.0, 0.0, 1.0), 0.0)])
    assert track.at(20 * TENTH) is None
    assert track.reference(20 * TENTH)[0] == (0.0, 0.0, 1.0)


def test_a_new_epoch_goes_on_where_the_vehicle_was():
    moved = Transform(1.1, (30.0, -5.0, 0.5))
    track = track_of(circling(40) + circling(40, first=40, epoch=1, frame=moved))
    joined = track.joined(1, 60 * TENTH)
    # Straight on for a tenth of a second instead of along the circle: half of 0.3 m times 0.03 rad.
    assert joined.translation == pytest.approx(moved.translation, abs=0.02)
    assert joined.yaw_rad == pytest.approx(moved.yaw_rad, abs=0.001)
    assert [segment.epoch for segment in track.segments] == [0, 1]
    assert track.gaps_s(40 * TENTH, 41 * TENTH) == [pytest.approx(0.1)]
    assert track.joined(2, 60 * TENTH) is None


def test_within_an_epoch_the_frame_stays_what_it_is():
    """Samples that jump there and back, as false ones do, put nothing else elsewhere."""
    elsewhere = circling(20, first=40, frame=Transform(0.0, (12.0, 9.0, 0.0)))
    track = track_of(circling(40) + elsewhere + circling(20, first=60))
    assert [segment.epoch for segment in track.segments] == [0]
    for stamp in (50 * TENTH, 70 * TENTH):
        assert track.joined(0, stamp).apply_point((1.0, 2.0, 3.0)) == (1.0, 2.0, 3.0)
    assert track.at(70 * TENTH) == pytest.approx(circling(1, first=69)[0].position_m)


@given(st.integers(0, 2**32), st.lists(st.integers(0, 79), max_size=10))
def test_the_order_of_arrival_leaves_no_trace(seed, asked):
    samples = (
        circling(40) + circling(20, first=40, epoch=1, frame=Transform(1.1, (30.0, -5.0, 0.5))) + circling(20, first=60, epoch=2)
    )
    samples.append(Sample(20 * TENTH, 0, (1.0, 1.0, 1.0), 0.0))  # another sample of an existing stamp
    stamps = [k * TENTH + 7 for k in range(82)]
    expected = state(track_of(samples), stamps)
    random.Random(seed).shuffle(samples)
    track = Track()
    for k, sample in enumerate(samples):
        track.insert(sample)
        if k in asked:  # intermediate results are not kept
            assert track.segments
    assert state(track, stamps) == expected


def test_a_correction_within_a_microsecond_is_no_motion_to_go_on_with():
    """Extrapolated as a velocity, half a metre in a microsecond would be 50 km until the next sample."""
    corrected = [Sample(0, 0, (0.0, 0.0, 1.0), 0.0), Sample(1_000, 0, (0.5, 0.0, 1.0), 0.0)]
    track = track_of([*corrected, Sample(TENTH, 1, (7.0, 7.0, 7.0), 0.0)])
    assert track.reference(TENTH) == (pytest.approx((0.5, 0.0, 1.0)), pytest.approx(0.5))


def test_insertion_tells_from_where_on_the_track_is_another():
    first, second, third = circling(3)
    track = track_of([first, third])
    assert track.insert(second) == first.stamp_ns
    assert track.insert(second) is None
    assert track.insert(Sample(TENTH // 2, 0, (0.0, 0.0, 0.0), 0.0)) == TENTH // 2 - 1  # before the first one nothing is known


def test_a_frame_that_begins_later_counts_only_where_insertion_says():
    """Between the last sample of an epoch and the first one of the next both may be meant; before that, the present one."""
    track = track_of(circling(4))  # the last one at 0.4 s
    changed_ns = track.insert(circling(1, first=9, epoch=1)[0])
    assert changed_ns == 4 * TENTH
    assert track.joined(1, changed_ns + 1) is not None
    assert track.joined(1, changed_ns) is None
    assert track.joined(1, 2 * TENTH) is None


def test_segments_that_change_are_told_once():
    track = track_of(circling(5))
    assert track.taken_changed_ns() == TENTH
    track.insert(circling(1, first=5)[0])
    assert track.taken_changed_ns() == ALWAYS
    track.insert(circling(1, first=6, epoch=1)[0])
    assert track.taken_changed_ns() == 7 * TENTH


def test_what_is_dropped_is_gone():
    track = track_of(circling(5))
    track.drop_before(3 * TENTH)
    assert track.first_ns == 3 * TENTH
    assert track.at(2 * TENTH) is None
    assert track.segments[0].stamp_ns == 3 * TENTH

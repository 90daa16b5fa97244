from itertools import count, pairwise

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.spatial.transform import Rotation

from radron.agent.config.drone import DroneConfig
from radron.agent.config.mission import AreaConfig, DatumConfig, DroneInMission, GroundConfig, MissionConfig
from radron.agent.detector.detection import ConeEvent, Detections
from radron.agent.localization.history import PoseHistory
from radron.agent.owntime import Utc
from radron.agent.sensing.observer import EXPOSURE_NS, GONE_NS, LATE_NS, MOST_CONES_PS, MOST_POSES, MUTE_S, SILENT_S, Observer
from radron.agent.vehicle.interface import FlightMode, VehicleState
from radron.protocol.codec import encode
from radron.protocol.entries import CarriedFrame, Cone, Counts, Exposure

SECOND = 1_000_000_000
START_NS = 1_800_000_000 * SECOND
CAMERA_RPY_DEG = (10.0, -70.0, 35.0)
MISSION = MissionConfig(
    name="test",
    area=AreaConfig(polygon_m=((0.0, 0.0), (9.0, 0.0), (9.0, 9.0))),
    drones=(DroneInMission(id="a", origin_m=(5.0, 5.0, 0.5)), DroneInMission(id="b", origin_m=(9.0, 5.0, 0.0))),
    ground=GroundConfig(height_m=0.2),
)


def telemetry(stamp_ns, position, rotation, sign=1.0):
    x, y, z, w = (sign * rotation.as_quat()).tolist()
    return VehicleState(
        stamp_ns=stamp_ns, epoch=0, position_m=position, velocity_mps=(0.0, 0.0, 0.0), quaternion=(w, x, y, z),
        height_m=position[2] + 0.3, position_sigma_m=0.3, yaw_sigma_rad=0.02, mode=FlightMode.OFFBOARD, armed=True, in_air=True,
        healthy=True,
    )  # fmt: skip


def still(history, from_s, until_s, **changed):
    """Telemetry twice a second of a vehicle that does not move."""
    for half in range(round(2 * from_s), round(2 * until_s) + 1):
        history.add(replace(telemetry(half * SECOND // 2, (0.0, 0.0, 8.0), Rotation.identity()), **changed))


CARRIED = {2: CarriedFrame((20.0, -5.0, 0.7), 0.6)}  # the frames of epochs after jumps


def observer_with(history, mission=MISSION, utc=None, **camera):
    return Observer(DroneConfig(id="a", **camera), mission, "1" * 16, history, count(1), CARRIED.get, utc or Utc())


def cone_event(stamp_ns, axis):
    pair = np.array((0.4, 1.1))
    return ConeEvent(stamp_ns, np.array((axis, -axis)), pair, pair / 10.0, np.array((0.7, 0.3)), (300.0, 361.66), (5.0, 5.0), 2.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])  # the two quaternions of one attitude
def test_a_cone_is_turned_by_camera_and_attitude_at_its_own_time(sign):
    history = PoseHistory()
    observer = observer_with(history, camera_rpy_deg=CAMERA_RPY_DEG)
    history.add(telemetry(SECOND, (1.0, 2.0, 8.0), Rotation.from_euler("ZYX", (50.0, 4.0, -3.0), degrees=True)))
    history.add(telemetry(2 * SECOND, (3.0, 6.0, 9.0), Rotation.from_euler("ZYX", (54.0, 4.0, -3.0), degrees=True), sign))
    axis = np.array((0.48, -0.6, 0.64))
    (cone,) = observer.observe(Detections(SECOND, SECOND + 1, 0.1, cones=(cone_event(3 * SECOND // 2, axis),)))
    assert isinstance(cone, Cone)
    assert cone.apex_m == pytest.approx((2.0, 4.0, 8.5))
    attitude = Rotation.from_euler("ZYX", (52.0, 4.0, -3.0), degrees=True)
    expected = (attitude * Rotation.from_euler("xyz", CAMERA_RPY_DEG, degrees=True)).apply(axis)
    np.testing.assert_allclose(cone.orders[0].axis, expected, atol=1e-12)
    np.testing.assert_allclose(cone.orders[1].axis, -expected, atol=1e-12)
    assert [order.probability for order in cone.orders] == [0.7, 0.3]


@pytest.mark.parametrize(
    ("mission", "epoch", "z_m"),
    [
        (MISSION, 0, 0.15 - 0.3),  # the ground at 0.2 m, the launch place at 0.5 m
        (MISSION, 1, 1.1),  # the frame's position is unknown after a jump
        (MISSION, 2, 0.15 - 0.3 - 0.7),
        (replace(MISSION, ground=GroundConfig(slope=(0.1, 0.0))), 0, 1.1),
        (
            replace(
                MISSION,
                drones=(DroneInMission(id="a", localization="gnss"),),
                datum=DatumConfig(latitude_deg=48.0, longitude_deg=11.0),
            ),
            0,
            1.1,
        ),
    ],
)
def test_the_camera_is_as_high_above_level_ground_as_the_rangefinder_says(mission, epoch, z_m):
    """The height of an autopilot that has landed drifts by a metre; a source beside it would be seen far away."""
    history = PoseHistory()
    observer = observer_with(history, mission)
    for stamp_ns in (SECOND, 2 * SECOND):
        state = replace(telemetry(stamp_ns, (2.0, 4.0, 1.1), Rotation.identity()), height_m=0.15, epoch=epoch)
        history.add(state)
    seen = Detections(SECOND, 2 * SECOND, 0.1, 3, 1, 1, (cone_event(3 * SECOND // 2, np.array((0.0, 0.0, 1.0))),))
    cone, exposure = observer.observe(seen)
    assert cone.apex_m == pytest.approx((2.0, 4.0, z_m))
    assert [pose.position_m for pose in exposure.poses] == [pytest.approx((2.0, 4.0, z_m))] * len(exposure.poses)


def test_a_source_beside_the_camera_does_not_flood_the_swarm_with_cones():
    history = PoseHistory()
    observer = observer_with(history)
    still(history, 0.0, 1.0)
    cones = tuple(cone_event(k * 100_000, np.array((0.0, 0.0, 1.0))) for k in range(2000))
    entries = [
        entry
        for k in range(5)
        for entry in observer.observe(Detections(k * SECOND // 5, (k + 1) * SECOND // 5, 0.1, coincidences=2000, cones=cones))
    ]
    assert len([entry for entry in entries if isinstance(entry, Cone)]) == MOST_CONES_PS
    assert observer.withheld == 10_000 - MOST_CONES_PS
    (exposure,) = (entry for entry in entries if isinstance(entry, Exposure))
    assert exposure.counts.coincidences == 3 * 2000


def test_counts_add_up_to_exposures():
    history = PoseHistory()
    observer = observer_with(history)
    still(history, 0.0, 1.5)
    step = SECOND // 5
    stretches = [Detections(k * step, (k + 1) * step, 0.19, hits=k, photopeak=1, coincidences=2) for k in range(6)]
    exposures = [entry for stretch in stretches for entry in observer.observe(stretch)]
    assert all(isinstance(entry, Exposure) for entry in exposures)
    assert [(entry.stamp_ns, entry.end_ns) for entry in exposures] == [(0, 3 * step), (3 * step, 6 * step)]
    assert [(e.counts.hits, e.counts.photopeak, e.counts.coincidences) for e in exposures] == [(3, 3, 6), (12, 3, 6)]
    assert [entry.live_time_s for entry in exposures] == pytest.approx([0.57, 0.57])


def test_a_readout_of_seconds_makes_an_entry_that_can_be_sent():
    """A log entry may have 2 kB: 50 poses at 10 Hz would not fit."""
    history = PoseHistory()
    observer = observer_with(history)
    for tick in range(51):
        history.add(telemetry(START_NS + tick * SECOND // 10, (9999.1, 0.1 * tick, 8.3), Rotation.identity()))
    (exposure,) = observer.observe(Detections(START_NS, START_NS + 2 * SECOND, 1.9, hits=7))
    assert len(encode(exposure)) <= 2048
    assert len(exposure.poses) == MOST_POSES
    assert 1.8 * SECOND < exposure.poses[-1].offset_ns < 2 * SECOND
    assert observer.dropped == 0
    assert observer.observe(Detections(START_NS + 2 * SECOND, START_NS + 5 * SECOND, 2.9, hits=7)) == []  # no log takes it
    assert observer.dropped == 1


def test_no_exposure_is_longer_than_a_log_takes():
    """The held exposure is published before a stretch that would make it too long."""
    history = PoseHistory()
    observer = observer_with(history)
    for tick in range(31):
        history.add(telemetry(START_NS + tick * SECOND // 10, (0.1 * tick, 0.0, 8.3), Rotation.identity()))
    stretches = [
        Detections(START_NS + begin * SECOND // 10, START_NS + end * SECOND // 10, 0.1 * (end - begin))
        for begin, end in pairwise((0, 2, 21))
    ]
    exposures = [entry for stretch in stretches for entry in observer.observe(stretch)]
    assert [(one.end_ns - one.stamp_ns) * 10 // SECOND for one in exposures] == [2, 19]


def test_where_a_drone_is_whose_camera_is_silent():
    """Nothing while the camera works; then the last measured exposure, and poses without live time, up to the time of
    measurements that may still come.
    """
    history = PoseHistory()
    observer, step = observer_with(history), SECOND // 10
    seen, unseen = [], []
    for tick in range(1, 101):
        now_ns = START_NS + tick * step
        history.add(telemetry(now_ns - step, (0.1 * tick, 0.0, 8.0), Rotation.identity()))
        if tick <= 42:
            seen += observer.observe(Detections(now_ns - step, now_ns, 0.09, hits=3))
        unseen += observer.unseen(now_ns)
        if tick <= 42:
            assert not unseen
    last, *rest = unseen
    assert (last.stamp_ns, last.end_ns, last.counts.hits) == (seen[-1].end_ns, START_NS + 42 * step, 6)
    assert all(before.end_ns == after.stamp_ns for before, after in pairwise(unseen))
    assert {(exposure.live_time_s, exposure.counts) for exposure in rest} == {(0.0, Counts(0, 0, 0))}
    assert now_ns - LATE_NS - EXPOSURE_NS < rest[-1].end_ns <= now_ns - LATE_NS
    late = Detections(rest[-1].end_ns, rest[-1].end_ns + EXPOSURE_NS, 0.4, hits=5)
    (again,) = observer.observe(late)
    assert (again.counts.hits, again.live_time_s) == (5, 0.4)


def test_zeros_of_a_dead_camera_are_no_absence_of_a_source():
    """From MUTE_S without a hit on there are poses but no live time, from SILENT_S on the operator knows; a hit ends both."""
    history = PoseHistory()
    observer, step = observer_with(history), SECOND // 5
    entries = []
    for tick in range(1, 176):
        now_ns = START_NS + tick * step
        history.add(telemetry(now_ns - step, (0.1 * tick, 0.0, 8.0), Rotation.identity()))
        hits = 1 if tick <= 25 or tick > 150 else 0  # the last one after 5 s, the next after 30 s
        entries += [*observer.observe(Detections(now_ns - step, now_ns, 0.2, hits=hits)), *observer.unseen(now_ns)]
        silent_s = 0.2 * (tick - 25)
        if silent_s < SILENT_S - 0.3 or hits:
            assert observer.problems == ()
        elif silent_s > SILENT_S + 0.3:
            assert len(observer.problems) == 1
            assert "no hit for 20 s" in observer.problems[0]
    assert all(before.end_ns <= after.stamp_ns for before, after in pairwise(entries))
    mute_from_ns, heard_from_ns = START_NS + int((5.0 + MUTE_S) * SECOND), START_NS + 30 * SECOND
    for entry in entries:
        if entry.end_ns <= mute_from_ns - SECOND or entry.stamp_ns >= heard_from_ns:
            assert entry.live_time_s == pytest.approx((entry.end_ns - entry.stamp_ns) * 1e-9)
        elif entry.end_ns > mute_from_ns:
            assert (entry.live_time_s, entry.counts) == (0.0, Counts(0, 0, 0))
    mute = [entry for entry in entries if mute_from_ns < entry.end_ns <= heard_from_ns]
    assert sum(entry.end_ns - entry.stamp_ns for entry in mute) > (30 - 15) * SECOND - LATE_NS - SECOND
    assert entries[-1].counts.hits > 0
    assert observer.dropped == 0


@pytest.mark.parametrize("unused", ["mute", "lost"])
def test_poses_of_a_time_that_is_not_used_are_told_at_once(unused):
    """Told 3 s later, they had every drone estimate all frames since then again, twice a second."""
    history = PoseHistory()
    observer, step = observer_with(history), SECOND // 5
    latest_ns = 0
    for tick in range(1, 101):
        now_ns = START_NS + tick * step
        there = telemetry(now_ns, (0.1 * tick, 0.0, 8.0), Rotation.identity())
        history.add(replace(there, position_trusted=unused != "lost"))
        observer.observe(Detections(now_ns - step, now_ns, 0.2, hits=int(unused == "lost")))
        latest_ns = max([latest_ns, *(entry.end_ns for entry in observer.unseen(now_ns))])
        if now_ns > START_NS + (MUTE_S + 1) * SECOND:
            assert now_ns - latest_ns < EXPOSURE_NS


def test_a_camera_that_is_gone_is_not_waited_for_and_used_again_when_it_comes_back():
    """However late its readouts are then, up to the 3 s that they may be."""
    history = PoseHistory()
    observer, step = observer_with(history), SECOND // 10
    entries = []
    for tick in range(1, 401):
        now_ns = START_NS + tick * step
        history.add(telemetry(now_ns, (0.1 * tick, 0.0, 8.0), Rotation.identity()))
        if tick <= 10 or tick > 250:
            read_ns = now_ns if tick <= 10 else now_ns - LATE_NS + 2 * step
            entries += observer.observe(Detections(read_ns - step, read_ns, 0.1, hits=1))
        entries += observer.unseen(now_ns)
        told_s = (now_ns - entries[-1].end_ns) / SECOND if entries else 0.0
        if 1.0 + GONE_NS / SECOND < tick / 10 <= 25.0:
            assert told_s < EXPOSURE_NS / SECOND
    assert all(before.end_ns <= after.stamp_ns for before, after in pairwise(entries))
    back_ns = START_NS + 25 * SECOND + 2 * LATE_NS
    assert all(entry.live_time_s > 0.4 for entry in entries if entry.stamp_ns > back_ns)
    assert entries[-1].stamp_ns > back_ns


def test_a_camera_that_never_had_a_hit_is_told_of_even_before_anybody_knows_where_it_is():
    observer = observer_with(PoseHistory())
    for second in range(21):
        observer.observe(Detections(second * SECOND, (second + 1) * SECOND, 1.0))
    assert len(observer.problems) == 1


def test_dead_time_is_not_silence(observer):
    for second in range(60):
        observer.observe(Detections(second * SECOND, (second + 1) * SECOND, 0.1))
    assert observer.problems == ()


@pytest.fixture
def history():
    history = PoseHistory()
    still(history, 0.0, 1.0)
    return history


@pytest.fixture
def observer(history):
    return observer_with(history)


def stretch(start_s, end_s, live_s=None, hits=1):
    return Detections(round(start_s * SECOND), round(end_s * SECOND), end_s - start_s if live_s is None else live_s, hits=hits)


def test_an_exposure_ends_at_a_gap(observer, history):
    assert observer.observe(stretch(0.0, 0.2)) == []
    still(history, 1.5, 4.0)
    (exposure,) = observer.observe(stretch(3.0, 3.2))
    assert (exposure.stamp_ns, exposure.end_ns, exposure.counts.hits) == (0, SECOND // 5, 1)
    (after,) = observer.observe(stretch(3.2, 3.6))
    assert (after.stamp_ns, after.counts.hits) == (3 * SECOND, 2)


@pytest.mark.parametrize("bad", [stretch(0.1, 0.3), stretch(0.2, 9.0), stretch(0.4, 0.3)])
def test_stretches_that_cannot_be_placed_are_dropped_and_counted(observer, history, bad):
    still(history, 1.5, 10.0)
    observer.observe(stretch(8.0, 8.2))
    assert observer.observe(stretch(8.0 + bad.start_ns / SECOND, 8.0 + bad.end_ns / SECOND)) == []
    assert observer.dropped == 1
    (exposure,) = observer.observe(stretch(8.2, 8.6))
    assert (exposure.stamp_ns, exposure.counts.hits) == (8 * SECOND, 2)


def test_what_is_measured_at_an_unknown_place_is_dropped(observer, history):
    """A vehicle without satellites published cones from its last trusted position, metres off."""
    observer.observe(stretch(0.0, 0.2))
    still(history, 1.0, 1.5, position_trusted=False)
    still(history, 2.0, 2.5)
    (exposure,) = observer.observe(stretch(0.2, 0.9))
    assert exposure.counts.hits == 2
    assert observer.observe(stretch(1.5, 1.7)) == []
    assert observer.dropped == 1
    assert observer.observe(stretch(2.0, 2.2)) == []
    assert observer.dropped == 1


def test_measurements_wait_for_the_telemetry_of_their_time(observer, history):
    """Telemetry comes late on a busy computer; a pose held meanwhile would be metres off."""
    for k in range(5):
        assert observer.observe(stretch(0.8 + 0.2 * k, 1.0 + 0.2 * k)) == []
    history.add(telemetry(2 * SECOND, (10.0, 0.0, 8.0), Rotation.identity()))
    before, after = observer.observe(stretch(1.8, 2.0))
    assert [pose.position_m[0] for pose in before.poses] == pytest.approx([0.0, 0.0, 0.0, 1.0, 2.0, 3.0])
    assert [pose.position_m[0] for pose in after.poses] == pytest.approx([4.0, 5.0, 6.0, 7.0, 8.0, 9.0])
    assert observer.dropped == 0


@pytest.mark.parametrize("gap_s", [3.0, 60.0])
def test_of_a_gap_in_the_telemetry_nothing_is_told(observer, history, gap_s):
    """Poses held for 1.5 s, and a line between the poses before and after the gap, bent the drone's frame by 12 degrees."""
    entries = observer.observe(stretch(0.8, 1.0))
    for k in range(round(5 * gap_s)):
        now_s = 1.2 + 0.2 * k
        entries += [*observer.observe(stretch(now_s - 0.2, now_s)), *observer.unseen(round(now_s * SECOND))]
    still(history, 1.0 + gap_s, 3.0 + gap_s)
    for k in range(10):
        now_s = 1.0 + gap_s + 0.2 * (k + 1)
        entries += [*observer.observe(stretch(now_s - 0.2, now_s)), *observer.unseen(round(now_s * SECOND))]
    spans = [(entry.stamp_ns / SECOND, entry.end_ns / SECOND) for entry in entries]
    assert [span for span in spans if span[1] <= 1.2] != []
    assert [span for span in spans if span[0] >= 1.0 + gap_s] != []
    assert [span for span in spans if span[1] > 1.2 and span[0] < 1.0 + gap_s] == []
    assert observer.dropped == 5 * gap_s


def test_counts_from_before_a_gap_without_telemetry_are_dropped(observer, history):
    assert observer.observe(stretch(0.8, 1.0)) == []
    still(history, 100.0, 101.0)
    assert observer.observe(stretch(100.0, 100.2)) == []
    assert observer.dropped == 1
    (exposure,) = observer.observe(stretch(100.2, 100.6))
    assert (exposure.stamp_ns, exposure.counts.hits) == (100 * SECOND, 2)


def test_times_that_come_again_are_measured_again_once_what_was_stamped_before_is_taken_back(history):
    """The clock was ahead, and is right since it was set back by 3 s."""
    utc = Utc()
    observer = observer_with(history, utc=utc)
    still(history, 1.0, 8.5)
    before = [entry for k in range(10) for entry in observer.observe(stretch(4.0 + 0.2 * k, 4.2 + 0.2 * k))]
    assert before[-1].end_ns > 5 * SECOND
    utc.ahead_ns = -3 * SECOND
    assert observer.observe(stretch(6.0, 6.6)) == []
    assert observer.dropped == 1
    back = observer.taken_back(7 * SECOND, before[0].sequence, before[-1].sequence)
    assert (back.stamp_ns, back.first, back.last) == (4 * SECOND, before[0].sequence, before[-1].sequence)
    held, exposure = observer.observe(stretch(7.0, 7.6, hits=3))
    assert (held.stamp_ns, held.end_ns) == (before[-1].end_ns - 3 * SECOND, 3 * SECOND)  # not logged before
    assert (exposure.stamp_ns, exposure.end_ns, exposure.counts.hits) == (4 * SECOND, round(4.6 * SECOND), 3)
    assert before[-1].sequence < back.sequence < held.sequence < exposure.sequence


@pytest.mark.parametrize(("step_s", "logged"), [(-1.0, 1), (1.0, 2)])
def test_counts_held_while_the_clock_is_set_overlap_no_exposure(history, step_s, logged):
    """Set back, their stamps are of a time that is logged already."""
    utc = Utc()
    observer = observer_with(history, utc=utc)
    still(history, 0.0, 4.0)
    first, *others = [entry for k in range(7) for entry in observer.observe(stretch(1.0 + 0.1 * k, 1.1 + 0.1 * k))]
    utc.ahead_ns = round(step_s * SECOND)
    exposures = [first, *others, *observer.observe(stretch(1.7, 2.0))]
    assert len(exposures) == logged
    assert all(later.stamp_ns >= earlier.end_ns for earlier, later in pairwise(exposures))


def test_live_time_is_never_longer_than_the_exposure(observer):
    (exposure,) = observer.observe(stretch(0.0, 0.6, live_s=0.7))
    assert exposure.live_time_s == pytest.approx(0.6)


def test_exposures_are_split_where_the_epoch_changes(observer, history):
    observer.observe(stretch(1.0, 1.1))
    for tenth in (13, 18):
        state = telemetry(SECOND // 10 * tenth, (50.0, 50.0, 8.0), Rotation.identity())
        history.add(replace(state, epoch=1))
    (before,) = observer.observe(stretch(1.3, 1.5))
    (after,) = observer.observe(stretch(1.5, 1.9))
    assert (before.epoch, after.epoch) == (0, 1)
    assert {sample.position_m for sample in before.poses} == {(0.0, 0.0, 8.0)}
    assert {sample.position_m for sample in after.poses} == {(50.0, 50.0, 8.0)}

"""Fixes and sightings become log entries, or are counted and dropped."""

import math

import pytest
from msgspec.structs import replace
from scipy.spatial.transform import Rotation

from radron.agent.pilot import Step
from radron.agent.sensing.positionsensors import MOST_PER_S
from radron.agent.vehicle.interface import GnssFix, SeenDrone
from radron.protocol.codec import decode_from
from radron.protocol.entries import Fix, Sighting
from support.flights.one_pilot import MISSION, SECOND, START_NS, TICK_NS, messages, pilot, state

SEEN = SeenDrone(
    stamp_ns=START_NS, target="d2", direction=(0.6, 0.0, 0.8), direction_sigma_rad=0.03, range_m=9.0, range_sigma_m=0.3
)
FIX = GnssFix(
    stamp_ns=START_NS, latitude_deg=50.0, longitude_deg=14.0, altitude_m=300.0, horizontal_sigma_m=1.2, vertical_sigma_m=2.0
)


def flown(yaw_deg=90.0, epoch=0):
    """d1 after half a second straight on at 4 m/s, to x = 2 m."""
    one = pilot()
    x, y, z, w = Rotation.from_euler("z", yaw_deg, degrees=True).as_quat().tolist()
    for tick in range(-10, 1):
        stamp_ns = START_NS + tick * TICK_NS
        moving = {"velocity_mps": (4.0, 0.0, 0.0), "quaternion": (w, x, y, z), "epoch": epoch}
        one.observe_vehicle(state(stamp_ns, position=(2.0 + 0.2 * tick, 0.0, 3.0), **moving))
    return one


def told(publications, kind):
    return messages(Step(publications, None), kind)


def test_a_sighting_is_turned_into_the_local_frame_at_its_own_time():
    one = flown()
    publications = one.observe_sightings([replace(SEEN, stamp_ns=START_NS - 3 * TICK_NS // 2)])
    (entry,) = told(publications, Sighting)
    assert entry.direction == pytest.approx((0.0, 0.6, 0.8))  # forward is y at a heading of 90 degrees
    assert entry.position_m == pytest.approx((1.7, 0.0, 3.0))
    assert (entry.target, entry.range_m, entry.epoch) == ("d2", 9.0, 0)
    assert [record.entry for record in one.fusion.log] == [entry]


def test_what_is_newer_than_telemetry_is_placed_straight_on():
    (entry,) = told(flown().observe_fix(replace(FIX, stamp_ns=START_NS + SECOND // 10)), Fix)
    assert entry.position_m == pytest.approx((2.4, 0.0, 3.0))
    assert (entry.latitude_deg, entry.longitude_deg, entry.altitude_m) == (50.0, 14.0, 300.0)


def test_a_range_alone_and_a_direction_alone_are_entries_too():
    one = flown()
    alone = [replace(SEEN, range_m=None, range_sigma_m=None), replace(SEEN, direction=None, direction_sigma_rad=None)]
    first, second = told(one.observe_sightings(alone), Sighting)
    assert (first.range_m, second.direction) == (None, None)
    assert second.sequence == first.sequence + 1


NAN = math.nan


@pytest.mark.parametrize(
    ("values", "counter"),
    [
        ({"target": "d1"}, "sightings_of_nobody"),
        ({"target": "nobody"}, "sightings_of_nobody"),
        ({"direction": (NAN, 0.0, 0.0)}, "sightings_implausible"),
        ({"direction": (2.0, 0.0, 0.0)}, "sightings_implausible"),
        ({"direction": None}, "sightings_implausible"),
        ({"range_m": NAN}, "sightings_implausible"),
        ({"range_m": -1.0}, "sightings_implausible"),
        ({"range_sigma_m": 0.0}, "sightings_implausible"),
        ({"direction_sigma_rad": NAN}, "sightings_implausible"),
        ({"stamp_ns": START_NS - 8 * SECOND}, "sightings_without_pose"),
        ({"stamp_ns": START_NS + SECOND}, "sightings_without_pose"),
    ],
)
def test_sightings_that_cannot_be_used(values, counter):
    one = flown()
    assert one.observe_sightings([replace(SEEN, **values)]) == []
    assert one.counters[counter] == 1
    (entry,) = told(one.observe_sightings([SEEN]), Sighting)
    assert entry.sequence == 1  # no number is lost: a gap would be asked for again and again


@pytest.mark.parametrize(
    ("values", "counter"),
    [
        ({"latitude_deg": NAN}, "fixes_implausible"),
        ({"longitude_deg": 181.0}, "fixes_implausible"),
        ({"altitude_m": math.inf}, "fixes_implausible"),
        ({"horizontal_sigma_m": 0.0}, "fixes_implausible"),
        ({"vertical_sigma_m": 1e6}, "fixes_implausible"),
        ({"stamp_ns": START_NS - 8 * SECOND}, "fixes_without_pose"),
    ],
)
def test_fixes_that_cannot_be_used(values, counter):
    one = flown()
    assert one.observe_fix(replace(FIX, **values)) == []
    assert one.counters[counter] == 1


def test_without_telemetry_nobody_knows_where_a_sight_was_made():
    assert pilot().observe_sightings([SEEN]) == []


def test_a_sensor_that_runs_wild_does_not_fill_the_log():
    one = flown()
    entries = told(one.observe_sightings([replace(SEEN, stamp_ns=START_NS + step) for step in range(50)]), Sighting)
    assert len(entries) == MOST_PER_S
    assert one.counters["sightings_too_many"] == 50 - MOST_PER_S


def test_a_peer_takes_the_entries_into_its_log():
    one, other = flown(epoch=2), pilot("d2", MISSION)
    for key, payload in one.observe_sightings([SEEN]) + one.observe_fix(FIX):
        other.receive(key, payload, START_NS)
        assert decode_from(key, payload).epoch == 2
    assert other.digest == one.digest
    assert len(other.fusion.log) == 2


def test_after_its_clock_was_set_back_a_drone_logs_no_sighting_of_stamps_that_it_has_logged_already():
    """For itself it still sees where the others are; what its sensor tells a moment late is logged."""
    one, back_ns = flown(), 3 * SECOND
    assert len(told(one.observe_sightings([SEEN, replace(SEEN, stamp_ns=START_NS - SECOND // 4)]), Sighting)) == 2
    one.observe_clock(-back_ns, START_NS)
    for tick in range(1, 70):
        one.observe_vehicle(state(START_NS + tick * TICK_NS, position=(2.0, 0.0, 3.0)))
    assert one.observe_sightings([replace(SEEN, stamp_ns=START_NS + SECOND)]) == []
    assert one.counters["sightings_overlapping"] == 1
    assert [seen.stamp_ns - START_NS for seen in one._peers["d2"].sightings] == [0, -SECOND // 4, SECOND]
    (entry,) = told(one.observe_sightings([replace(SEEN, stamp_ns=START_NS + back_ns + SECOND // 4)]), Sighting)
    assert (entry.sequence, entry.stamp_ns) == (3, START_NS + SECOND // 4)
    one._sensors.begin_anew()  # these are taken back
    assert told(one.observe_sightings([replace(SEEN, stamp_ns=START_NS + 2 * SECOND)]), Sighting)

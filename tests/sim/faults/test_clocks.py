"""Faulty clocks: their readings, and the resulting stamps."""

from radron.agent.detector.readout import PixelHits, Readout
from radron.agent.vehicle.interface import SeenDrone
from radron.sim.faults.clocks import ClockFaults
from radron.sim.faults.machines import Clock
from radron.sim.faults.schedule import Schedule

START_NS = 1_767_225_600_000_000_000


def clock(*faults: Clock) -> tuple[ClockFaults, Schedule]:
    schedule = Schedule(faults, ["d1", "d2"], 1)
    return ClockFaults(schedule, START_NS), schedule


def at(time_s: float) -> int:
    return START_NS + round(time_s * 1e9)


def test_a_clock_jumps_drifts_and_is_right_again() -> None:
    faults, schedule = clock(Clock(at_s=10.0, for_s=100.0, target="d1", jump_s=-2.0, drift_ppm=100.0))
    shown = {}
    for time_s in (5.0, 10.0, 60.0, 110.0):
        schedule.advance(time_s)
        shown[time_s] = faults.utc_ns(0, at(time_s)) - at(time_s)
        assert faults.ahead_ns(0, at(time_s)) == shown[time_s]
        assert [faults.own_ns(drone, at(time_s)) for drone in (0, 1)] == [at(time_s)] * 2
    assert shown == {5.0: 0, 10.0: -2_000_000_000, 60.0: -1_995_000_000, 110.0: 0}


def test_own_time_begins_with_the_clock_at_the_start_of_an_agent() -> None:
    faults, schedule = clock(Clock(at_s=10.0, for_s=20.0, target="d1", jump_s=-2.0))
    for time_s, starts, own_s, ahead_s in ((5.0, True, 5.0, 0.0), (15.0, False, 15.0, -2.0), (16.0, True, 14.0, 0.0),
                                           (31.0, False, 29.0, 2.0)):  # fmt: skip
        schedule.advance(time_s)
        if starts:
            faults.begin(0)
        assert (faults.own_ns(0, at(time_s)), faults.ahead_ns(0, at(time_s))) == (at(own_s), ahead_s * 1e9)


def test_readouts_of_an_agent_started_with_a_wrong_clock_are_contiguous() -> None:
    faults, schedule = clock(Clock(at_s=1.0, jump_s=3.0, drift_ppm=-500.0))
    schedule.advance(20.0)
    stamps = [faults.restamped(0, Readout(at(t), at(t + 0.2), START_NS, 0.2, PixelHits.none())) for t in (10.0, 10.2, 10.4)]
    assert stamps[0].end_ns == stamps[1].start_ns
    assert stamps[1].end_ns == stamps[2].start_ns
    assert stamps[0].clock_ns - START_NS == stamps[0].start_ns - at(10.0)  # tick 0, as this clock would have shown it


def test_sightings_have_the_wrong_stamps_too() -> None:
    faults, schedule = clock(Clock(at_s=0.0, jump_s=3.0, target="d2"))
    schedule.advance(1.0)
    seen = [SeenDrone(stamp_ns=at(1.0), target="d1", range_m=5.0, range_sigma_m=0.1)]
    assert faults.restamped_sightings(0, seen) is seen
    assert faults.restamped_sightings(1, seen)[0].stamp_ns == at(4.0)

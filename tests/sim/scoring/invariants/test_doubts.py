"""Uncertain quantities: each invariant is shown violations, and beside them cases that it must accept."""

from types import SimpleNamespace

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.motion.separation import PeerPlan
from radron.protocol.entries import Counts, Exposure, PoseSample
from radron.sim.campaign.faults.course import DEALT
from radron.sim.campaign.faults.dealt import deal
from radron.sim.scenario import parse_scenario
from radron.sim.scoring.invariants.base import Setting
from radron.sim.scoring.invariants.beliefs import FollowsSource
from radron.sim.scoring.invariants.doubts import Mistimed, PlaceBound, WideBerth
from radron.sim.scoring.moment import EPOCH_NS
from support.flights import moments

SPEED_MPS, RADIUS_M = 0.8, 7.0
CLOCK = {"kind": "clock", "at_s": 5.0, "for_s": 20.0, "jump_s": 1.5, "target": "d1"}
SLOW = {"kind": "slow-cpu", "at_s": 0.0, "late_s": 0.3, "target": "d1"}
LIAR = {"kind": "lie", "at_s": 4.0, "what": "counts", "target": "d2"}


def found(invariant, make, seconds):
    """Drones in violation, ``make(time_s)`` being the moments."""
    times_s = np.arange(0.0, seconds, 0.05).tolist()
    told = [one for time_s in times_s for one in invariant.look(make(time_s))]
    return [one.drones for one in told + invariant.finish(make(times_s[-1]))]


def around(time_s):
    angle = SPEED_MPS / RADIUS_M * time_s
    return 20.0 + RADIUS_M * np.cos(angle), 20.0 + RADIUS_M * np.sin(angle)


@pytest.mark.parametrize(
    ("late_s", "sigma_m", "motion", "seconds", "faults", "expected"),
    [
        (0.65, 0.2, "circle", 60.0, (), [("d1",)]),
        (-0.65, 0.2, "circle", 60.0, (), [("d1",)]),
        (0.25, 0.2, "circle", 60.0, (), []),
        (0.65, 0.2, "circle", 10.0, (), []),
        (0.65, 1.0, "circle", 60.0, (), []),
        (0.65, 0.2, "wander", 60.0, (), []),
        (0.65, 0.2, "circle", 60.0, (LIAR,), []),
        (0.65, 0.2, "circle", 60.0, (SLOW,), []),
        (0.65, 0.2, "circle", 60.0, (SLOW | {"target": "d2"},), [("d1",)]),
    ],
)
def test_a_hypothesis_that_is_behind_its_source_or_ahead_of_it(late_s, sigma_m, motion, seconds, faults, expected) -> None:
    document = moments.setting(*faults).scenario
    source = SimpleNamespace(motion=motion)
    setting = moments.setting(*faults)
    setting.scenario = SimpleNamespace(source=source, fault=document.fault)

    def make(time_s):
        x, y = around(time_s - late_s)
        pilots = moments.changed(0, moments.pilot(believed=moments.hypothesis(x, y, sigma_m)), moments.pilot)
        return moments.moment(time_s, source=around(time_s), pilots=pilots)

    assert found(FollowsSource(setting), make, seconds) == expected


@pytest.mark.parametrize(("still_s", "expected"), [(4.0, []), (12.0, [("d1",)])])
def test_a_source_that_is_taken_to_rest_for_a_moment(still_s, expected) -> None:
    """The hypothesis stays where the source was, is more than 6 sigma off after a second, and finds it again."""
    setting = moments.setting()
    setting.scenario = SimpleNamespace(source=SimpleNamespace(motion="circle"), fault=[])

    def make(time_s):
        x, y = around(20.0 if 20.0 <= time_s < 20.0 + still_s else time_s)
        pilots = moments.changed(0, moments.pilot(believed=moments.hypothesis(x, y, 0.1)), moments.pilot)
        return moments.moment(time_s, source=around(time_s), pilots=pilots)

    assert found(FollowsSource(setting), make, 40.0) == expected


@pytest.mark.parametrize(("late_s", "expected"), [(0.0, []), (4.0, [("d1",)])])
def test_a_source_that_is_taken_to_rest_for_seconds_but_not_excluded(late_s, expected) -> None:
    """The 7 s are 5.9 sigma off at most, and show nearly all of the lag; a lag visible in the rest, too, counts."""
    setting = moments.setting()
    setting.scenario = SimpleNamespace(source=SimpleNamespace(motion="circle"), fault=[])

    def make(time_s):
        still = 20.0 <= time_s < 27.0
        x, y = around(20.0 if still else time_s - late_s)
        believed = moments.hypothesis(x, y, 0.95 if still else 2.0 if late_s else 6.0)
        pilots = moments.changed(0, moments.pilot(believed=believed), moments.pilot)
        return moments.moment(time_s, source=around(time_s), pilots=pilots)

    assert found(FollowsSource(setting), make, 60.0) == expected


class Measured:
    """A log of exposures of the first drone, each 0.5 s, and where they are fused: at x, by ``off_m`` from where it was."""

    def __init__(self, off_m, sigma_m, count=20, told_m=3.0):
        self._fused = (10.0 + off_m, 10.0, 3.0), sigma_m
        pose = PoseSample(0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
        given = {"drone": "d1", "boot": "b", "mission": "m", "epoch": 0, "live_time_s": 0.5, "counts": Counts(0, 0, 0)}
        self.log = [
            SimpleNamespace(entry=Exposure(
                stamp_ns=EPOCH_NS + round((5.0 + 0.5 * k) * 1e9), end_ns=EPOCH_NS + round((5.5 + 0.5 * k) * 1e9), sequence=k,
                poses=(pose,), position_sigma_m=0.1, yaw_sigma_rad=0.01, clock_sigma_m=told_m, **given,
            ))
            for k in range(count)
        ]  # fmt: skip

    def place(self, identity):
        return self._fused


@pytest.mark.parametrize(
    ("measured", "faults", "expected"),
    [
        (Measured(2.0, 0.1), (CLOCK,), [("d1",)]),
        (Measured(2.0, 1.0), (CLOCK,), []),
        (Measured(0.4, 0.01), (CLOCK,), []),
        (Measured(2.0, 0.1, count=4), (CLOCK,), [("d1",)]),
        (Measured(2.0, 0.1, count=3), (CLOCK,), []),
        (Measured(2.0, 0.1, told_m=0.0), (CLOCK,), []),  # error unknown to the drone
        (Measured(2.0, 0.1), (CLOCK, LIAR), []),
        (Measured(2.0, 0.1), (CLOCK, {"kind": "clock", "at_s": 4.0, "jump_s": -6.0}), []),  # of all of them
        (Measured(2.0, 0.1), (CLOCK, {"kind": "clock", "at_s": 4.0, "drift_ppm": 600.0}), [("d1",)]),
    ],
)
def test_measurements_with_a_wrong_clock_that_are_fused_as_if_it_were_right(measured, faults, expected) -> None:
    def make(time_s):
        return moments.moment(time_s, pilots=moments.changed(0, moments.pilot(fused=measured), moments.pilot))

    assert found(Mistimed(moments.setting(*faults)), make, 30.0) == expected


def by_satellites(*, sees):
    """A mission of drones with receivers of 1 m, and places of the launch known to 2 m; and how many they are."""
    dealt = [deal(seed, DEALT) for seed in range(10)]
    document = next(one for one in dealt if "datum" in one["mission"] and "sightings" not in one)
    if sees:
        document["sightings"] = {}
    return Setting(parse_scenario(document, "test"), 34.0, 120.0), len(document["mission"]["drones"])


@pytest.mark.parametrize(
    ("sigma_m", "sees", "expected"), [(1.0, False, 1), (1.3, False, 0), (0.9, True, 0), (0.55, True, 1), (None, False, 0)]
)
def test_a_drone_that_states_its_place_more_surely_than_its_receiver_can_tell(sigma_m, sees, expected) -> None:
    setting, count = by_satellites(sees=sees)
    one = moments.pilot(placed=moments.whereabouts(sigma_m=sigma_m) if sigma_m is not None else None)
    pilots = [one] + [moments.pilot()] * (count - 1)
    told = found(PlaceBound(setting), lambda time_s: moments.moment(time_s, pilots=pilots), 8.0)
    assert len(told) == expected


def test_a_drone_may_state_as_surely_as_it_likes_a_place_that_the_mission_knows() -> None:
    setting, count = by_satellites(sees=False)
    pilots = [moments.pilot(placed=moments.whereabouts(sigma_m=0.001))] * count
    given = setting.mission
    for localization, expected in (("gnss", count), ("exact", 0)):
        setting.mission = replace(given, drones=[replace(drone, localization=localization) for drone in given.drones])
        told = found(PlaceBound(setting), lambda time_s: moments.moment(time_s, pilots=pilots), 8.0)
        assert len(told) == expected


@pytest.mark.parametrize(
    ("changes", "seconds", "expected"),
    [
        ({"ends": (16.0, 10.0, 3.0), "sigma_m": 1.0}, 4.0, [("d1", "d2")]),
        ({"ends": (14.0, 10.0, 3.0), "sigma_m": 1.0}, 4.0, []),
        ({"ends": (16.0, 10.0, 3.0), "sigma_m": 0.2}, 4.0, []),
        ({"ends": (16.0, 10.0, 3.0), "sigma_m": 1.0}, 2.5, []),
        ({"ends": (16.0, 10.0, 3.0), "sigma_m": 1.0, "blind": True}, 4.0, []),
    ],
)
def test_a_plan_that_does_not_allow_for_the_doubt_about_another_ones_place(changes, seconds, expected) -> None:
    def make(time_s, places=moments.PLACES):
        reckons = moments.reckoning(**changes, stamp_ns=round(time_s * 5.0))
        return moments.moment(time_s, places, pilots=moments.changed(0, moments.pilot(reckons=reckons), moments.pilot))

    assert found(WideBerth(moments.setting()), make, seconds) == expected
    low = [moments.PLACES[0], (20.0, 10.0, 1.0), moments.PLACES[2]]
    assert found(WideBerth(moments.setting()), lambda time_s: make(time_s, low), seconds) == []


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        (((13.5, 13.5, 3.0), (13.5, 6.5, 3.0)), []),  # all around, a metre too near
        (((16.5, 14.5, 3.0), (16.5, 5.5, 3.0)), [("d1", "d2"), ("d1", "d3")]),  # all on one side: it could go away from them
        (((12.2, 14.2, 3.0), (12.2, 5.8, 3.0)), []),  # these are not too near, but would be
        (((10.0, 16.0, 3.0), (10.0, 4.0, 3.0)), [("d1", "d2")]),  # there is room towards these
    ],
)
def test_a_plan_amid_others_has_no_better_end(more, expected) -> None:
    """Three came home around a drone that joined late and still circled: it was carried along in their midst, 0.3 m too near."""

    def make(time_s):
        reckons = moments.reckoning(ends=(15.2, 10.0, 3.0), sigma_m=1.0, more=more, stamp_ns=round(time_s * 5.0))
        return moments.moment(time_s, pilots=moments.changed(0, moments.pilot(reckons=reckons), moments.pilot))

    assert found(WideBerth(moments.setting()), make, 4.0) == expected


@pytest.mark.parametrize(("line_x_m", "expected"), [(19.0, []), (21.0, [("d1", "d2"), ("d1", "d3")])])
def test_a_line_that_a_drone_keeps_behind_is_in_its_way_too(line_x_m, expected) -> None:
    """On its circle between a place where one had stopped, one in doubt by 4 m, and the circle of the former if that flew on."""

    def make(time_s):
        places, stamp_ns = {"d2": (10.0, 12.0, 3.0), "d3": (12.5, 17.0, 3.0)}, round(time_s * 5.0)
        plans = [PeerPlan(name, 0, 0.2, [place], 1.0) for name, place in places.items()]
        plans.append(PeerPlan("d3", 0, 0.2, [(line_x_m, 10.0, 3.0)], 0.0, away=np.array([(-1.0, 0.0)]), blind=True))
        reckons = replace(moments.reckoning(ends=(14.0, 13.0, 3.0), stamp_ns=stamp_ns), others=plans)
        return moments.moment(time_s, pilots=moments.changed(0, moments.pilot(reckons=reckons), moments.pilot))

    assert found(WideBerth(moments.setting()), make, 4.0) == expected

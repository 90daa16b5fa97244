"""Dealt missions: a few successive seeds have every fault of the deck, and all can be flown."""

import pickle
from collections import Counter

import pytest

from radron.sim.campaign.faults.course import DEALT, FULL, LIVE, SHORT
from radron.sim.campaign.faults.dealt import DECK, HAND, LIVE_HANDS, MISLEADING, deal
from radron.sim.campaign.faults.mission import Mission
from radron.sim.faults.disk import check_playable as check_lockstep
from radron.sim.faults.machines import Clock
from radron.sim.live.faults.playable import check_playable as check_live
from radron.sim.scenario import parse_scenario


def kinds(first: int, course) -> Counter[str]:
    missions = 3 if course == LIVE else 10
    return Counter(fault["kind"] for seed in range(first, first + missions) for fault in deal(seed, course).get("fault", []))


def test_successive_seeds_have_the_whole_deck_and_live_ones_a_disarmed_drone_each() -> None:
    for first in (0, 500_000):
        unheard = {"mavlink-loss": sum(kind == "clock" and given["jump_s"] < 0.0 for kind, given in DECK)}
        assert kinds(first, DEALT) == Counter(kind for kind, _ in DECK + MISLEADING) + Counter(unheard)
    assert kinds(600_000, LIVE) == Counter(kind for hand in LIVE_HANDS for kind, _ in hand) + Counter(disarm=3)


@pytest.mark.parametrize("course", [FULL, SHORT, DEALT, LIVE])
def test_a_worker_process_flies_the_same_mission(course) -> None:
    mission = Mission(600_000, course)
    assert pickle.loads(pickle.dumps(mission)).drawn == mission.drawn


@pytest.mark.parametrize("course", [FULL, SHORT, DEALT, LIVE])
def test_a_mission_has_time_to_take_off_and_to_come_home_beside_its_search_and_its_tracking(course) -> None:
    """An emulated PX4 takes off within 8 s, and lands, and disarms itself, within 15 s of arriving over its home."""
    assert course.end_s > course.search_s + course.track_s[1] + 45.0


def test_a_seed_is_dealt_the_same_each_time_and_others_otherwise() -> None:
    dealt = [deal(seed, DEALT) for seed in range(40)]
    assert dealt == [deal(seed, DEALT) for seed in range(40)]
    assert len({str(document) for document in dealt}) == 40


def test_every_mission_can_be_flown_and_its_faults_are_over_at_the_heal() -> None:
    for course, check in (
        (DEALT, lambda scenario: check_lockstep(scenario.fault, "test")),
        (LIVE, lambda one: check_live(one, here=True)),
    ):
        for seed in range(60):
            scenario = parse_scenario(deal(seed, course), f"seed {seed}")
            check(scenario)
            set_back = sum(isinstance(fault, Clock) and fault.jump_s < 0.0 for fault in scenario.fault)
            assert len(scenario.fault) in (0, HAND + set_back, HAND + 1)
            assert all(fault.end_s <= course.heal_s or fault.for_s is None for fault in scenario.fault)


def test_of_ten_missions_two_have_no_fault_one_of_them_with_frames_to_be_estimated_one_with_a_fast_source() -> None:
    still, moving = deal(500_000, DEALT), deal(500_001, DEALT)
    assert "fault" not in still
    assert "fault" not in moving
    assert "sightings" in still
    assert moving["source"]["motion"] == "circle"


def test_the_drone_to_which_an_old_command_comes_is_struck_by_nothing_else_but_a_slightly_wrong_clock() -> None:
    """A drone with a dead agent, or a revoked one, would not obey it anyway."""
    hands = [deal(seed, DEALT).get("fault", []) for seed in range(500_000, 500_100)]
    held = [(hand, fault["target"]) for hand in hands for fault in hand if fault["kind"] == "old-command"]
    assert len(held) == 10
    for hand, target in held:
        others = [fault for fault in hand if fault.get("target") == target and fault["kind"] != "old-command"]
        assert all(fault["kind"] == "clock" and fault["jump_s"] > 0.0 for fault in others)


def test_the_drone_whose_clock_is_a_little_wrong_is_struck_by_nothing_else() -> None:
    """Else its measurements with that clock are too few."""
    hands = [deal(seed, DEALT).get("fault", []) for seed in range(500_000, 500_100)]
    held = [(hand, fault["target"]) for hand in hands for fault in hand if fault["kind"] == "clock" and fault["jump_s"] > 0.0]
    assert len(held) == 10
    for hand, target in held:
        assert {fault["kind"] for fault in hand if fault.get("target") == target} <= {"clock", "old-command"}


def test_where_a_localisation_jumps_or_a_clock_is_wrong_frames_are_estimated_of_all_kinds() -> None:
    dealt = [deal(seed, DEALT) for seed in range(500_000, 500_050)]
    held = [document for document in dealt if {"position-jump", "clock"} & {fault["kind"] for fault in document.get("fault", [])}]
    assert len(held) >= 10
    for document in held:
        drones = document["mission"]["drones"]
        if "sightings" not in document:  # a tenth: by satellites alone
            assert {drone["localization"] for drone in drones} == {"gnss"}
            continue
        assert {drone["localization"] for drone in drones} == {"rtk", "gnss", "slam"}
        assert any(drone["yaw_sigma_deg"] == 180.0 for drone in drones)
    alone = [document for document in dealt if "localization" in document["mission"]["drones"][0] and "sightings" not in document]
    assert len(alone) == 5


def test_what_is_wrong_with_satellites_strikes_a_drone_that_follows_them() -> None:
    for document in (deal(seed, DEALT) for seed in range(500_000, 500_050)):
        by_slam = {drone["id"] for drone in document["mission"]["drones"] if drone.get("localization") == "slam"}
        struck = [one for one in document.get("fault", []) if one["kind"] in ("position-jump", "satellites-lost", "spoofed")]
        assert not any(fault["target"] in by_slam for fault in struck)


def test_an_autopilot_is_not_heard_while_the_clock_of_its_drone_is_set_back() -> None:
    clocks = 0
    for document in (deal(seed, DEALT) for seed in range(500_000, 500_020)):
        faults = document.get("fault", [])
        for clock in (fault for fault in faults if fault["kind"] == "clock" and fault["jump_s"] < 0.0):
            silent = [one for one in faults if one["kind"] == "mavlink-loss" and one["target"] == clock["target"]]
            assert any(one["at_s"] < clock["at_s"] - 1.0 and one["at_s"] + one["for_s"] > clock["at_s"] + 2.0 for one in silent)
            clocks += 1
    assert clocks == 2

"""Random missions: the same seed draws the same, other seeds draw other kinds, and all are missions that can be flown."""

import tomllib
from collections import Counter
from pathlib import Path

from radron.sim.campaign.faults.course import FULL, SHORT
from radron.sim.campaign.faults.draw import as_toml, draw
from radron.sim.campaign.faults.strengths import STRENGTHS
from radron.sim.faults.kinds import DEALT_ONLY, KINDS
from radron.sim.scenario import load_scenario, parse_scenario

SEEDS = range(60)


def test_a_seed_draws_the_same_mission_each_time_and_another_seed_another_one() -> None:
    drawn = [draw(seed) for seed in SEEDS]
    assert drawn == [draw(seed) for seed in SEEDS]
    assert len({str(document) for document in drawn}) == len(drawn)


def test_every_mission_is_valid_and_as_large_as_it_should_be() -> None:
    for course in (FULL, SHORT):
        for seed in SEEDS:
            scenario = parse_scenario(draw(seed, course), f"seed {seed}")
            assert 3 <= len(scenario.mission.drones) <= 6
            assert 1 <= len(scenario.fault) <= 5


def test_what_does_not_stay_is_over_at_the_heal_and_the_network_never_stays() -> None:
    for seed in SEEDS:
        for fault in parse_scenario(draw(seed), "test").fault:
            assert FULL.first_s <= fault.at_s < FULL.heal_s
            assert fault.end_s <= FULL.heal_s + 1e-6 or fault.for_s is None
            assert fault.for_s is not None or fault.family != "network"


def test_all_kinds_come_and_seeds_differ_in_their_kinds() -> None:
    assert set(STRENGTHS) == set(KINDS)
    seen = [frozenset(fault["kind"] for fault in draw(seed)["fault"]) for seed in range(400)]
    assert set().union(*seen) == {name for name, kind in KINDS.items() if not issubclass(kind, DEALT_ONLY)}
    pairs = Counter(frozenset((one, other)) for kinds in seen for one in kinds for other in kinds if one != other)
    assert len(pairs) > 300  # of the 406 pairs of kinds


def test_in_some_missions_autopilots_hold_or_land_without_their_agents() -> None:
    drawn = Counter(draw(seed)["mission"]["safety"]["agent_lost"] for seed in range(400))
    assert set(drawn) == {"return", "hold", "land"}
    assert all(40 < drawn[mode] < 80 for mode in ("hold", "land"))  # 15 % of them, by three sigma


def test_the_file_of_a_mission_is_a_scenario_like_any_other(tmp_path: Path) -> None:
    for seed in (0, 3, 5, 8):
        path = tmp_path / f"{seed}.toml"
        path.write_text(as_toml(draw(seed)))
        assert tomllib.loads(path.read_text()) == draw(seed)
        assert load_scenario(str(path)) == parse_scenario(draw(seed), "test")

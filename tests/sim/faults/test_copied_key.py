"""Somebody with a copy of a drone's key publishes as that drone while the swarm circles: all keep apart, and tell it."""

from itertools import combinations
from math import dist

import pytest
from msgspec.structs import replace

from sim.faults.kinds import read_faults
from sim.lockstep.flight import watched
from sim.scenario import load_scenario
from sim.scoring.moment import Moment

AT_S, FOR_S = 20.0, 40.0


def flown(*faults: dict[str, object]) -> tuple[float, set[str]]:
    """The least true distance of two drones, metres, and what was told of d2."""
    least_m, told = [float("inf")], set[str]()

    def watch(moment: Moment) -> bool:
        if moment.time_s > AT_S:
            places = moment.position_m.tolist()
            least_m.append(min(dist(one, other) for one, other in combinations(places, 2)))
            told.update(text for one in moment.pilots if one for text in one.problems if "d2" in text)
        return moment.time_s > AT_S + FOR_S

    watched(replace(load_scenario("demo"), fault=read_faults(list(faults), "test")), 1, watch)
    return min(least_m), told


@pytest.mark.slow
def test_a_drone_whose_key_was_copied_is_kept_clear_of_and_told() -> None:
    least_m, told = flown({"kind": "copied-key", "at_s": AT_S, "for_s": FOR_S, "target": "d2"})
    assert told == {"d2: two sources send under its id (a copied key, or an agent started twice); both are kept clear of"}
    assert least_m > 3.0  # limits.separation_m of the mission, as without any fault


@pytest.mark.slow
def test_without_a_copy_nothing_is_told() -> None:
    least_m, told = flown()
    assert told == set()
    assert least_m > 3.0

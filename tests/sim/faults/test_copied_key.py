"""A thief with a copy of a drone's key publishes as that drone while the swarm flies: all keep apart, and name it."""

from itertools import combinations
from math import dist

import pytest
from msgspec.structs import replace

from radron.sim.campaign.faults.attacks import LANDED
from radron.sim.faults.kinds import read_faults
from radron.sim.lockstep.flight import watched
from radron.sim.scenario import load_scenario
from radron.sim.scoring.moment import Moment

AT_S, FOR_S = 20.0, 30.0
NAMED_S = 2.0
APART_M = 3.0  # limits.separation_m of the mission, as without any fault
TWO = "d2: two sources send under its id (a copied key, or an agent started twice); both are kept clear of"


def flown(*faults: dict[str, object]) -> tuple[float, dict[str, float]]:
    """The least true distance of two drones in the air, metres; and when each other drone has named d2, s after the beginning."""
    least_m, named_s = [float("inf")], dict[str, float]()

    def watch(moment: Moment) -> bool:
        if moment.time_s > AT_S:
            flying = [place for drone, place in enumerate(moment.position_m.tolist()) if moment.airborne(drone)]
            least_m.extend(dist(one, other) for one, other in combinations(flying, 2))
            for name, pilot in zip(("d1", "d2", "d3"), moment.pilots, strict=True):
                if pilot is not None and TWO in pilot.problems:
                    named_s.setdefault(name, moment.time_s - AT_S)
        return moment.time_s > AT_S + FOR_S

    watched(replace(load_scenario("paper-demo"), fault=read_faults(list(faults), "test")), 1, watch)
    return min(least_m), named_s


def thief(**numbers: object) -> dict[str, object]:
    return {"kind": "copied-key", "at_s": AT_S, "target": "d2"} | numbers


def pilot(mode: str) -> dict[str, object]:
    return {"kind": "takeover", "at_s": AT_S + 1.0, "target": "d2", "mode": mode}


@pytest.mark.slow
@pytest.mark.parametrize(
    "faults",
    [
        (thief(**LANDED[1]),),
        (thief(**LANDED[1]), pilot("hold")),  # 0.4 m apart before
        (thief(**LANDED[1]), pilot("return")),
        (thief(**LANDED[1] | {"epochs": 0, "beside_m": 2.0, "place": "ground"}), pilot("hold")),
        (thief(boot="same", beside_m=0.0, stage="return"), pilot("hold")),  # nothing but a word of it is false
    ],
)
def test_a_drone_whose_key_was_copied_is_kept_clear_of_and_named(faults: tuple[dict[str, object], ...]) -> None:
    least_m, named_s = flown(*faults)
    assert least_m > APART_M
    assert named_s.keys() == {"d1", "d3"}
    assert max(named_s.values()) < NAMED_S


@pytest.mark.slow
def test_without_a_copy_nobody_is_named() -> None:
    least_m, named_s = flown()
    assert named_s == {}
    assert least_m > APART_M

"""The choice of the source to circle among several."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig, TrackConfig
from radron.agent.fusion.estimator import Hypothesis
from radron.agent.navigation.focus import focus, have_had_turns, is_in_second_half, looks

AREA = AreaConfig(polygon_m=((0.0, 0.0), (50.0, 0.0), (50.0, 50.0), (0.0, 50.0)))


def mission(policy: str = "strongest") -> MissionConfig:
    drones = DroneInMission(id="d1"), DroneInMission(id="d2")
    return MissionConfig(name="test", drones=drones, area=AREA, track=TrackConfig(policy=policy, each_s=30.0))


def source(x: float, watched_s: float | None, nuclide: str = "Cs-137") -> Hypothesis:
    place = np.array((x, 0.0, 0.0))
    return Hypothesis(0, place, np.eye(3), np.zeros(3), 0, 0, 1e9, 1e8, nuclide=nuclide, watched_s=watched_s)


def circled(policy: str, *sources: Hypothesis) -> float:
    """x of the source that is chosen; the first one is the strongest."""
    hypothesis = replace(sources[0], evidence=50.0, others=sources[1:])
    chosen = focus(hypothesis, mission(policy))
    assert chosen is not None
    assert chosen.evidence == 50.0  # its circle is as close as its accuracy allows, whichever it is
    return float(chosen.position[0])


def test_one_source_is_the_hypothesis_itself() -> None:
    alone = source(1.0, None)
    assert focus(alone, mission("each")) is alone
    assert focus(None, mission()) is None


@pytest.mark.parametrize("policy", ["strongest", "each", "Co-60"])
def test_each_source_has_its_turn_first_and_one_that_has_begun_is_finished(policy: str) -> None:
    assert circled(policy, source(1.0, 10.0), source(2.0, 0.0), source(3.0, 5.0)) == 1.0
    assert circled(policy, source(1.0, 61.0), source(2.0, 8.0), source(3.0, 9.0)) == 3.0
    assert circled(policy, source(1.0, 61.0), source(2.0, 8.0), source(3.0, 60.0)) == 2.0


def test_then_the_policy_decides() -> None:
    watched = source(1.0, 70.0), source(2.0, 65.0, "Co-60"), source(3.0, 125.0)
    assert circled("strongest", *watched) == 1.0
    assert circled("Co-60", *watched) == 2.0
    assert circled("Ir-192", *watched) == 1.0
    assert circled("each", *watched) == 1.0
    assert circled("each", source(1.0, 130.0), *watched[1:]) == 2.0


def test_all_have_had_their_turns_when_the_last_one_has() -> None:
    def had(*watched_s: float) -> bool:
        first, *others = (source(1.0, each_s) for each_s in watched_s)
        return have_had_turns(replace(first, others=tuple(others)), mission())

    assert had(60.0)
    assert not had(59.0)
    assert had(70.0, 61.0)
    assert not had(300.0, 20.0)


@pytest.mark.parametrize(
    ("watched_s", "second"), [(0.0, False), (29.0, False), (31.0, True), (59.0, True), (61.0, False), (95.0, True), (None, False)]
)
def test_the_second_half_of_each_turn_is_the_same_for_all_with_equal_logs(watched_s: float | None, second: bool) -> None:
    """A turn of two drones is 60 s of both together; a source that moves has none."""
    assert is_in_second_half(source(1.0, watched_s), mission()) is second


@pytest.mark.parametrize("others", [(), (source(2.0, 5.0),)])
def test_where_one_may_be_that_moves_they_look_before_all_turns(others: tuple[Hypothesis, ...]) -> None:
    hypothesis = replace(source(1.0, 10.0), evidence=50.0, others=others)
    assert not looks(hypothesis)
    assert not looks(None)
    doubted = replace(hypothesis, look=source(7.0, None))
    assert looks(doubted)
    chosen = focus(doubted, mission())
    assert chosen is not None
    assert (chosen.position[0], chosen.evidence, chosen.others, chosen.look) == (7.0, 50.0, (), None)

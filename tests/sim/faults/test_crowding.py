"""Valid entries that are old, or far more than a camera measures, with a drone's key: all report them; logs end equal."""

from itertools import pairwise

import msgspec
import pytest
from msgspec.structs import replace

from radron.agent.pilot import Pilot
from radron.protocol.codec import decode_from
from radron.protocol.entries import Counts, Exposure, PoseSample
from radron.protocol.keys import drone_key
from radron.protocol.signing import Verifier
from radron.sim.faults.crowding import MAX_AT_ONCE, Crowd
from radron.sim.faults.kinds import KINDS, read_faults
from radron.sim.lockstep.flight import watched
from radron.sim.lockstep.members import SimulatedAuthority
from radron.sim.scenario import load_scenario
from radron.sim.scoring.invariants.convergence import exchange, work_off
from radron.sim.scoring.moment import EPOCH_NS, Moment

AT_S, FOR_S = 20.0, 20.0
SECOND = 1_000_000_000
NOW_NS = EPOCH_NS + 100 * SECOND
AUTHORITY = SimulatedAuthority(1)


def crowd(**given):
    """Crowd under d1's id after an exposure of d1."""
    fault = msgspec.convert({"at_s": 0.0} | given, KINDS[given["kind"]])
    made = Crowd(fault, "s", AUTHORITY.trust("d1"), "c" * 16)
    made.follow(exposure())
    return made


def exposure():
    return Exposure(
        stamp_ns=NOW_NS,
        end_ns=NOW_NS + SECOND // 2,
        drone="d1",
        mission="0" * 16,
        boot="a" * 16,
        sequence=1,
        epoch=2,
        live_time_s=0.5,
        counts=Counts(7, 1, 1),
        poses=(PoseSample(0, (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0)),),
        position_sigma_m=0.1,
        yaw_sigma_rad=0.1,
    )


@pytest.mark.parametrize("what", ["exposure", "cone", "coverage"])
def test_every_entry_is_valid_and_signed_and_as_many_come_as_are_wanted(what):
    made = crowd(kind="dense-entries", what=what, per_s=100.0)
    told = [entry for tick in range(41) for entry in made.due(NOW_NS + tick * SECOND // 20)]
    verifier = Verifier(AUTHORITY)
    assert len(told) == 1 + 200  # the credential
    assert all(verifier.accepts_entry(decode_from(key, payload), payload) for key, payload in told)
    assert {key for key, _ in told[1:]} == {drone_key("s", "d1", what)}


def test_exposures_follow_each_other_and_say_nothing_of_a_source():
    made = crowd(kind="dense-entries", what="exposure", per_s=900.0)
    told = [decode_from(key, payload) for tick in range(20) for key, payload in made.due(NOW_NS + tick * SECOND // 20)][1:]
    assert all(before.end_ns <= after.stamp_ns for before, after in pairwise(told))
    assert sum(one.live_time_s for one in told) <= 1.0
    assert max(len(made.due(NOW_NS + 10**6 * SECOND)) for _ in range(3)) <= MAX_AT_ONCE


def test_old_entries_are_as_old_as_they_are_to_be():
    made = crowd(kind="old-entries", per_s=3.0, ago_s=60.0)
    told = [decode_from(key, payload) for k in range(11) for key, payload in made.due(NOW_NS + k * SECOND)][1:]
    assert len(told) == 30
    assert {round(1e-9 * (one.stamp_ns - NOW_NS)) for one in told} == set(range(-59, -49))


def flown(fault: dict[str, object]) -> tuple[list[set[str]], list[Pilot]]:
    """Each drone's reports on d2, and the pilots, a while after the end of the fault."""
    told: list[set[str]] = [set(), set(), set()]
    pilots: list[Pilot] = []

    def watch(moment: Moment) -> bool:
        for place, one in enumerate(moment.pilots):
            assert one is not None
            told[place].update(text for text in one.problems if text.startswith("d2"))
        pilots[:] = [one for one in moment.pilots if one is not None]
        return moment.time_s > AT_S + FOR_S + 5.0

    case = read_faults([fault | {"at_s": AT_S, "for_s": FOR_S, "target": "d2"}], "test")
    watched(replace(load_scenario("paper-demo"), fault=case), 1, watch)
    return told, pilots


def judge(pilots: list[Pilot]) -> None:
    """The same digest and the same hypothesis, once all is exchanged."""
    now_ns = EPOCH_NS + round((AT_S + FOR_S + 5.0) * SECOND)
    exchange(pilots, now_ns)
    work_off(pilots, now_ns)
    assert len({one.digest for one in pilots}) == 1
    assert len({one.hypothesis.position.tobytes() for one in pilots if one.hypothesis is not None}) == 1
    assert not any(one.pending for one in pilots)


@pytest.mark.slow
def test_old_entries_are_told_by_all_others_and_in_all_hypotheses_in_the_end() -> None:
    told, pilots = flown({"kind": "old-entries", "per_s": 3.0, "ago_s": 60.0})
    assert all(any("come late again and again" in text for text in told[place]) for place in (0, 2))
    judge(pilots)


@pytest.mark.slow
def test_entries_that_are_too_many_are_told_by_all_others_and_held_by_all_in_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("radron.agent.fusion.admission.FIRST", 3_000.0)
    told, pilots = flown({"kind": "dense-entries", "what": "coverage", "per_s": 300.0})
    assert all(any("more log entries than three cameras" in text for text in told[place]) for place in (0, 2))
    judge(pilots)

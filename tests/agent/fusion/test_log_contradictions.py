"""A publisher that sends different drones different entries of one number: all logs come to leave the same out, and agree."""

from functools import partial

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radron.agent.fusion.exchange import MAX_ANSWER_ENTRIES, LogExchange
from radron.agent.fusion.log import ObservationLog, Outcome
from radron.protocol.codec import decode, encode
from radron.protocol.summary import BLOCK_ENTRIES, MAX_BLOCKS, decode_summary, encode_summary

UP = (0.0, 0.0, 1.0)
LIAR = ("a", "00000000000000b1")


@pytest.fixture(scope="session")
def mission(kit):
    return kit.mission_of()


@pytest.fixture(scope="session")
def entry(kit, mission):
    """An entry by drone and number; other versions of it are told apart by a length, some by the stamp as well."""
    first = kit.cone_entry(mission, 0.0, (0.0, 0.0, 3.0), UP, 1.0, drone="a", sequence=0)

    def made(number, version=0, drone="a"):
        stamp_ns = first.stamp_ns + 1000 * number + (version if version > 2 else 0)
        return msgspec.structs.replace(
            first, drone=drone, sequence=number, stamp_ns=stamp_ns, separation_mm=float(1 + version), boot=LIAR[1]
        )

    return made


class Holder:
    """A log whose owner removes entries that do not count, as drones do."""

    def __init__(self, mission, entries=()):
        self.log = ObservationLog(mission.mission_id, [drone.id for drone in mission.drones])
        self._exchange = LogExchange("swarm", "a", self.log, None)
        for one in entries:
            self.take(one)

    def take(self, one):
        outcome = self.log.add(one, encode(one))
        if outcome is Outcome.CONTRADICTION:
            for identity in self.log.beyond(one.drone, partial(self.log.last_counted, one.drone)):
                self.log.forget(identity)
        return outcome

    def ask(self, other):
        """Get the other log's entries that this log lacks; return their number."""
        replies = other._exchange.answer(self._exchange.summary())
        for _, payload in replies:
            self.take(decode(payload))
        return len(replies)

    @property
    def content(self):
        return self.log.digest, [record.payload for record in self.log], {k: v.number for k, v in self.log.contradictions.items()}


def exchanged(holders, rounds=40):
    """Each asks each, again and again, until no log gets anything any more."""
    for _ in range(rounds):
        if not sum(one.ask(other) for one in holders for other in holders if one is not other):
            return
    raise AssertionError("the exchange does not come to an end")


@settings(max_examples=60)
@given(
    told=st.lists(st.tuples(st.integers(0, 200), st.integers(0, 4), st.sampled_from("ab")), max_size=40),
    chance=st.randoms(use_true_random=False),
)
def test_what_is_left_out_does_not_depend_on_the_order_of_arrival(mission, entry, told, chance):
    made = [entry(number, version, drone) for number, version, drone in told]
    logs = [Holder(mission, chance.sample(made, len(made))) for _ in range(3)]
    assert logs[0].content == logs[1].content == logs[2].content
    versions = {number: {version for at, version, drone in told if at == number and drone == "a"} for number, _, _ in told}
    contradicted = [number for number, found in versions.items() if len(found) > 1]
    assert logs[0].log.last_counted(*LIAR) == (min(contradicted) - 1 if contradicted else 1 << 64)
    held = [record.entry.sequence for record in logs[0].log if record.entry.drone == "a"]
    assert all(number < min(contradicted, default=1 << 64) for number in held)


@settings(max_examples=60)
@given(
    told=st.lists(st.tuples(st.integers(0, 200), st.integers(0, 3), st.sampled_from("ab")), max_size=60),
    parts=st.lists(st.integers(0, 2), min_size=60, max_size=60),
)
def test_logs_that_were_told_different_things_agree_after_the_exchange(mission, entry, told, parts):
    """In any distribution: each got a part, and no log two versions of a number."""
    made = [entry(number, version, drone) for number, version, drone in told]
    logs = [Holder(mission) for _ in range(3)]
    for one, part in zip(made, parts, strict=False):
        logs[part].take(one)
    exchanged(logs)
    assert logs[0].content == logs[1].content == logs[2].content
    assert logs[0].content == Holder(mission, made).content


def test_one_entry_of_a_long_log_is_found(mission, entry):
    """In more blocks than a summary carries, at any place; with gaps, and while more is coming."""
    count = (MAX_BLOCKS + 40) * BLOCK_ENTRIES
    numbers = [number for number in range(count) if number % 17]
    for place in (1, count // 2 + 1, count - 1):
        one, other = Holder(mission), Holder(mission)
        for number in numbers:
            one.take(entry(number))
            other.take(entry(number, version=int(number == place)))
        for more in range(count, count + 200):
            one.take(entry(more))
        exchanged([one, other])
        assert one.content == other.content
        assert one.log.last_counted(*LIAR) == place - 1
        assert len(one.log) == sum(number < place for number in numbers)


def test_a_log_without_contradiction_is_asked_and_told_nothing_twice(mission, entry):
    one = Holder(mission, [entry(number) for number in range(300)])
    other = Holder(mission, [entry(number) for number in range(0, 300, 2)])
    assert other.ask(one) == 150
    assert (other.ask(one), one.ask(other)) == (0, 0)
    one.take(entry(300))
    assert (one.ask(other), other.ask(one)) == (0, 1)


def test_the_proof_is_enough_and_nothing_that_does_not_count_is_sent(mission, entry):
    """A log with many of the liar's entries needs two; a log that has left them out gets none any more."""
    one = Holder(mission, [entry(number) for number in range(400)])
    other = Holder(mission, [entry(number) for number in range(10, 400)])
    assert one.take(entry(7, version=1)) is Outcome.CONTRADICTION
    assert one.take(entry(7)) is Outcome.LEFT_OUT
    assert one.take(entry(8)) is Outcome.LEFT_OUT
    late = Holder(mission, [entry(number) for number in range(400)])
    assert other.ask(one) == 2 + 7
    assert one.ask(late) == 0
    assert late.ask(one) == 2
    assert one.content == other.content == late.content
    assert len(one.log.contradictions[LIAR].proof) == 2


def test_a_publisher_of_which_nothing_counts_is_told_all_the_same(mission, entry):
    """Else its entries would be sent again and again."""
    one = Holder(mission, [entry(0), entry(0, version=1)])
    assert len(one.log) == 0
    _, told = decode_summary(encode_summary(mission.mission_id, one.log.summary()))
    assert told[LIAR].cut == 0
    assert one.ask(Holder(mission, [entry(number) for number in range(1, 50)])) == 0


def test_an_answer_stays_within_its_limit_whatever_is_contradicted(mission, entry):
    one = Holder(mission, [entry(number) for number in range(2000)])
    other = Holder(mission, [entry(number, version=1) for number in range(2000)])
    assert one.ask(other) == MAX_ANSWER_ENTRIES
    assert one.log.last_counted(*LIAR) == -1

"""Exchange between two pilots' logs: all missing entries, in bounded portions, and nothing else."""

from radron.agent.config.mission import MissionConfig
from radron.agent.fusion.exchange import MAX_ANSWER_BYTES, MAX_ANSWER_ENTRIES
from radron.protocol.codec import encode
from radron.protocol.keys import key_of
from radron.protocol.summary import encode_summary
from support.flights.one_pilot import AREA, MISSION, SECOND, START_NS, cone_of, pilot

END_NS = START_NS + 3600 * SECOND
OTHER = MissionConfig(name="other", area=AREA, drones=MISSION.drones)


def give(one, sequences, boot="2" * 16, drone="d2"):
    for sequence in sequences:
        cone = cone_of(drone, sequence, START_NS + sequence * SECOND // 10, boot)
        one.receive(key_of("radron", cone), encode(cone), END_NS)


def settle(*pilots):
    for one in pilots:
        for _ in range(20):
            one.advance(END_NS)
        assert not one.pending


def exchange(asking, asked):
    """Send one query; return the number of replies."""
    replies = asked.log_answer(asking.log_summary())
    for key, payload in replies:
        asking.receive(key, payload, END_NS)
    return len(replies)


def test_an_empty_log_gets_everything_in_portions_of_the_oldest_and_then_the_same_hypothesis():
    full, empty = pilot("d2"), pilot("d1")
    give(full, range(MAX_ANSWER_ENTRIES + 200))
    replies = full.log_answer(empty.log_summary())
    assert [payload for _, payload in replies] == [record.payload for record in full.fusion.log][:MAX_ANSWER_ENTRIES]
    assert sum(len(payload) for _, payload in replies) <= MAX_ANSWER_BYTES
    assert [exchange(empty, full) for _ in range(3)] == [MAX_ANSWER_ENTRIES, 200, 0]
    settle(full, empty)
    assert empty.digest == full.digest
    assert empty.hypothesis.position.tobytes() == full.hypothesis.position.tobytes()
    assert empty.hypothesis.covariance.tobytes() == full.hypothesis.covariance.tobytes()


def test_each_gets_just_what_it_lacks():
    one, other = pilot("d1"), pilot("d2")
    give(one, [1, 2, 3, 7, 8])
    give(other, [2, 3, 4, 8, 9])
    give(other, [1, 2], boot="3" * 16)
    assert exchange(one, other) == 4
    assert exchange(other, one) == 2
    assert one.digest == other.digest
    assert exchange(one, other) == exchange(other, one) == 0


def test_a_restarted_drone_gets_back_its_own_entries():
    before, partner, after = pilot("d1"), pilot("d2"), pilot("d1", boot="f" * 16)
    give(before, range(12), boot="0" * 15 + "1", drone="d1")
    assert exchange(partner, before) == 12
    assert exchange(after, partner) == 12
    settle(partner, after)
    assert after.digest == before.digest
    assert after.hypothesis is not None


def test_a_request_that_is_none_and_one_of_another_mission_get_nothing():
    one = pilot()
    give(one, range(3))
    assert one.log_answer(b"\xc1 no summary") == []
    assert one.log_answer(encode_summary(OTHER.mission_id, {})) == []
    assert one.counters["rejected_malformed"] == one.counters["dropped_query_of_another_mission"] == 1

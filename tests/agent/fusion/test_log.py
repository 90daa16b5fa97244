import hashlib
import random

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radron.agent.fusion.log import ObservationLog, Outcome
from radron.agent.fusion.sequences import SequenceSet
from radron.protocol.codec import encode
from radron.protocol.entries import Cone, Coverage
from radron.protocol.summary import MAX_SUMMARY_PUBLISHERS, Held

UP = (0.0, 0.0, 1.0)
MOST = 500


@pytest.fixture(scope="session")
def mission(kit):
    return kit.mission_of()


@pytest.fixture(scope="session")
def entries(kit, mission):
    return [
        kit.cone_entry(mission, index * 0.7, (index, 0.0, 3.0), UP, 1.0, drone="abc"[index % 3], sequence=index // 3)
        for index in range(12)
    ]


def empty_log(mission):
    return ObservationLog(mission.mission_id, [drone.id for drone in mission.drones])


def log_of(mission, entries):
    log = empty_log(mission)
    for entry in entries:
        log.add(entry, encode(entry))
    return log


def test_digest_is_the_sum_of_the_hashes_of_the_bytes(mission, entries):
    log = log_of(mission, entries)
    total = sum(int.from_bytes(hashlib.blake2b(encode(e), digest_size=16).digest(), "big") for e in entries)
    assert log.digest == f"{total % 2**128:032x}"
    assert empty_log(mission).digest == "0" * 32


def test_payloads_are_kept_verbatim_in_order(mission, entries):
    log = log_of(mission, reversed(entries))
    assert [record.payload for record in log] == [encode(entry) for entry in entries]


def test_bytes_count_and_not_their_meaning(mission, entries):
    """A map with an unknown field decodes to the same entry, and is another observation to the digest."""
    log, other = empty_log(mission), empty_log(mission)
    payload = encode(entries[0])
    log.add(entries[0], payload)
    other.add(entries[0], payload + b"\x00")
    assert log.digest != other.digest


@given(seed=st.integers(0, 2**32))
def test_order_and_duplicates_leave_no_trace(mission, entries, seed):
    shuffled = entries + random.Random(seed).choices(entries, k=5)
    random.Random(seed + 1).shuffle(shuffled)
    log, plain = log_of(mission, shuffled), log_of(mission, entries)
    assert log.digest == plain.digest
    assert log.summary() == plain.summary()
    assert log.counters["duplicate"] == 5
    assert [record.payload for record in log] == [record.payload for record in plain]


def test_another_mission_is_refused(mission, entries):
    log = empty_log(mission)
    foreign = msgspec.structs.replace(entries[0], mission="f" * 16)
    assert log.add(foreign, encode(foreign)) is Outcome.FOREIGN
    assert (len(log), log.digest, log.summary(), log.counters["foreign"]) == (0, "0" * 32, {}, 1)


def test_a_drone_that_is_not_in_the_mission_is_refused(mission, entries):
    """However many an attacker makes up, they fill no memory: neither records nor ranges of sequence numbers."""
    log = empty_log(mission)
    for number in range(20):
        stranger = msgspec.structs.replace(entries[0], drone=f"stranger-{number}")
        assert log.add(stranger, encode(stranger)) is Outcome.FOREIGN
    assert (len(log), log.digest, log._held, log.counters["foreign"]) == (0, "0" * 32, {}, 20)


def test_a_peer_is_told_what_it_lacks(mission, entries):
    full = log_of(mission, entries)
    partial = log_of(mission, entries[:5] + entries[8:])
    missing = full.missing_from(partial.summary(), MOST)
    assert sorted((record.entry for _, record in missing), key=lambda entry: entry.entry_id) == entries[5:8]
    assert partial.missing_from(full.summary(), MOST) == []
    for _, record in missing:
        partial.add(record.entry, record.payload)
    assert partial.digest == full.digest


def gapped(entries, count, drone="a", boot="00000000000000b1"):
    """Every second sequence number of a publisher, each with its bytes."""
    for number in range(count):
        stamp_ns = entries[0].stamp_ns + number
        entry = msgspec.structs.replace(entries[0], drone=drone, boot=boot, sequence=2 * number, stamp_ns=stamp_ns)
        yield entry, b"%s%s%d" % (drone.encode(), boot.encode(), number)


class CountedDict(dict):
    """Counts what is looked up."""

    looked = 0

    def __getitem__(self, key):
        type(self).looked += 1
        return super().__getitem__(key)


def test_an_answer_costs_what_is_in_it_however_many_gaps_there_are(mission, entries):
    log = empty_log(mission)
    for entry, payload in gapped(entries, 20_000):
        log.add(entry, payload)
    log._payloads[Cone] = CountedDict(log._payloads[Cone])
    for summary, found in ({}, MOST), (log.summary(), 0), ({("a", "00000000000000b1"): Held(((0, 10**6),))}, 0):
        CountedDict.looked = 0
        assert len(log.missing_from(summary, MOST)) == found
        assert CountedDict.looked <= 2 * MOST
    held, whole = log._held["a", "00000000000000b1"], SequenceSet([(0, 10**6)])
    held._firsts = CountedList(held._firsts)
    CountedList.looked = 0
    assert list(held.without(whole)) == []
    assert CountedList.looked == 1  # a range held by the peer is passed over at once


class CountedList(list):
    """Counts what is looked up."""

    looked = 0

    def __getitem__(self, at):
        type(self).looked += 1
        return super().__getitem__(at)


def test_nobodys_entries_wait_for_those_of_a_drone_that_has_many(mission, entries):
    log = empty_log(mission)
    for boot in range(2 * MAX_SUMMARY_PUBLISHERS):
        for entry, payload in gapped(entries, 1, boot=f"{boot:016x}"):
            log.add(entry, payload)
    for entry, payload in gapped(entries, 20, drone="b"):
        log.add(entry, payload)
    missing = log.missing_from({}, 100)
    assert sum(identity.drone == "b" for identity, _ in missing) == 20
    assert len(log.summary()) == MAX_SUMMARY_PUBLISHERS
    assert ("b", "00000000000000b1") in log.summary()


def test_another_boot_is_another_publisher(mission, entries, kit):
    reborn = kit.cone_entry(mission, 0.0, (0.0, 0.0, 3.0), UP, 1.0, drone="a", sequence=0, boot="00000000000000b2")
    log = log_of(mission, [*entries, reborn])
    assert len(log) == 13
    assert log.summary()["a", "00000000000000b2"].ranges == ((0, 0),)
    assert log.missing_from(log_of(mission, entries).summary(), MOST)[0][1].entry == reborn


@given(seed=st.integers(0, 2**32))
def test_entries_of_a_kind_are_a_function_of_the_content(mission, entries, seed):
    """In their order, and their revision shows a change."""
    path = {"path_m": ((0.0, 0.0), (1.0, 0.0)), "swath_m": 5.0, "epoch": 0, "sequence": 99}
    shared = {name: getattr(entries[0], name) for name in ("stamp_ns", "drone", "mission", "boot")}
    mixed = [*entries[:3], Coverage(**shared | path)]
    random.Random(seed).shuffle(shuffled := [*mixed, *mixed[:2]])
    log = empty_log(mission)
    for entry in shuffled:
        before = {kind: (log.revision(kind), log.entries(kind)) for kind in (Cone, Coverage)}
        log.add(entry, encode(entry))
        for kind, (revision, held) in before.items():
            assert (log.revision(kind) > revision) == (log.entries(kind) != held)
    assert (log.entries(Cone), log.entries(Coverage)) == (mixed[:3], mixed[3:])


@settings(max_examples=50)
@given(kept=st.sets(st.integers(0, 11)), chance=st.randoms(use_true_random=False))
def test_what_is_forgotten_leaves_no_trace(mission, entries, kept, chance):
    """Forgotten entries can be taken again."""
    left = [entry for place, entry in enumerate(entries) if place in kept]
    gone = [entry for entry in entries if entry not in left]
    chance.shuffle(gone)
    log, plain = log_of(mission, chance.sample(entries, len(entries))), log_of(mission, left)
    assert all(log.forget(entry.entry_id) for entry in gone)
    assert not any(log.forget(entry.entry_id) for entry in gone)
    assert log.digest == plain.digest
    assert log.summary() == plain.summary()
    assert [record.payload for record in log] == [record.payload for record in plain]
    told = [[identity for identity, _ in one.missing_from({}, MOST)] for one in (log, plain)]
    assert sorted(told[0]) == sorted(told[1])
    assert all(log.add(entry, encode(entry)) is Outcome.ADDED for entry in gone)
    assert log.digest == log_of(mission, entries).digest


def test_what_lies_beyond_a_number_is_told_in_order(mission, entries):
    log = log_of(mission, entries)
    assert log.beyond("a", lambda boot: 1) == sorted(e.entry_id for e in entries if e.drone == "a" and e.sequence > 1)
    assert log.beyond("a", lambda boot: -1) == sorted(e.entry_id for e in entries if e.drone == "a")
    assert log.beyond("z", lambda boot: -1) == []

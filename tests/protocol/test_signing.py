"""Signatures: a publisher's signed messages are accepted from any relay; everything else is not."""

import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import UNSET, msgpack
from msgspec.structs import replace

from radron.protocol.codec import MAX_ENTRY_BYTES, decode, encode
from radron.protocol.entries import SIGNATURE_BYTES
from radron.protocol.errors import ProtocolError
from radron.protocol.messages import Obeyed, Stage, Status, Ticket
from radron.protocol.signing import MAX_BATCH_ENTRIES, Verifier, sign_entries, sign_status
from support.flights.members import AUTHORITY, FOREIGN, cones, credential
from support.flights.one_pilot import MISSION, START_NS


def verifier(*credentials):
    one = Verifier(AUTHORITY)
    for entry in credentials or (credential(),):
        assert one.accepts_entry(entry, encode(entry))
    return one


def accepted(one, entry):
    return one.accepts_entry(entry, encode(entry))


@pytest.mark.parametrize("number", [1, 2, 3, 5, 8, MAX_BATCH_ENTRIES, MAX_BATCH_ENTRIES + 1])
def test_each_entry_of_a_batch_is_proven_by_itself(number):
    for entry in reversed(cones(range(1, number + 1))):
        assert accepted(verifier(), entry)


def test_a_batch_costs_one_signature_and_one_verification():
    signed: list[bytes] = []
    batch = cones(range(1, 9), sign=lambda data: signed.append(data) or AUTHORITY.trust("d2").sign(data))
    assert len(signed) == 1
    assert {entry.proof[:SIGNATURE_BYTES] for entry in batch} == {AUTHORITY.trust("d2").sign(signed[0])}
    one = verifier()
    assert all(accepted(one, entry) for entry in batch)
    assert len(one._roots) == 2  # of the credential and of the batch


def test_a_changed_entry_is_not_accepted():
    (entry,) = cones([1])
    changes = {"sequence": 7, "stamp_ns": START_NS, "apex_sigma_m": 0.2, "boot": "3" * 16, "proof": b"", "separation_mm": 1.6}
    one = verifier(credential(), credential(boot="3" * 16))
    for field, value in changes.items():
        assert not accepted(one, replace(entry, **{field: value})), field
    assert accepted(one, entry)


@given(data=st.data())
def test_no_changed_byte_of_a_proof_is_accepted(data):
    one, entry = verifier(), cones([1, 2, 3])[data.draw(st.integers(0, 2))]
    place = data.draw(st.integers(0, len(entry.proof) - 1))
    proof = bytearray(entry.proof)
    proof[place] ^= data.draw(st.integers(1, 255))
    assert not accepted(one, replace(entry, proof=bytes(proof)))
    assert not accepted(one, replace(entry, proof=entry.proof[:place]))
    assert not accepted(one, replace(entry, proof=entry.proof + bytes(16)))


def test_the_proof_of_another_entry_of_the_batch_does_not_fit():
    first, second = cones([1, 2])
    assert not accepted(verifier(), replace(first, proof=second.proof))


def test_an_entry_under_another_name_is_not_accepted():
    """d1 signs an entry in d2's name with its own key."""
    one = verifier(credential(), credential("d1", "1" * 16))
    assert not accepted(one, cones([1], sign=AUTHORITY.trust("d1").sign)[0])
    assert accepted(one, cones([1], "d1", "1" * 16)[0])


def test_bytes_that_only_read_the_same_are_not_accepted():
    """A relay could otherwise give the same entry other bytes, and with them logs another digest."""
    (entry,) = cones([1])
    written = encode(entry)
    assert not verifier().accepts_entry(entry, bytes([written[0] + 1]) + written[1:] + b"\xa1x\x00")
    assert verifier().accepts_entry(entry, written)


@pytest.mark.parametrize(
    "wrong",
    [
        credential(trust=FOREIGN.trust("d2")),  # another authority's
        credential(trust=AUTHORITY.trust("d1")),  # another drone's
        credential(trust=AUTHORITY.trust("d2", "operator")),
        credential(trust=AUTHORITY.trust("d2", "observer")),
        credential(sequence=1),
        replace(credential(), boot="3" * 16),  # of another boot
        credential(certificate=b""),
        credential(certificate=b"\x30\x82" + bytes(200)),
    ],
)
def test_a_credential_that_is_not_the_drones_is_refused_and_vouches_for_nothing(wrong):
    one = Verifier(AUTHORITY)
    assert not accepted(one, wrong)
    assert not any(accepted(one, entry) for entry in cones([1, 2], boot=wrong.boot))


def test_a_credential_is_judged_by_itself_whatever_was_signed_together_with_it():
    """Else logs would differ by the order of arrival: after the cone its root is known, before it is not."""
    trust = AUTHORITY.trust("d2")
    cone, wrong = sign_entries([replace(cones([1])[0], proof=b""), replace(credential(sequence=5), proof=b"")], trust.sign)
    one = verifier()
    assert accepted(one, cone)
    assert not accepted(one, wrong)


class Expiring:
    """An authority; its certificates hold for one hour from the start."""

    def verify(self, der):
        times = {"not_before_ns": START_NS, "not_after_ns": START_NS + 3600 * 10**9}
        return dataclasses.replace(AUTHORITY.verify(der), **times)


@pytest.mark.parametrize(("after_s", "holds"), [(-1, False), (0, True), (3599, True), (3601, False)])
def test_a_certificate_must_be_valid_when_the_boot_begins_and_nothing_is_cut_afterwards(after_s, holds):
    one = Verifier(Expiring())
    first = credential(stamp_ns=START_NS + after_s * 10**9)
    assert accepted(one, first) == holds
    late = next(sign_entries([replace(cones([1])[0], stamp_ns=START_NS + 7200 * 10**9)], AUTHORITY.trust("d2").sign))
    assert accepted(one, late) == holds


def test_a_proof_leaves_room_for_the_largest_entry():
    assert max(len(entry.proof) for entry in cones(range(MAX_BATCH_ENTRIES))) == SIGNATURE_BYTES + 1 + 16 * 5
    with pytest.raises(ProtocolError):
        encode(replace(cones([1])[0], proof=bytes(SIGNATURE_BYTES + 1 + 16 * 6)))
    assert len(encode(cones(range(MAX_BATCH_ENTRIES))[0])) < MAX_ENTRY_BYTES


def status(**changes):
    told = {"mission": MISSION.mission_id, "boot": "2" * 16, "stage": Stage.HOLD, "ticket": Ticket("0" * 16, 6), **changes}
    return sign_status(Status(stamp_ns=START_NS, drone="d2", **told), AUTHORITY.trust("d2"))


HOLD = Obeyed("hold", "anna", START_NS, 5)


def test_a_status_without_an_obeyed_order_has_the_former_bytes_and_its_signature_holds():
    """Records of older agents replay bit for bit, and their statuses count."""
    fields = list(msgpack.decode(encode(status())))
    assert fields[:7] == ["kind", "stamp_ns", "drone", "mission", "boot", "stage", "battery"]
    assert fields[7:13] == ["counters", "problems", "finding", "recognised", "started_ns", "notices"]
    assert fields[13:] == ["delays_ns", "ticket", "failsafe", "upload", "certificate", "signature"]
    read = decode(encode(status()))
    assert read.obeyed is UNSET
    assert Verifier(AUTHORITY).accepts_status(read)
    assert not Verifier(AUTHORITY).accepts_obeyed(read)


def test_a_reader_that_does_not_know_the_obeyed_order_can_verify_the_rest():
    fields = msgpack.decode(encode(status(obeyed=HOLD)))
    del fields["obeyed"]  # left out where unknown
    assert fields == msgpack.decode(encode(status()))


def test_the_obeyed_order_is_signed_by_its_drone_with_the_status_around_it():
    one, told = Verifier(AUTHORITY), decode(encode(status(obeyed=HOLD)))
    assert one.accepts_status(told)
    assert one.accepts_obeyed(told)
    for field, value in {"order": "land", "station": "bert", "stamp_ns": 1, "number": 4, "signature": b""}.items():
        assert not one.accepts_obeyed(replace(told, obeyed=replace(told.obeyed, **{field: value}))), field
    later = sign_status(replace(status(), stamp_ns=START_NS + 1), AUTHORITY.trust("d2"))
    assert not one.accepts_obeyed(replace(later, obeyed=told.obeyed))
    assert not one.accepts_obeyed(replace(told, obeyed=replace(told.obeyed, signature=told.signature)))

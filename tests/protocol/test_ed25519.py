"""Signatures by libsodium: the library of the certificates decides alike on all messages possible without the key."""

from __future__ import annotations

import hashlib

import pytest
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from hypothesis import given
from hypothesis import strategies as st

from radron.protocol.ed25519 import PublicKey, Signer

ORDER = 2**252 + 27742317777372353535851937790883648493  # of the base point (RFC 8032, 5.1)
PRIME = 2**255 - 19
BASE = bytes.fromhex("58" + "66" * 31)  # the base point
NEUTRAL = (1).to_bytes(32, "little")  # the neutral element, of order 1
OF_ORDER_2, OF_ORDER_4 = (PRIME - 1).to_bytes(32, "little"), bytes(32)
SMALL = {
    "neutral": NEUTRAL,
    "order 2": OF_ORDER_2,
    "order 4": OF_ORDER_4,
    "neutral, not canonical": (PRIME + 1).to_bytes(32, "little"),
    "neutral, with a sign": (1 | 1 << 255).to_bytes(32, "little"),
}

seeds, data = st.binary(min_size=32, max_size=32), st.binary(max_size=200)


def by_the_other(key: bytes, signature: bytes, signed: bytes) -> bool:
    try:
        Ed25519PublicKey.from_public_bytes(key).verify(signature, signed)
    except (InvalidSignature, ValueError):  # ValueError: no point of the curve
        return False
    return True


def by_ours(key: bytes, signature: bytes, signed: bytes) -> bool:
    return PublicKey(Ed25519PublicKey.from_public_bytes(key)).verified(signature, signed)


def both(key: bytes, signature: bytes, signed: bytes) -> bool:
    """Decisions of both libraries."""
    decisions = by_ours(key, signature, signed), by_the_other(key, signature, signed)
    assert decisions[0] == decisions[1], (key.hex(), signature.hex(), signed.hex())
    return decisions[0]


def flipped(content: bytes, bit: int) -> bytes:
    return (int.from_bytes(content, "little") ^ 1 << bit).to_bytes(len(content), "little")


@given(seed=seeds, signed=data)
def test_both_libraries_make_the_same_signature_and_accept_it(seed: bytes, signed: bytes) -> None:
    key = Ed25519PrivateKey.from_private_bytes(seed)
    signature = Signer(key)(signed)
    assert signature == key.sign(signed)
    assert both(key.public_key().public_bytes_raw(), signature, signed)


@given(seed=seeds, signed=data, bit=st.integers(0, 511))
def test_no_changed_bit_of_a_signature_is_accepted_by_either(seed: bytes, signed: bytes, bit: int) -> None:
    key = Ed25519PrivateKey.from_private_bytes(seed)
    assert not both(key.public_key().public_bytes_raw(), flipped(key.sign(signed), bit), signed)


@given(seed=seeds, signed=st.binary(min_size=1, max_size=200), at=st.data())
def test_with_a_changed_bit_of_the_key_or_the_content_it_is_accepted_by_neither(
    seed: bytes, signed: bytes, at: st.DataObject
) -> None:
    key = Ed25519PrivateKey.from_private_bytes(seed)
    public, signature = key.public_key().public_bytes_raw(), key.sign(signed)
    assert not both(public, signature, flipped(signed, at.draw(st.integers(0, 8 * len(signed) - 1))))
    assert not both(flipped(public, at.draw(st.integers(0, 255))), signature, signed)


@given(key=seeds, signature=st.binary(max_size=96), signed=data)
def test_garbage_is_accepted_by_neither(key: bytes, signature: bytes, signed: bytes) -> None:
    assert not both(key, signature, signed)


@given(seed=seeds, signed=data, cut=st.integers(0, 63))
def test_the_signature_must_have_its_length(seed: bytes, signed: bytes, cut: int) -> None:
    """Also if its end stands at the beginning of the signed bytes: libsodium takes both in one piece."""
    key = Ed25519PrivateKey.from_private_bytes(seed)
    public, signature = key.public_key().public_bytes_raw(), key.sign(signed)
    assert both(public, signature, signed)
    assert not both(public, signature[:cut], signature[cut:] + signed)
    assert not both(public, signature[:cut], signed)
    assert not both(public, signature + signed[:1] + b"\0", signed[1:])


@given(seed=seeds, signed=data, times=st.integers(1, 14))
def test_the_same_signature_with_a_larger_number_is_accepted_by_neither(seed: bytes, signed: bytes, times: int) -> None:
    """S and S + L fulfil the same equation: RFC 8032 (5.1.7) has S below L, so that a signature cannot be changed."""
    key = Ed25519PrivateKey.from_private_bytes(seed)
    signature = key.sign(signed)
    larger = int.from_bytes(signature[32:], "little") + times * ORDER
    assert not both(key.public_key().public_bytes_raw(), signature[:32] + larger.to_bytes(32, "little"), signed)


def made_by_the_holder(seed: bytes, point: bytes, nonce: int, signed: bytes) -> tuple[bytes, bytes]:
    """Public key, and a signature with this point R in place of that of the nonce."""
    public = Ed25519PrivateKey.from_private_bytes(seed).public_key().public_bytes_raw()
    secret = int.from_bytes(hashlib.sha512(seed).digest()[:32], "little") & (1 << 254) - 8 | 1 << 254
    challenge = int.from_bytes(hashlib.sha512(point + public + signed).digest(), "little")
    return public, point + ((nonce + challenge * secret) % ORDER).to_bytes(32, "little")


@given(seed=seeds, signed=data)
def test_the_holder_of_a_key_cannot_part_the_libraries_by_a_point_outside_the_subgroup(seed: bytes, signed: bytes) -> None:
    """Verified with the cofactor, as RFC 8032 allows, these would hold: then two versions of a library could part two drones."""
    assert both(*made_by_the_holder(seed, BASE, 1, signed), signed)
    opposite = PRIME - int.from_bytes(BASE, "little") | 1 << 255  # the base point and that of order 2: (-x, -y)
    assert not both(*made_by_the_holder(seed, opposite.to_bytes(32, "little"), 1, signed), signed)
    for point in (OF_ORDER_2, OF_ORDER_4):
        assert not both(*made_by_the_holder(seed, point, 0, signed), signed)


@pytest.mark.parametrize("signed", [b"", b"radron"])
def test_ours_is_the_stricter_one_on_what_gives_a_key_away(signed: bytes) -> None:
    """With a nonce of zero everybody can compute the key from S."""
    public, signature = made_by_the_holder(bytes(range(32)), NEUTRAL, 0, signed)
    assert by_the_other(public, signature, signed)
    assert not by_ours(public, signature, signed)


@pytest.mark.parametrize("name", SMALL)
def test_ours_accepts_nothing_under_a_key_of_small_order(name: str) -> None:
    """Under the neutral element everything would be signed by everybody."""
    signature = BASE + (1).to_bytes(32, "little")
    assert not any(by_ours(SMALL[name], signature, bytes((number,))) for number in range(32))
    assert by_the_other(SMALL[name], signature, b"anything") == name.startswith("neutral")

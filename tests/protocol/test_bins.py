"""Counts by channel of ordinary detectors in exposures."""

from __future__ import annotations

import msgpack
import msgspec
import pytest
from msgspec.structs import replace

from radron.protocol.codec import MAX_ENTRY_BYTES, decode, encode
from radron.protocol.entries import MAX_CHANNELS, Counts, Exposure, PoseSample
from radron.protocol.errors import ProtocolError

HEX = "0123456789abcdef"
CAMERA = Exposure(
    stamp_ns=1_000_000_000,
    drone="d1",
    mission=HEX,
    boot=HEX,
    sequence=7,
    epoch=0,
    end_ns=1_500_000_000,
    live_time_s=0.49,
    counts=Counts(6, 0, 0),
    poses=tuple(PoseSample(k * 25_000_000, (-999.123456, 1.0, 3.0), (0.5, 0.5, 0.5, 0.5)) for k in range(16)),
    position_sigma_m=0.1,
    yaw_sigma_rad=0.05,
)


def test_exposure_with_bins() -> None:
    exposure = replace(CAMERA, bins=(1, 0, 5))
    assert decode(encode(exposure)) == exposure


def test_exposure_of_a_camera_is_the_same_bytes_as_before_there_were_bins() -> None:
    payload = encode(CAMERA)
    assert b"bins" not in payload
    read = decode(payload)
    assert isinstance(read, Exposure)
    assert not read.bins


def test_largest_spectrum_fits_an_entry() -> None:
    bins = (9999,) * MAX_CHANNELS
    exposure = replace(CAMERA, bins=bins, counts=Counts(sum(bins), 0, 0), proof=b"0" * 145)
    assert len(encode(exposure)) <= MAX_ENTRY_BYTES


@pytest.mark.parametrize("bins", [(), (1, 2), (7, -1), (6.5,), "6", [6] * (MAX_CHANNELS + 1)])
def test_bins_that_contradict_the_counts_are_refused(bins: object) -> None:
    document = msgspec.to_builtins(CAMERA, builtin_types=(bytes,))
    with pytest.raises(ProtocolError):
        decode(msgpack.packb({**document, "bins": bins}))

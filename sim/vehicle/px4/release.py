"""Versions of PX4 that the emulation distinguishes; each is held to its recordings (``tests/contract``)."""

from __future__ import annotations

from typing import Literal

from msgspec import Struct

ReleaseName = Literal["1.16", "1.17"]


class Release(Struct, frozen=True):
    """A version of PX4 whose behaviour is emulated.

    software: version number as in AUTOPILOT_VERSION: major, minor, patch and kind, a byte each. heading_reset_m: height above the
    ground at which it resets its heading in each takeoff; None: it does not.
    """

    software: int
    heading_reset_m: float | None = None


RELEASES: dict[ReleaseName, Release] = {
    "1.16": Release(0x01_10_01_FF, heading_reset_m=1.5),  # stable v1.16.1
    "1.17": Release(0x01_11_00_FF),  # main of March 2026, tagged v1.17.0
}

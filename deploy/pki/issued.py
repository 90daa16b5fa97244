"""An authority's record of issued certificates."""

from __future__ import annotations

import msgspec

from protocol.identity import Role


class Issued(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An issued certificate. Times: UTC, nanoseconds; ``serial``: hexadecimal, as other tools show it."""

    name: str
    role: Role
    serial: str
    not_before_ns: int
    not_after_ns: int
    revoked_ns: int | None = None
    may_revoke: bool = False

"""Record of the certificates that an authority has issued."""

from __future__ import annotations

import msgspec

from radron.protocol.identity import Role


class Issued(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An issued certificate in the authority's record.

    Times: nanoseconds UTC; ``revoked_ns`` is None for a certificate that is not revoked. ``serial``: hexadecimal, as other tools
    show it.
    """

    name: str
    role: Role
    serial: str
    not_before_ns: int
    not_after_ns: int
    revoked_ns: int | None = None
    may_revoke: bool = False

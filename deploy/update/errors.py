"""The one error of the commands for updates."""

from __future__ import annotations

from protocol.errors import ProtocolError


class UpdateError(ProtocolError):
    """Something that the user can fix, in one line: what, where, what to do."""

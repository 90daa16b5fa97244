"""The one error of the commands for updates."""

from __future__ import annotations

from protocol.errors import ProtocolError


class UpdateError(ProtocolError):
    """An error that the user can fix. Its one line names the fault, its place and the remedy."""

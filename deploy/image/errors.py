"""The one error of the disk's commands."""

from __future__ import annotations

from protocol.errors import ProtocolError


class ImageError(ProtocolError):
    """An error that the user can fix. Its one line names the fault, its place and the remedy."""

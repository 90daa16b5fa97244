"""The one error of the disk's commands."""

from __future__ import annotations

from protocol.errors import ProtocolError


class ImageError(ProtocolError):
    """Something that the user can fix, in one line: what, where, what to do."""

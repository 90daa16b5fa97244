"""The error that the commands for disk images raise."""

from __future__ import annotations

from radron.protocol.errors import ProtocolError


class ImageError(ProtocolError):
    """A disk image cannot be built, read or written, for a reason that the user can fix.

    The text is one line, which names the fault, its place and the remedy.
    """

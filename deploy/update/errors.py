"""The error that the commands for updates raise."""

from __future__ import annotations

from radron.protocol.errors import ProtocolError


class UpdateError(ProtocolError):
    """Onboard computers cannot be updated, for a reason that the user can fix.

    The text is one line, which names the fault, its place and the remedy.
    """

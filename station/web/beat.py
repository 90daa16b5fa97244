"""The age of a page's command, by the station's clock alone.

The station answers each heartbeat of a page with a stamp; a command carries the newest stamp received by the page. The stamp's
age is an upper limit of the command's age, however long the answer or the command was held back in a stalled link, by a stopped
station or browser, or by a computer that slept; the page's clock does not matter.
"""

from __future__ import annotations

from radron.protocol.elapsed import elapsed_s

MAX_COMMAND_AGE_S = 2.0  # of a command at the station; the page shows it as failed from then on


def stamp() -> int:
    """Return the station's present time, in milliseconds since the computer's start."""
    return int(1000.0 * elapsed_s())


def age_s(given: int) -> float | None:
    """Return the greatest possible age (s) of a command that carries this time stamp; None: too old, or not of this station."""
    age = (stamp() - given) * 1e-3
    return age if 0.0 <= age <= MAX_COMMAND_AGE_S else None

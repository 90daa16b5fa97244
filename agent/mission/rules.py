"""Rules that have changed between releases of one protocol version."""

from __future__ import annotations

from typing import NamedTuple


class Rules(NamedTuple):
    """The rules of a pilot program; each is False in the replay of a record from before the rule.

    ``tells_obeyed``: the statuses name the order obeyed last. ``tells_codes``: the statuses have codes of their texts.
    ``judges_exposures``: exposures that overlap or are too long do not count.
    """

    tells_obeyed: bool = True
    tells_codes: bool = True
    judges_exposures: bool = True


PRESENT = Rules()

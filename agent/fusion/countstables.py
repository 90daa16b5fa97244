"""The version of the tables of camera counts, from which the estimates of ``bayes`` and ``sources`` follow."""

from __future__ import annotations

import hashlib
from functools import cache

from radron.agent.fusion.bayes.response import RESPONSES
from radron.agent.fusion.bayes.soil import SOIL
from radron.agent.fusion.sources.soiltables import SOIL as SOIL_SPECTRA
from radron.agent.fusion.sources.tables import TABLES


@cache
def tables_version() -> str:
    """Return 16 hex digits that change with any number in the tables of camera counts, on which all source estimates depend."""
    return hashlib.blake2b(repr((RESPONSES, SOIL, TABLES, SOIL_SPECTRA)).encode(), digest_size=8).hexdigest()

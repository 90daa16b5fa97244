"""Hashes of files, to compare copies and builds."""

from __future__ import annotations

import hashlib
from pathlib import Path


def digest(file: Path) -> str:
    """Return the SHA-256 hash of a file as a hexadecimal text."""
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()

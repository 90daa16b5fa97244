"""Read access to a file with a key."""

from __future__ import annotations

import os
import struct
from pathlib import Path

import pytest

from radron.protocol.access import shared_mode

OWNER, USER, GROUP, NAMED_GROUP, MASK, OTHER = 0x01, 0x02, 0x04, 0x08, 0x10, 0x20
NOBODY = 0xFFFFFFFF
US = os.geteuid()
# The list of a credential of systemd 255: the service's user reads it.
CREDENTIAL = ((OWNER, 4, NOBODY), (USER, 4, US), (GROUP, 0, NOBODY), (MASK, 4, NOBODY), (OTHER, 0, NOBODY))


def with_list(file: Path, entries: tuple[tuple[int, int, int], ...]) -> Path:
    file.write_text("key")
    packed = struct.pack("<I", 2) + b"".join(struct.pack("<HHI", *one) for one in entries)
    try:
        os.setxattr(file, "system.posix_acl_access", packed)
    except OSError as error:
        pytest.skip(f"no access control lists in {file.parent}: {error.strerror}")
    return file


@pytest.mark.parametrize(("mode", "shared"), [(0o600, None), (0o400, None), (0o440, 0o440), (0o604, 0o604)])
def test_a_mode_lets_in_the_owner_alone_or_others(tmp_path: Path, mode: int, shared: int | None) -> None:
    file = tmp_path / "key.pem"
    file.touch()
    file.chmod(mode)
    assert shared_mode(file) == shared


def test_a_credential_of_systemd_is_its_services_alone(tmp_path: Path) -> None:
    file = with_list(tmp_path / "key.pem", CREDENTIAL)
    assert file.stat().st_mode & 0o777 == 0o440
    assert shared_mode(file) is None


@pytest.mark.parametrize(
    "other",
    [(USER, 4, US + 1), (USER, 2, US + 1), (GROUP, 4, NOBODY), (NAMED_GROUP, 4, 20), (OTHER, 4, NOBODY)],
)
def test_a_list_that_lets_in_somebody_else_is_told(tmp_path: Path, other: tuple[int, int, int]) -> None:
    single = {OWNER, GROUP, MASK, OTHER}
    kept = [one for one in CREDENTIAL if one[0] != other[0] or one[0] not in single]
    assert shared_mode(with_list(tmp_path / "key.pem", tuple(sorted([*kept, other])))) is not None

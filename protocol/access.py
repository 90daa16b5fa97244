"""Access of other users to a key file, by its mode and by its access control list, if any."""

from __future__ import annotations

import os
import stat
import struct
from enum import IntEnum
from pathlib import Path

_ACL = "system.posix_acl_access"
_VERSION_BYTES = 4  # then entries: tag, permissions, whose (linux/posix_acl_xattr.h)
_READ, _WRITE = 4, 2


class _Tag(IntEnum):
    OWNER = 0x01
    USER = 0x02
    MASK = 0x10


def shared_mode(file: Path) -> int | None:
    """Return the access mode of a file if other users can read or write the file; None if only its owner and this process can.

    A private key must not be readable by other users. Raises OSError if the file cannot be examined.
    """
    mode = stat.S_IMODE(file.stat().st_mode)
    return mode if mode & 0o077 and not _listed_for_us_alone(file) else None


def _listed_for_us_alone(file: Path) -> bool:
    """Whether the access control list admits this process's user only, as for a service's credentials from systemd.

    Root owns these files, and the list admits the service's user. The group bits of the mode are then the list's mask, not the
    group's rights.
    """
    try:
        entries = struct.iter_unpack("<HHI", os.getxattr(file, _ACL)[_VERSION_BYTES:])
    except OSError:
        return False
    ours = (_Tag.USER, os.geteuid())
    return all(
        tag in (_Tag.OWNER, _Tag.MASK) or (tag, whose) == ours or not permissions & (_READ | _WRITE)
        for tag, permissions, whose in entries
    )

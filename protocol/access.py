"""Whether a file with a key can be read or changed by others: by its mode, and by its access control list where it has one."""

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
    """The mode of a file that others than its owner and this process's user can read or write; None: nobody else can.

    Raises:
        OSError: it cannot be examined.
    """
    mode = stat.S_IMODE(file.stat().st_mode)
    return mode if mode & 0o077 and not _listed_for_us_alone(file) else None


def _listed_for_us_alone(file: Path) -> bool:
    """As systemd hands a service its credentials: they are root's, and the list lets in the service's user. The group's bits of
    the mode are then the list's mask, and say nothing of the group.
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

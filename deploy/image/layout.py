"""Layout of an onboard computer's disk: partitions, their sizes and identifiers, equal on every drone.

    | esp | config | root-a | root-b | data (made at the first boot, the rest of the disk) |

The computer starts from ``esp``; ``root-a`` and ``root-b`` hold one release of the system each, so that an update leaves the
running release in place. Identifiers are hashes of names, so that two builds are equal; GRUB's and systemd's files refer to
partitions by identifier.
"""

from __future__ import annotations

from dataclasses import dataclass
from uuid import UUID, uuid5

MIB = 1 << 20
_NAMES = UUID("6f1d2c7e-2e0c-5d0b-9a5e-7d1c0a3b4f60")  # of all names here
_ESP = "c12a7328-f81f-11d2-ba4b-00a0c93ec93b"
_BASIC_DATA = "ebd0a0a2-b9e5-4433-87c0-68b6b72699c7"
_ROOT_AMD64 = "4f68bce3-e8cd-4db1-96e7-fbcaf984b709"  # differs from the data partition's type: systemd-repart finds it by type
MIN_DATA_MIB = 2048


@dataclass(frozen=True, slots=True)
class Partition:
    """One partition of the disk image. ``number`` counts from 1."""

    number: int
    name: str
    kind: str  # type GUID
    start: int  # bytes from the disk's beginning
    size: int  # bytes

    @property
    def guid(self) -> str:
        """Identifier of this partition (PARTUUID), a hash of its name."""
        return str(uuid5(_NAMES, self.name))


def _in_a_row(*parts: tuple[str, str, int]) -> tuple[Partition, ...]:
    start, made = MIB, []
    for number, (name, kind, size_mib) in enumerate(parts, start=1):
        made.append(Partition(number, name, kind, start, size_mib * MIB))
        start += size_mib * MIB
    return tuple(made)


PARTITIONS = _in_a_row(
    ("esp", _ESP, 64), ("config", _BASIC_DATA, 64), ("root-a", _ROOT_AMD64, 1024), ("root-b", _ROOT_AMD64, 1024)
)
ESP, CONFIG, ROOT_A, ROOT_B = PARTITIONS
DISK_GUID = str(uuid5(_NAMES, "disk"))
IMAGE_BYTES = ROOT_B.start + ROOT_B.size + MIB  # the last MiB holds the second partition table
MIN_DISK_BYTES = IMAGE_BYTES + MIN_DATA_MIB * MIB

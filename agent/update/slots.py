"""The two slots, and the boot loader's variables for the choice between them: order, good slots, attempts made.

GRUB's block of variables is overwritten in place: all variables are in its first 512 bytes, which a disk writes as a whole. The
usual tool (``grub-editenv``) empties the file first: after a power cut there would be no variables, and slot A would boot.
Therefore this module is RAUC's boot loader (``bootloader=custom``).
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from radron.agent.update.errors import UpdateError
from radron.protocol.onboard import MAX_BOOT_ATTEMPTS

SLOTS = ("A", "B")
GRUBENV, CMDLINE = Path("/efi/grub/grubenv"), Path("/proc/cmdline")
_HEAD = "# GRUB Environment Block\n"
_BLOCK_BYTES, _SECTOR_BYTES = 1024, 512


class Slots:
    """The boot loader's variables that choose one of the two system partitions (slots A and B) at the next boot.

    They are the order, whether each slot works, and the attempts made. Each change is one atomic write.
    """

    def __init__(self, grubenv: Path = GRUBENV, cmdline: Path = CMDLINE) -> None:
        self._grubenv = grubenv
        self._cmdline = cmdline

    @property
    def booted(self) -> str:
        """The system partition (slot) from which this system runs.

        Raises:
            UpdateError: the system does not run from a slot.
        """
        slot = self.found
        if slot is None:
            raise UpdateError("this computer was not started from one of radron's slots: it cannot be updated; flash its disk")
        return slot

    @property
    def found(self) -> str | None:
        """The system partition (slot) from which this system runs; None on a computer without slots, as after ``radron-deploy
        install``.
        """
        found = re.search(r"\brauc\.slot=([AB])\b", self._cmdline.read_text())
        return None if found is None else found[1]

    @property
    def primary(self) -> str:
        """The system partition (slot) that the boot loader tries first."""
        return self._order(self._read())[0]

    def other(self, slot: str) -> str:
        """Return the other slot (system partition): "B" for "A", "A" for "B"."""
        return SLOTS[1 - SLOTS.index(slot)]

    def attempts(self, slot: str) -> int:
        """Return the number of boots of a slot since it was last confirmed to work."""
        tries = self._read().get(f"{slot}_TRY", "0")
        return int(tries) if tries.isdecimal() else MAX_BOOT_ATTEMPTS

    def is_good(self, slot: str) -> bool:
        """Return whether the boot loader may boot this slot."""
        return self._read().get(f"{slot}_OK") == "1"

    def mark_good(self, slot: str) -> None:
        """Mark a slot as working, and reset its count of attempts to boot."""
        self._change(**{f"{slot}_OK": "1", f"{slot}_TRY": "0"})

    def mark_bad(self, slot: str) -> None:
        """Exclude a slot from booting, and let the boot loader try the other slot first."""
        order = " ".join((self.other(slot), slot))
        self._change(ORDER=order, **{f"{slot}_OK": "0", f"{slot}_TRY": "0"})

    def put_first(self, slot: str) -> None:
        """Let the boot loader boot this slot next, with all its attempts, and the other slot afterwards."""
        order = " ".join((slot, self.other(slot)))
        self._change(ORDER=order, **{f"{slot}_OK": "1", f"{slot}_TRY": "0"})

    def answer(self, *words: str) -> str:
        """Answer a request of RAUC (the installer of updates) to its custom boot loader interface.

        Raises:
            UpdateError: a request that RAUC's documentation does not have.
        """
        match words:
            case ("get-primary",):
                return self.primary
            case ("set-primary", ("A" | "B") as slot):
                self.put_first(slot)
            case ("get-state", ("A" | "B") as slot):
                return "good" if self.is_good(slot) else "bad"
            case ("set-state", ("A" | "B") as slot, "good"):
                self.mark_good(slot)
            case ("set-state", ("A" | "B") as slot, "bad"):
                self.mark_bad(slot)
            case _:
                raise UpdateError(f"boot loader: unknown request {' '.join(words)!r}")
        return ""

    def _read(self) -> dict[str, str]:
        try:
            text = self._grubenv.read_bytes().decode("ascii", errors="replace")
        except OSError as error:
            raise UpdateError(f"{self._grubenv}: cannot be read: {error.strerror}") from None
        if not text.startswith(_HEAD) or len(text) != _BLOCK_BYTES:
            raise UpdateError(f"{self._grubenv}: is damaged; flash this computer's disk")
        lines = text[len(_HEAD) :].rstrip("#").splitlines()
        return dict(line.split("=", 1) for line in lines if "=" in line)

    def _order(self, variables: dict[str, str]) -> list[str]:
        named = [slot for slot in variables.get("ORDER", "").split() if slot in SLOTS]
        return named or list(SLOTS)

    def _change(self, **changed: str) -> None:
        variables = self._read() | changed
        text = _HEAD + "".join(f"{name}={value}\n" for name, value in variables.items())
        block = text.encode("ascii").ljust(_BLOCK_BYTES, b"#")
        assert len(block) == _BLOCK_BYTES
        assert len(text) <= _SECTOR_BYTES
        try:
            descriptor = os.open(self._grubenv, os.O_RDWR | os.O_CLOEXEC)
            try:
                os.pwrite(descriptor, block, 0)
                os.fsync(descriptor)
            finally:
                os.close(descriptor)
        except OSError as error:
            raise UpdateError(f"{self._grubenv}: cannot be written: {error.strerror}") from None

"""An onboard computer's files in a folder: the boot loader's variables and the updater's records; and GRUB's choice of a slot."""

from __future__ import annotations

from pathlib import Path

from radron.agent.update.records import Records
from radron.agent.update.slots import Slots
from radron.deploy.image.bootloader import FIRST_BOOT, grub_environment
from radron.protocol.messages import Stage
from radron.protocol.onboard import MAX_BOOT_ATTEMPTS, Release, Report

OLD = Release(version="0.1.0", build="20261101T000000Z-aaaaaaaaaaaa")
NEW = Release(version="0.2.0", build="20261123T000000Z-bbbbbbbbbbbb")


class OnboardFiles:
    """The files, and the releases in the slots. :meth:`boot` switches it on."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.grubenv, self.cmdline = folder / "grubenv", folder / "cmdline"
        self.grubenv.write_bytes(grub_environment(FIRST_BOOT))
        self.slots = Slots(self.grubenv, self.cmdline)
        self.records = Records(folder / "radron-update")
        self.content = {"A": OLD}

    def variables(self) -> dict[str, str]:
        """The boot loader's."""
        lines = self.grubenv.read_text().rstrip("#").splitlines()[1:]
        return dict(line.split("=", 1) for line in lines)

    def boot(self) -> str:
        """Switch on: the boot loader chooses a slot, and counts the attempt (grub.cfg in Python); returns the slot."""
        found = self.variables()
        good = [slot for slot in found["ORDER"].split() if found[f"{slot}_OK"] == "1"]
        untried = [slot for slot in good if int(found[f"{slot}_TRY"]) < MAX_BOOT_ATTEMPTS]
        slot = (untried or good or ["A"])[0]
        if untried:
            found[f"{slot}_TRY"] = str(int(found[f"{slot}_TRY"]) + 1)
            self.grubenv.write_bytes(grub_environment(found))
        self.cmdline.write_text(f"root=PARTUUID=x ro rauc.slot={slot} console=ttyS0")
        return slot

    @property
    def release(self) -> Release:
        """The running slot's system."""
        return self.content[self.slots.booted]


def well(uptime_s: float = 0.0, boot: str = "1") -> Report:
    """The report of an agent with everything."""
    return Report(
        uptime_s=uptime_s, boot=boot, version="0.2.0", stage=Stage.PREFLIGHT, alive=("d2", "d3"), autopilot=True, camera=True
    )

"""The partition from which the computer starts (EFI system partition), with the boot loader GRUB.

GRUB's variables tell which of two slots starts. A slot is a disk partition that holds one release of the onboard system.
"""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from radron.deploy.image.fat import make_fat
from radron.deploy.image.layout import ESP, ROOT_A, ROOT_B
from radron.deploy.image.tools import run

_MODULES = [
    "part_gpt",
    "fat",
    "squash4",
    "lzopio",
    "regexp",
    "loadenv",
    "echo",
    "test",
    "serial",
    "terminal",
    "linux",
    "smbios",
    "sleep",
    "reboot",
    "configfile",
    "normal",
    "efi_gop",
    "efi_uga",
    "boot",
]
_GRUBENV_BYTES = 1024
FIRST_BOOT = {"ORDER": "A B", "A_OK": "1", "A_TRY": "0", "B_OK": "0", "B_TRY": "0"}  # slot B is empty


def make_esp(file: Path, work: Path, epoch: int) -> None:
    """Make the file system of the partition from which the computer starts (EFI system partition).

    ``work``: folder for intermediate files. ``epoch``: date of the files, seconds since 1970.

    Raises:
        ImageError: a program failed.
    """
    content = work / "esp"
    (content / "EFI/BOOT").mkdir(parents=True)
    (content / "grub").mkdir()
    source = files("radron.deploy.image") / "contents/grub"
    (content / "grub/grub.cfg").write_text(grub_configuration())
    (content / "grub/grubenv").write_bytes(grub_environment(FIRST_BOOT))
    early = work / "early.cfg"
    lines = (source / "early.cfg").read_text(encoding="utf-8").splitlines()
    early.write_text("".join(f"{line}\n" for line in lines if not line.startswith("#")))  # GRUB's first parser has no comments
    loader = content / "EFI/BOOT/BOOTX64.EFI"
    run(["grub-mkimage", "-O", "x86_64-efi", "-p", "/grub", "-c", str(early), "-o", str(loader), *_MODULES])
    make_fat(file, ESP.size, "esp", content, epoch)


def grub_configuration() -> str:
    """Return the boot loader's configuration file ``grub.cfg``, with the identifiers of the two system partitions."""
    text = (files("radron.deploy.image") / "contents/grub/grub.cfg").read_text(encoding="utf-8")
    return text.replace("@ROOT_A@", ROOT_A.guid).replace("@ROOT_B@", ROOT_B.guid)


def grub_environment(variables: dict[str, str]) -> bytes:
    """Return a block of the boot loader's variables, as ``grub-editenv`` writes it.

    The block has a fixed length, since GRUB can only overwrite a block of this length.
    """
    text = "# GRUB Environment Block\n" + "".join(f"{name}={value}\n" for name, value in variables.items())
    return text.encode("ascii").ljust(_GRUBENV_BYTES, b"#")

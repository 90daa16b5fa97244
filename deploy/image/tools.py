"""Calls of programs of the operating system; a failure gives a one-line error."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO

from radron.deploy.image.errors import ImageError

# The Debian package of each program.
_PACKAGES = {
    "mmdebstrap": "mmdebstrap",
    "mksquashfs": "squashfs-tools",
    "unsquashfs": "squashfs-tools",
    "grub-mkimage": "grub-common",
    "sgdisk": "gdisk",
    "mkfs.vfat": "dosfstools",
    "mcopy": "mtools",
    "lsblk": "util-linux",
    "git": "git",
    "rauc": "rauc",
}
# Files that a program needs from another package.
_FILES = {
    "mmdebstrap": ("/usr/share/keyrings/debian-archive-keyring.gpg", "debian-archive-keyring"),
    "grub-mkimage": ("/usr/lib/grub/x86_64-efi/moddep.lst", "grub-efi-amd64-bin"),
}


def need(*programs: str) -> None:
    """Check that all these programs are installed, with the files that they require.

    Raises:
        ImageError: the text names all missing programs and files, and their packages.
    """
    missing = {program: _PACKAGES[program] for program in programs if shutil.which(program, path=_path()) is None}
    files = [_FILES[program] for program in programs if program in _FILES]
    missing |= {file: package for file, package in files if not Path(file).exists()}
    if missing:
        packages = " ".join(sorted(set(missing.values())))
        raise ImageError(f"missing on this computer: {', '.join(missing)}; on Debian and Ubuntu: `apt-get install {packages}`")


def run(command: Sequence[str], log: Path | None = None, env: Mapping[str, str] | None = None, stdin: Path | None = None) -> str:
    """Run a program to its end, and return its output.

    ``log``: file to which the output is appended. ``env``: additional environment variables. ``stdin``: file with the input.

    Raises:
        ImageError: the program failed; the text has the last line of its output.
    """
    environment = {**os.environ, "PATH": _path(), "LC_ALL": "C.UTF-8", **(env or {})}
    with _output(log, command) as output, open(stdin if stdin is not None else os.devnull, "rb") as given:
        begin = output.tell()
        code = subprocess.run(
            command, stdin=given, stdout=output, stderr=subprocess.STDOUT, env=environment, check=False
        ).returncode
        output.seek(begin)
        text = output.read().decode(errors="replace")
    if code != 0:
        said = [line for line in text.splitlines() if line.strip()]
        where = f" (all of it: {log})" if log is not None else ""
        raise ImageError(f"{Path(command[0]).name} failed: {said[-1].strip() if said else f'exit code {code}'}{where}")
    return text


def _output(log: Path | None, command: Sequence[str]) -> IO[bytes]:
    """Open the file for a program's output: the log, readable while the program runs, or a temporary file."""
    if log is None:
        return tempfile.TemporaryFile()
    file = log.open("a+b")
    file.write(f"$ {' '.join(command)}\n".encode())
    file.flush()
    file.seek(0, os.SEEK_END)
    return file


def _path() -> str:
    """Return the search path with root's folders added: many of these programs are there."""
    return os.environ.get("PATH", os.defpath) + ":/usr/sbin:/sbin"

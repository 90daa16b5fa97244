"""Other computers over SSH: commands, and copies that continue where they were interrupted.

OpenSSH's own client is used: keys, agents, jump hosts and known hosts come from the user's SSH configuration.
"""

from __future__ import annotations

import asyncio
import shlex
import shutil
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from radron.deploy.digest import digest
from radron.protocol.errors import ProtocolError

CONNECT_S = 10  # a running computer answers within a second
ALIVE_S = 5  # between two signs of life; a link is dead after the loss of three
_CHUNK_BYTES = 1 << 18
_SSH_FAILED = 255  # ssh's exit code for its own errors
_OPTIONS = {
    "BatchMode": "yes",  # no prompts: several ssh processes may run at once
    "ConnectTimeout": str(CONNECT_S),
    "ServerAliveInterval": str(ALIVE_S),
    "ServerAliveCountMax": "3",
    "StrictHostKeyChecking": "accept-new",
    "LogLevel": "ERROR",
}
# Part of ssh's output, and the message with cause and remedy.
_CAUSES = (
    (
        "IDENTIFICATION HAS CHANGED",
        "is not the computer that it was: after its disk was written anew, run `ssh-keygen -R {known}`",
    ),
    ("Host key verification failed", "its host key is not known: log in once by hand, `ssh {destination}`"),
    ("Permission denied", "refuses your SSH key: put it into ssh_keys of the fleet file, or load it with `ssh-add`"),
    ("Connection refused", "answers, but has no SSH server at this port: it is starting, or is another computer"),
    ("timed out", "does not answer: is it switched on, and in this network?"),
    ("No route to host", "does not answer: is it switched on, and in this network?"),
    ("Network is unreachable", "is in no network that this computer is in"),
    ("Could not resolve", "there is no computer of this name"),
)
Progress = Callable[[int, int], None]  # bytes done, bytes in all
T = TypeVar("T")


class RemoteError(ProtocolError):
    """A command at another computer has failed; the text is one line that names the computer."""


@dataclass(frozen=True, slots=True)
class Host:
    """A computer with an SSH login.

    ``name``: the user's name for it; ``options``: options of ssh, such as ``IdentityFile=key``.
    """

    name: str
    address: str
    user: str = "root"
    port: int | None = None
    options: tuple[str, ...] = ()

    @classmethod
    def parse(cls, text: str, options: Sequence[str] = (), user: str = "root") -> Host:
        """Read a computer's address from a text of the form ``[USER@]ADDRESS[:PORT]``.

        Raises:
            RemoteError: the text has another form.
        """
        before, _, place = text.rpartition("@")
        address, colon, number = place.partition(":")
        if not address or text.startswith("-") or address.startswith("-") or (colon and not number.isdecimal()):
            raise RemoteError(f"{text!r}: is no computer's address; it is like 10.7.1.11 or root@10.7.1.11:22")
        return cls(text, address, before or user, int(number) if colon else None, tuple(options))

    def command(self, command: str) -> list[str]:
        """Return the ssh command line that runs a shell ``command`` at this computer.

        The user's options come first, since ssh takes the first value of an option.
        """
        options = [*self.options, *(f"{name}={value}" for name, value in _OPTIONS.items())]
        port = [] if self.port is None else ["-p", str(self.port)]
        return ["ssh", *(part for option in options for part in ("-o", option)), *port, f"{self.user}@{self.address}", command]

    def error(self, text: str) -> RemoteError:
        """Return an error with this text that names this computer."""
        where = self.name if self.address in self.name else f"{self.name} ({self.address})"
        return RemoteError(f"{where}: {text}")

    def ssh_error(self, said: str) -> RemoteError:
        """Return the error for a failed or lost connection, with the cause according to ssh's output."""
        known = self.address if self.port is None else f"'[{self.address}]:{self.port}'"
        for sign, meaning in _CAUSES:
            if sign in said:
                return self.error(meaning.format(known=known, destination=f"{self.user}@{self.address}"))
        return self.error(f"the connection was lost: {_last_line(said) or 'it no longer answers'}; run this again")


async def run(host: Host, command: str, given: bytes = b"", tell: Callable[[str], None] | None = None) -> str:
    """Run a shell command at another computer to its end, and return its output.

    Args:
        host: the computer.
        command: for the shell there; quote external input (``shlex.quote``).
        given: standard input of the command.
        tell: called with each line of the output at once.

    Raises:
        RemoteError: no connection, or the command failed; the text has the last line of its output.
    """
    said: list[str] = []
    async with _started(host, command) as (process, errors):
        assert process.stdin is not None
        assert process.stdout is not None
        feeding = asyncio.create_task(_feed(process.stdin, given))
        async for line in process.stdout:
            said.append(line.decode(errors="replace"))
            if tell is not None:
                tell(said[-1].rstrip("\n"))
        await feeding
        await _ended(host, process, errors, said)
    return "".join(said)


async def send(host: Host, file: Path, target: str, progress: Progress) -> None:
    """Copy a file to another computer, unless the computer has an equal file already.

    An interrupted copy is kept (``TARGET.part``) and completed by the next call; ``target`` appears after a check of the complete
    copy's SHA-256.

    Raises:
        RemoteError: no connection, a full disk, or a copy that differs.
    """
    total, part, place = file.stat().st_size, shlex.quote(f"{target}.part"), shlex.quote(target)
    sha256 = await asyncio.to_thread(digest, file)
    there, whole = (
        f"echo {shlex.quote(f'{sha256}  {one}')} | sha256sum -c > /dev/null 2>&1" for one in (target, f"{target}.part")
    )
    begun = f"stat -c %s {part} 2> /dev/null || echo 0"
    found = (await run(host, f"mkdir -p $(dirname {place}) && if {there}; then echo there; else {begun}; fi")).strip()
    if found == "there":
        return progress(total, total)
    done = int(found or 0)
    if done > total:
        await run(host, f"rm -f {part}")
        done = 0
    progress(done, total)
    # Write at the offset, not at the end: data in transit of a lost connection may still arrive, and is equal there.
    write = f"dd bs={_CHUNK_BYTES} of={part} seek={done} oflag=seek_bytes conv=notrunc status=none"
    async with _started(host, write) as (process, errors):
        assert process.stdin is not None
        with file.open("rb") as source, suppress(BrokenPipeError, ConnectionResetError):  # its exit code has the reason
            source.seek(done)
            while chunk := source.read(_CHUNK_BYTES):
                process.stdin.write(chunk)
                await process.stdin.drain()
                done += len(chunk)
                progress(done, total)
            process.stdin.close()
        await _ended(host, process, errors, [])
    moved, left = f"sync {part} && mv {part} {place}; echo whole", f"rm -f {part}; echo whole"
    kept = f"if {whole}; then {moved}; elif {there}; then {left}; else rm -f {part}; fi"
    done_there = await run(host, kept)
    if done_there.strip() != "whole":
        raise host.error(f"the copy of {file.name} differs from the file, and was removed; run this again")


async def fetch(host: Host, source: str, file: Path, size: int, sha256: str, progress: Progress) -> None:
    """Copy the first ``size`` bytes of a file at another computer to ``file``, which appears when complete.

    An earlier interrupted copy (``FILE.part``) is completed. ``sha256``: expected hash.

    Raises:
        RemoteError: no connection, or a copy that differs.
        OSError: the file cannot be written here.
    """
    part = file.with_name(file.name + ".part")
    done = part.stat().st_size if part.exists() else 0
    if done > size:
        part.unlink()
        done = 0
    progress(done, size)
    command = f"head -c {size} {shlex.quote(source)} | tail -c +{done + 1}"
    async with _started(host, command) as (process, errors):
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.close()
        with part.open("ab") as target:
            while chunk := await process.stdout.read(_CHUNK_BYTES):
                target.write(chunk)
                done += len(chunk)
                progress(done, size)
        await _ended(host, process, errors, [])
    if await asyncio.to_thread(digest, part) != sha256:
        part.unlink()
        raise host.error(f"the copy of {source} differs from the file, and was removed; run this again")
    part.replace(file)


async def at_all(hosts: Sequence[Host], work: Callable[[Host], Awaitable[T]]) -> list[T | RemoteError]:
    """Run ``work`` for all computers at once, and return its results in order; a failure gives its error as the result."""

    async def one(host: Host) -> T | RemoteError:
        try:
            return await work(host)
        except RemoteError as error:
            return error

    return await asyncio.gather(*(one(host) for host in hosts))


@asynccontextmanager
async def _started(host: Host, command: str) -> AsyncIterator[tuple[asyncio.subprocess.Process, asyncio.Task[bytes]]]:
    """Yield a running command there, and the task that reads its errors; the command ends with the block."""
    if shutil.which("ssh") is None:
        raise RemoteError("ssh: is missing on this computer; on Debian and Ubuntu: `apt-get install openssh-client`")
    pipe = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_exec(*host.command(command), stdin=pipe, stdout=pipe, stderr=pipe)
    assert process.stderr is not None
    errors = asyncio.create_task(process.stderr.read())
    try:
        yield process, errors
    finally:
        with suppress(ProcessLookupError):
            process.kill()
        await process.wait()
        errors.cancel()


async def _feed(stream: asyncio.StreamWriter, given: bytes) -> None:
    with suppress(BrokenPipeError, ConnectionResetError):
        stream.write(given)
        await stream.drain()
        stream.close()


async def _ended(host: Host, process: asyncio.subprocess.Process, errors: asyncio.Task[bytes], said: Sequence[str]) -> None:
    """Wait for the end of a command.

    Raises:
        RemoteError: the command failed.
    """
    told = (await errors).decode(errors="replace")
    code = await process.wait()
    if code == _SSH_FAILED:
        raise host.ssh_error(told)
    if code != 0:
        raise host.error(_last_line(told) or _last_line("".join(said)) or f"a command failed with code {code}")


def _last_line(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1] if lines else ""

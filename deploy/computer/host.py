"""Probe of an existing computer before an installation; an unsuitable computer is refused in one line."""

from __future__ import annotations

import base64
import binascii
import re
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.resources import files

from radron.deploy.image.wheels import Platform
from radron.deploy.remote import Host, run

MACHINES = {"x86_64": "amd64", "aarch64": "arm64"}
MIN_FREE_MB = 1500
_OLDEST_PYTHON, _OLDEST_SYSTEMD, _OLDEST_GLIBC = (3, 11), 250, 28
_ON_GROUND = ("", "starting", "preflight", "landed")  # stages of an agent that does not fly; in flight, "starting" is short


@dataclass(frozen=True, slots=True)
class Computer:
    """An existing computer on which a drone's agent can be installed.

    ``system``: name of the operating system. ``python``: path of its interpreter. ``release``: installed release of the agent;
    None: not installed. ``authority``, ``certificate``: certificates (PEM) of the swarm's authority and of the drone, if
    installed.
    """

    system: str
    platform: Platform
    python: str
    release: str | None
    authority: bytes | None
    certificate: bytes | None


async def probe(host: Host) -> Computer:
    """Examine over SSH whether the agent can be installed on a computer, without any change to the computer.

    Raises:
        RemoteError: no connection, or the computer cannot become a drone.
    """
    return judged(host, await asked(host))


async def asked(host: Host) -> dict[str, list[str]]:
    """Run the script ``probe.sh`` on a computer, and return its findings: lists of texts by key.

    Raises:
        RemoteError: no connection, or a drone that must not be changed: it flies, or runs the image.
    """
    values: dict[str, list[str]] = {}
    for line in (await run(host, "sh -s", script("probe.sh"))).splitlines():
        key, equals, value = line.partition("=")
        if equals:
            values.setdefault(key, []).append(value.strip())
    check_alone(host, values)
    return values


def check_alone(host: Host, values: dict[str, list[str]]) -> None:
    """Check, from the output of ``probe.sh``, that the agent on a computer may be replaced or removed.

    Raises:
        RemoteError: the drone flies, or its disk was written from an image.
    """
    stage = next(iter(values.get("stage", ())), "")
    if "image" in values:
        raise host.error("it runs the onboard image; its disk is written with `radron-deploy image flash`")
    if "armed" in values or (stage not in _ON_GROUND and not stage.startswith("waiting:")):
        raise host.error(f"the drone is in flight or armed ({stage or 'armed'}): nothing was done")


def judged(host: Host, values: dict[str, list[str]]) -> Computer:
    """Check, from the output of ``probe.sh``, that a computer is suitable for the agent, and return its description.

    Raises:
        RemoteError: the computer cannot become a drone.
    """

    def first(key: str) -> str:
        return next(iter(values.get(key, ())), "")

    system, machine = first("system"), first("machine")
    if first("user") != "0":
        raise host.error("this user is not root there: log in as root, `root@ADDRESS`")
    if first("foreign"):
        raise host.error(f"{first('foreign')} is there, and not from `radron-deploy install`: move it away")
    if machine not in MACHINES:
        raise host.error(f"its processor is {machine or 'unknown'}; the agent runs on amd64 and arm64 (64 bit)")
    if not {"debian", "ubuntu"} & set(first("family").split()):
        raise host.error(f"it runs {system or 'an unknown system'}; this installs on Debian and Ubuntu only")
    glibc = re.fullmatch(r"glibc 2\.(\d+)", first("glibc"))
    if glibc is None or int(glibc[1]) < _OLDEST_GLIBC:
        raise host.error(f"its C library is {first('glibc') or 'unknown'}; wheels need glibc 2.{_OLDEST_GLIBC} or later")
    if not first("systemd").isdecimal() or int(first("systemd")) < _OLDEST_SYSTEMD:
        raise host.error(
            f"its systemd is {first('systemd') or 'missing'}; version {_OLDEST_SYSTEMD} or later is needed (Debian 12)"
        )
    if int(first("free_mb") or 0) < MIN_FREE_MB:
        raise host.error(f"{first('free_mb') or 0} MB are free in /opt there, {MIN_FREE_MB} are needed")
    version, python = _python(host, system, values.get("python", ()))
    platform = Platform(version, machine, int(glibc[1]))
    return Computer(system, platform, python, first("release") or None, _decoded(first("ca")), _decoded(first("certificate")))


def script(name: str) -> bytes:
    """Return the content of a shell script in the folder ``contents``, to be run on the other computer."""
    return files("radron.deploy.computer").joinpath("contents", name).read_bytes()


def _python(host: Host, system: str, found: Iterable[str]) -> tuple[str, str]:
    """Return version and path of the first sufficiently new interpreter; the system's own interpreter comes first.

    Raises:
        RemoteError: none is new enough.
    """
    versions = [text.partition(" ")[::2] for text in found]
    for version, path in versions:
        if tuple(map(int, version.split("."))) >= _OLDEST_PYTHON:
            return version, path
    have = ", ".join(version for version, _ in versions) or "none"
    raise host.error(f"its Python is {have} ({system}); 3.11 or later is needed: Debian 12, Ubuntu 24.04, or later ones")


def _decoded(text: str) -> bytes | None:
    try:
        return base64.b64decode(text, validate=True) or None
    except binascii.Error:
        return None

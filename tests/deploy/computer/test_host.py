"""Computers that cannot become a drone are refused in one line that says why."""

from __future__ import annotations

import asyncio
import os
import platform
from pathlib import Path

import pytest

from radron.deploy.computer.host import asked, check_alone, judged
from radron.deploy.image.wheels import Platform
from radron.deploy.remote import Host, RemoteError
from support.computers.sshserver import LACKING, ssh_server

HOST = Host("nuc", "10.7.1.12")
GOOD = {
    "machine": ["aarch64"],
    "system": ["ubuntu 24.04"],
    "family": ["ubuntu debian"],
    "user": ["0"],
    "python": ["3.12 /usr/bin/python3", "3.12 /usr/bin/python3.12"],
    "glibc": ["glibc 2.39"],
    "systemd": ["255"],
    "free_mb": ["8000"],
}


def test_a_computer_that_can() -> None:
    found = judged(HOST, GOOD | {"release": ["0123456789abcdef"], "stage": ["waiting: no autopilot"]})
    assert found.platform == Platform("3.12", "aarch64", 39)
    assert (found.python, found.release, found.certificate) == ("/usr/bin/python3", "0123456789abcdef", None)


def test_the_systems_python_may_be_too_old_if_there_is_another() -> None:
    pythons = {"python": ["3.10 /usr/bin/python3", "3.12 /usr/bin/python3.12"]}
    assert judged(HOST, GOOD | pythons).python == "/usr/bin/python3.12"


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"user": ["1000"]}, "log in as root"),
        ({"foreign": ["/opt/radron"]}, "/opt/radron is there, and not from"),
        ({"machine": ["armv7l"]}, "its processor is armv7l"),
        ({"machine": []}, "its processor is unknown"),
        ({"system": ["fedora 41"], "family": ["fedora "]}, "runs fedora 41; this installs on Debian and Ubuntu only"),
        ({"python": ["3.10 /usr/bin/python3"]}, "its Python is 3.10 .* 3.11 or later is needed"),
        ({"python": []}, "its Python is none"),
        ({"glibc": ["musl"]}, "its C library is musl"),
        ({"systemd": ["249"]}, "its systemd is 249"),
        ({"systemd": [""]}, "its systemd is missing"),
        ({"free_mb": ["300"]}, "300 MB are free in /opt there"),
    ],
)
def test_a_computer_that_cannot(values: dict[str, list[str]], reason: str) -> None:
    with pytest.raises(RemoteError, match=reason) as told:
        judged(HOST, GOOD | values)
    assert str(told.value).startswith("nuc (10.7.1.12): ")
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"image": ["yes"]}, "runs the onboard image"),
        ({"stage": ["survey"]}, "in flight or armed .survey.: nothing was done"),
        ({"stage": ["preflight"], "armed": ["yes"]}, "in flight or armed .preflight."),
    ],
)
def test_a_drone_that_must_be_left_alone(values: dict[str, list[str]], reason: str) -> None:
    with pytest.raises(RemoteError, match=reason):
        check_alone(HOST, GOOD | values)


@pytest.mark.parametrize("stage", ["", "preflight", "landed", "waiting: no autopilot"])
def test_a_drone_on_the_ground(stage: str) -> None:
    check_alone(HOST, GOOD | {"stage": [stage]})


@pytest.mark.skipif(LACKING is not None, reason=str(LACKING))
def test_the_probe_on_this_computer(tmp_path: Path) -> None:
    with ssh_server(tmp_path) as host:
        values = asyncio.run(asked(host))
    assert values["machine"] == [platform.machine()]
    assert values["user"] == [str(os.geteuid())]
    assert values["system"] != ["unknown "]

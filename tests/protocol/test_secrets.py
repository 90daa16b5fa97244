"""Private keys and passphrases are where they belong, and nowhere else: not in core files, on command lines, in images."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import get_type_hints

import pytest
import typer

import radron.agent.cli
import radron.deploy.cli
import radron.sim.cli
import radron.station.cli
from support.mesh.identities import identity, new_issuer

ROOT = Path(__file__).parents[2]
CRASH = """
import os, resource, sys
from pathlib import Path
from radron.deploy.pki.authority import PkiFolder
from radron.protocol.identity import load_identity
child = os.fork()
if child == 0:
    resource.setrlimit(resource.RLIMIT_CORE, [resource.getrlimit(resource.RLIMIT_CORE)[1]] * 2)
    os.chdir(sys.argv[2])
    if sys.argv[1] == "member":
        load_identity(Path(sys.argv[2], "d1"))
    elif sys.argv[1] == "authority":
        PkiFolder(Path("pki")).init("s", lambda: "four quite ordinary words", 1_800_000_000_000_000_000)
    os.abort()
print(os.WCOREDUMP(os.waitpid(child, 0)[1]))
"""


def leaves_core(who: str, folder: Path) -> bool:
    """Whether the kernel writes a core file of a process that crashes."""
    run = subprocess.run([sys.executable, "-c", CRASH, who, str(folder)], cwd=ROOT, capture_output=True, text=True, check=True)
    for file in folder.glob("core*"):
        file.unlink()
    return run.stdout.strip() == "True"


@pytest.mark.parametrize("who", ["member", "authority"])
def test_a_process_that_has_read_a_key_leaves_no_core_file(tmp_path: Path, who: str) -> None:
    identity(new_issuer(), tmp_path, "d1")
    if not leaves_core("nobody", tmp_path):
        pytest.skip("this computer writes no core files at all")
    assert not leaves_core(who, tmp_path)


def _options(app: typer.Typer) -> Iterator[tuple[str, object]]:
    """Names and types of the parameters of all commands."""
    for command in app.registered_commands:
        assert command.callback is not None
        yield from get_type_hints(command.callback).items()
    for group in app.registered_groups:
        assert group.typer_instance is not None
        yield from _options(group.typer_instance)


def test_no_command_takes_a_secret_where_everybody_can_read_it_in_the_process_list() -> None:
    """Keys are given by files, the passphrase by a prompt or the environment of a process, which its user alone can read."""
    options = [
        option
        for app in (radron.agent.cli.app, radron.sim.cli.app, radron.deploy.cli.app, radron.station.cli.app)
        for option in _options(app)
    ]
    assert len(options) > 30
    named = {(name, kind) for name, kind in options if re.search("pass|secret|key|token|identity", name)}
    assert {name for name, _ in named} >= {"key", "identity"}
    assert {kind for _, kind in named} <= {Path, Path | None}


def test_images_hold_no_keys() -> None:
    lines = (ROOT / ".dockerignore").read_text().splitlines()
    rules = [line for line in lines if line and not line.startswith("#")]
    assert rules[0] == "*"  # files not named go into no image
    tops = [rule.removeprefix("!") for rule in rules if rule.startswith("!")]
    assert {"agent", "protocol", "sim"} <= set(tops)
    assert rules.index("**/*.pem") > max(rules.index(f"!{top}") for top in tops)
    copied = [file for top in tops for file in (ROOT / top, *(ROOT / top).rglob("*")) if file.is_file()]
    assert len(copied) > 200
    assert not [file for file in copied if b"-----BEGIN PRIVATE" in file.read_bytes()]

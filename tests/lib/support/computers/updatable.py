"""Several computers behind one SSH server, to be updated. The computers are files; their updater and its decisions are real."""

from __future__ import annotations

import asyncio
import hashlib
import json
import shlex
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from radron.deploy.digest import digest
from radron.deploy.remote import Host, RemoteError
from radron.deploy.update import hosts, push
from radron.deploy.update.bundle import BundleManifest
from radron.deploy.update.push import Push
from radron.protocol.onboard import Outcome, Release
from support import PATH
from support.computers import computer
from support.computers.computer import VirtualComputer
from support.computers.onboard import NEW


class Fleet:
    """Computers behind one SSH server, each with a user's name for it; the updater's reports of each. ``ports``: of computers
    with another port than the server's; ``options``: of ssh.
    """

    def __init__(self, folder: Path, server: Host, monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder, self._server = folder, server
        self.told: list[str] = []
        self.ports: dict[str, int] = {}
        self.options: tuple[str, ...] = ()
        program = folder / "radron-update"
        python = f"PYTHONPATH={shlex.quote(PATH)} exec {shlex.quote(sys.executable)}"
        program.write_text(f'#!/bin/sh\n{python} -m {computer.__name__} . "$@"\n')
        program.chmod(0o755)
        for module in (hosts, push):
            monkeypatch.setattr(module, "PROGRAM", f"/usr/bin/env {program}")
        monkeypatch.setattr(push, "INCOMING", "incoming")  # in each computer's own folder
        command = Host.command
        begin = f"mkdir -p {folder}/$0; cd {folder}/$0"
        monkeypatch.setattr(Host, "command", lambda host, text: command(host, f"{begin}; {text}".replace("$0", host.name)))

    def host(self, name: str) -> Host:
        port = self.ports.get(name, self._server.port)
        return replace(self._server, name=name, port=port, options=(*self.options, *self._server.options))

    def computer(self, name: str) -> VirtualComputer:
        return VirtualComputer(self.folder / name)

    def bundle(self, release: Release = NEW, size: int = 1_000_000, **also: object) -> tuple[Path, BundleManifest]:
        file = self.folder / f"{release.version}.raucb"
        content = {"version": release.version, "build": release.build, "padding": hashlib.shake_256().hexdigest(size // 2)} | also
        file.write_text(json.dumps(content))
        return file, BundleManifest(release=release, sha256=digest(file), size=file.stat().st_size)

    def push(self, *names: str, bundle: tuple[Path, BundleManifest] | None, older: bool = False) -> list[Outcome | RemoteError]:
        return asyncio.run(push.push([self.host(name) for name in names], self.order(bundle, older)))

    def order(self, bundle: tuple[Path, BundleManifest] | None, older: bool = False) -> Push:
        file, manifest = bundle if bundle is not None else (None, None)

        def tell(host: Host, what: str, done: int, total: int) -> None:
            self.told.append(f"{host.name}: {what} {done}/{total}")

        return Push(file, manifest, older, tell, poll_s=0.05, decided_s=60.0)

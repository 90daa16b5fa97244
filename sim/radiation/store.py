"""The user's cache of event banks on disk."""

from __future__ import annotations

import fcntl
import hashlib
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from functools import cache
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import Progress

from agent.outputs import cache_folder
from sim.radiation.bank import EventBank, build_bank
from sim.radiation.nuclides import Nuclide, nuclide
from sim.radiation.timepix3 import Response, response
from sim.radiation.truth import CameraTruth

# A bank is valid for the code that made it.
_MADE_BY = ("bank", "electrons", "events", "materials", "surroundings", "timepix3", "transport")


def load_bank(name: str, truth: CameraTruth) -> EventBank:
    """The bank of a nuclide for that camera: from memory, from disk (memory-mapped), or built and stored, with a progress bar.

    Raises:
        ConfigError: an unknown nuclide.
    """
    return _load(nuclide(name), response(truth))


@cache
def _load(source: Nuclide, camera: Response) -> EventBank:
    digest = bank_key(source, camera)
    folder = cache_folder() / f"bank-{source.name}-{digest}"
    if folder.is_dir():
        return _open(folder)
    with _alone(folder):
        if folder.is_dir():  # another process was faster
            return _open(folder)
        bank = _build(source, camera, int(digest, 16))
        try:
            _save(bank, folder)
        except OSError as error:
            print(f"radron: the event bank could not be stored in {folder.parent}: {error}", file=sys.stderr)
            return bank
    return _open(folder)


def _build(source: Nuclide, camera: Response, seed: int) -> EventBank:
    what = f"Simulating the detector response to {source.name} (once)"
    console = Console(stderr=True)
    if not console.is_terminal:
        print(f"{what} ...", file=sys.stderr, flush=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(what, total=None)
        return build_bank(source, camera, seed, lambda done, of: bar.update(task, completed=done, total=of))


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Let one process build a bank while others that want the same one wait; where no lock file is possible, all build."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        lock = (folder.parent / f".{folder.name}.lock").open("w")
    except OSError:
        yield
        return
    with lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # released with the file, also when the process dies
        yield


def bank_key(source: Nuclide, camera: Response) -> str:
    """16 hex digits that identify the bank's inputs."""
    content = hashlib.blake2b(repr((source, camera)).encode(), digest_size=8)
    for module in _MADE_BY:
        content.update(Path(__file__).with_name(f"{module}.py").read_bytes())
    return content.hexdigest()


def _save(bank: EventBank, folder: Path) -> None:
    """Write beside the folder, then rename: another process sees all of it or nothing."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    scratch = Path(tempfile.mkdtemp(prefix=".bank-", dir=folder.parent))
    try:
        for item in fields(bank):
            np.save(scratch / f"{item.name}.npy", getattr(bank, item.name))
        scratch.rename(folder)
    except OSError:
        if not folder.is_dir():  # else another process was faster, with the same bank
            raise
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _open(folder: Path) -> EventBank:
    return EventBank(**{item.name: np.asarray(np.load(folder / f"{item.name}.npy", mmap_mode="r")) for item in fields(EventBank)})

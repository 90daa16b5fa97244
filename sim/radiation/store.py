"""The user's cache of slowly simulated data: banks of events, and tables of photon fluxes over ground.

Each is a folder of arrays.
"""

from __future__ import annotations

import fcntl
import hashlib
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import Progress

from radron.agent.outputs import cache_folder
from radron.sim.radiation.bank import EventBank, build_bank
from radron.sim.radiation.nuclides import Nuclide, nuclide
from radron.sim.radiation.timepix3 import Response, response
from radron.sim.radiation.truth import CameraTruth

Arrays = Mapping[str, NDArray[Any]]

# A bank is valid for the code that made it.
MADE_BY = ("bank", "electrons", "events", "materials", "surroundings", "timepix3", "transport")


def load_bank(name: str, truth: CameraTruth) -> EventBank:
    """Return the bank of a nuclide in a camera: simulated events, stored by direction, from which readouts are made quickly.

    The bank is taken from memory or disk (memory-mapped), or built and stored, with a progress bar.

    Raises:
        ConfigError: an unknown nuclide.
    """
    return _load(nuclide(name), response(truth))


@cache
def _load(source: Nuclide, camera: Response) -> EventBank:
    def build() -> Arrays:
        return as_arrays(_build(source, camera, bank_seed(source, camera)))

    return as_bank(kept(f"bank-{source.name}-{bank_key(source, camera)}", build))


def as_arrays(bank: EventBank) -> Arrays:
    """Return the arrays of a bank of simulated events by field name, for storage."""
    return {item.name: getattr(bank, item.name) for item in fields(bank)}


def as_bank(arrays: Arrays) -> EventBank:
    """Make a bank of simulated events from its stored arrays."""
    return EventBank(**{item.name: np.asarray(arrays[item.name]) for item in fields(EventBank)})


def kept(name: str, build: Callable[[], Arrays]) -> Arrays:
    """Return the cached arrays of this name: from disk (memory-mapped), or built and stored.

    If several processes ask at once, one builds the arrays, and the others wait.
    """
    folder = cache_folder() / name
    if folder.is_dir():
        return _open(folder)
    with _alone(folder):
        if folder.is_dir():  # another process was faster
            return _open(folder)
        arrays = build()
        try:
            _save(arrays, folder)
        except OSError as error:
            print(f"radron: {name} could not be stored in {folder.parent}: {error}", file=sys.stderr)
            return arrays
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


def bank_seed(source: Nuclide, camera: Response) -> int:
    """Return the random seed of a bank of simulated events: a hash of nuclide and camera alone.

    A change of the code that moves no random draw, such as one of a comment, thus leaves every flight as it was.
    """
    return int(hashlib.blake2b(repr((source, camera)).encode(), digest_size=8).hexdigest(), 16)


def bank_key(source: Nuclide, camera: Response) -> str:
    """Return 16 hexadecimal digits that identify a bank of simulated events.

    They are a hash of its random seed, and of the code that builds the bank.
    """
    content = hashlib.blake2b(str(bank_seed(source, camera)).encode(), digest_size=8)
    for module in MADE_BY:
        content.update(Path(__file__).with_name(f"{module}.py").read_bytes())
    return content.hexdigest()


def _save(arrays: Arrays, folder: Path) -> None:
    """Write beside the folder, then rename: another process sees all of it or nothing."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    scratch = Path(tempfile.mkdtemp(prefix=".bank-", dir=folder.parent))
    try:
        for name, array in arrays.items():
            np.save(scratch / f"{name}.npy", array)
        scratch.rename(folder)
    except OSError:
        if not folder.is_dir():  # else another process was faster, with the same arrays
            raise
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _open(folder: Path) -> Arrays:
    return {path.stem: np.asarray(np.load(path, mmap_mode="r")) for path in sorted(folder.glob("*.npy"))}

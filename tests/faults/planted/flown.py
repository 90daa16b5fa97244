"""Missions flown with planted bugs: their stages, one mission by ``radron-sim``, the file that keeps them, and the findings."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from bugs import Bug, BugError

_RADRON_SIM = (sys.executable, "-c", "from radron.sim.cli import main; main()")
CRASH, HANG = "no result", "no end"  # beside the invariants' names: it died without a line, or did not end
BUSY = "this machine is too busy for live missions"  # as live-faults says it
_MOST_TEXT = 300
_FIRST = ("--first",)


@dataclass(frozen=True, slots=True)
class Stage:
    """A kind of missions. ``seed``: the first one, of no other campaign; ``missions``: of a bug at most.

    ``repeats``: where no two flights of a seed are the same, a bug is found only if one of so many more violates the same.
    ``quick``: options with which a mission ends at its first violation. ``drawn``: the scenario document of a seed.
    """

    name: str
    command: tuple[str, ...]
    seed: int
    missions: int
    repeats: int = 0
    quick: tuple[str, ...] = ()
    drawn: Callable[[int], dict[str, Any]] | None = None

    def seeds(self, bug: Bug) -> list[int]:
        """Seeds of the bug's missions, ordered by how many of the bug's conditions each mission has."""
        every = list(range(self.seed, self.seed + self.missions))
        return sorted(every, key=lambda seed: -len(self.has(seed) & set(bug.reach))) if bug.reach else every

    def has(self, seed: int) -> set[str]:
        """Features of a mission, in the terms of ``Bug.reach``."""
        document = self.drawn(seed) if self.drawn is not None else {}
        found = {str(fault[key]) for fault in document.get("fault", ()) for key in ("kind", "message") if key in fault}
        found |= {"estimated"} if "sightings" in document else set()
        return found | ({"moving"} if "motion" in document.get("source", {}) else set())


def _dealt(seed: int) -> dict[str, Any]:
    from radron.sim.campaign.faults.course import DEALT  # noqa: PLC0415  (only where bugs say what reaches them)
    from radron.sim.campaign.faults.dealt import deal  # noqa: PLC0415

    return deal(seed, DEALT)


def _live(seed: int) -> dict[str, Any]:
    from radron.sim.campaign.faults.course import LIVE as COURSE  # noqa: PLC0415
    from radron.sim.campaign.faults.dealt import deal  # noqa: PLC0415

    return deal(seed, COURSE)


def _drawn(seed: int) -> dict[str, Any]:
    from radron.sim.campaign.faults.draw import draw  # noqa: PLC0415

    return draw(seed)


DEALT = Stage(
    "dealt", (*_RADRON_SIM, "faults", "--dealt", "--workers", "1"), 500_000, 10, 0, _FIRST, _dealt
)  # ten have all faults once, and none
DRAWN = Stage("drawn", (*_RADRON_SIM, "faults", "--workers", "1"), 510_000, 7, 0, _FIRST, _drawn)
LIVE = Stage("live", (*_RADRON_SIM, "live-faults"), 600_000, 3, repeats=3, drawn=_live)  # three have all of the live ones
STAGES = (DEALT, DRAWN, LIVE)  # 20 missions in all


@dataclass(frozen=True, slots=True)
class Flown:
    """A mission of one seed with one bug ("": none, the control), of packages with that fingerprint.

    ``attempt``: from 1 on where it is flown again.

    ``violated``: names of the violated invariants, sorted; ``text``: the first violation of each, in words.
    """

    bug: str
    seed: int
    sources: str
    violated: tuple[str, ...]
    text: str = ""
    attempt: int = 0


class Flights:
    """Flies missions in processes that end with this object's ``stop``."""

    def __init__(self, longest_s: float = 3600.0) -> None:
        """``longest_s``: a mission that takes longer is stopped, and counts as one without an end."""
        self._longest_s = longest_s
        self._running: set[subprocess.Popen[str]] = set()
        self._lock = threading.Lock()
        self._stopped = False

    def fly(self, command: Sequence[str], tree: Path, bug: str, seed: int, sources: str, attempt: int = 0) -> Flown | None:
        """Fly the packages in ``tree``, a folder ``radron``; None where it was stopped.

        Raises:
            BugError: the machine is too busy to fly live.
        """
        with tempfile.TemporaryDirectory(prefix="planted-") as folder:
            out = Path(folder) / "out"
            code, errors = self._run([*command, "--runs", "1", "--seed", str(seed), "--out", str(out)], tree)
            if self._stopped:
                return None
            if BUSY in errors:
                raise BugError(f"{BUSY}; the same command goes on from here")
            violated, text = ((HANG,), f"over {self._longest_s:g} s") if code is None else _judged(out, code, errors)
            return Flown(bug, seed, sources, violated, text[:_MOST_TEXT], attempt)

    def stop(self) -> None:
        """End all missions, and fly no more."""
        with self._lock:
            self._stopped = True
            for process in self._running:
                _kill(process)

    def _run(self, command: list[str], tree: Path) -> tuple[int | None, str]:
        """Exit code, None after ``longest_s``, and standard error. ``tree`` comes before any installed packages."""
        environment = os.environ | {"PYTHONPATH": str(tree.parent), "OMP_NUM_THREADS": "1", "PYTHONUNBUFFERED": "1"}
        with self._lock:
            if self._stopped:
                return None, ""
            process = subprocess.Popen(  # a session of its own: its workers end with it
                command,
                cwd=tree,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
                errors="replace",
                start_new_session=True,
            )
            self._running.add(process)
        try:
            _, errors = process.communicate(timeout=self._longest_s)
            return process.returncode, errors
        except subprocess.TimeoutExpired:
            _kill(process)
            process.communicate()
            return None, ""
        finally:
            with self._lock:
                self._running.discard(process)


class Record:
    """The file of flown missions; a line each, written at once, so that an interrupted run goes on from there."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = threading.Lock()
        self._flown: dict[tuple[str, int, str, int], Flown] = {}
        lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
        for flown in _read(lines):
            self._flown[flown.bug, flown.seed, flown.sources, flown.attempt] = flown
        if lines:  # the last one may have been torn by an interruption
            path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")

    def find(self, bug: str, seed: int, sources: str, attempt: int = 0) -> Flown | None:
        """That mission, if it was flown with these packages."""
        return self._flown.get((bug, seed, sources, attempt))

    def add(self, flown: Flown) -> None:
        """Keep a mission."""
        with self._lock:
            self._flown[flown.bug, flown.seed, flown.sources, flown.attempt] = flown
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(flown)) + "\n")


class Memo:
    """A lock for each seed, so that several users fly a control only once."""

    def __init__(self) -> None:
        self._guard = threading.Lock()
        self._locks: defaultdict[int, threading.Lock] = defaultdict(threading.Lock)

    def lock(self, seed: int) -> threading.Lock:
        """The lock of a seed."""
        with self._guard:
            return self._locks[seed]


def only_with_bug(flown: Flown, control: Flown) -> tuple[str, ...]:
    """The invariants that the mission violates and the same mission without the bug does not."""
    return tuple(name for name in flown.violated if name not in control.violated)


def _judged(out: Path, code: int, errors: str) -> tuple[tuple[str, ...], str]:
    """Names of the violated invariants, and the first violation of each in words."""
    try:
        lines = (out / "missions.jsonl").read_text(encoding="utf-8").splitlines()
        violations = [violation for line in lines for violation in json.loads(line)["violations"]]
    except (OSError, ValueError, KeyError, TypeError):
        lines, violations = [], []
    if not lines or code not in (0, 1):
        said = errors.strip().splitlines() or ["nothing on standard error"]
        return (CRASH,), f"exit code {code}: {said[-1]}"
    texts = {str(violation["invariant"]): str(violation.get("text", "")) for violation in reversed(violations)}
    return tuple(sorted(texts)), "; ".join(f"{name}: {text}" for name, text in sorted(texts.items()))


def _read(lines: Iterable[str]) -> Iterator[Flown]:
    """Missions flown; a torn line is flown again."""
    for line in lines:
        with contextlib.suppress(ValueError, TypeError, KeyError):
            entry = json.loads(line)
            yield Flown(**(entry | {"violated": tuple(entry["violated"])}))


def _kill(process: subprocess.Popen[str]) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)

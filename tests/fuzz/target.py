"""Fuzz targets, and the run of one case: cases are numbered, and each is a function of seed and number alone."""

from __future__ import annotations

import os
import time
import traceback
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random
from types import TracebackType
from typing import Any, ClassVar, TypeVar

T = TypeVar("T")
_ROOT = str(Path(__file__).parents[2]) + os.sep
_ENGINE = os.path.join("tests", "fuzz", "target.py")


class ViolationError(AssertionError):
    """An input that was accepted or refused, and left something behind that must not be."""


class TooSlowError(Exception):
    """An input that took longer than its target allows."""


def expect(holds: bool, what: str) -> None:
    """Raise ViolationError unless it holds."""
    if not holds:
        raise ViolationError(what)


class Probe:
    """Through which a case feeds its inputs: it keeps the newest one and the processor time that each took.

    ``data``: the newest input; ``count``: inputs so far; ``slowest_s``: of all.
    """

    def __init__(self, limit_s: float) -> None:
        self._limit_s = limit_s
        self.data = b""
        self.count = 0
        self.slowest_s = 0.0

    def feed(self, data: bytes, call: Callable[..., T], *args: Any) -> T:
        """Feed one input. Raises TooSlowError, and whatever ``call`` raises."""
        self.data = data
        self.count += 1
        return self.timed(call, *args)

    def timed(self, call: Callable[..., T], *args: Any) -> T:
        """A call that is no input of its own and must be as quick."""
        began_s = time.thread_time()
        result = call(*args)
        took_s = time.thread_time() - began_s
        self.slowest_s = max(self.slowest_s, took_s)
        if took_s > self._limit_s:
            raise TooSlowError(f"{getattr(call, '__qualname__', call)}: {took_s:.2f} s, and {self._limit_s:g} s are allowed")
        return result


class Target(ABC):
    """Something that reads. Anything but its documented error is a finding, and an input that takes too long is another.

    ``inputs``: of a whole run; ``batch``: of a case; ``limit_s``: processor time of one.
    """

    name: ClassVar[str]
    inputs: ClassVar[int]
    batch: ClassVar[int]
    limit_s: ClassVar[float]

    def __init__(self, folder: Path) -> None:
        """``folder``: for files; empty at the start, of this target alone."""
        self.folder = folder

    @abstractmethod
    def case(self, rng: Random, probe: Probe) -> None:
        """Feed ``batch`` inputs."""


@dataclass(frozen=True)
class Finding:
    """``kind``: the same for equal causes; ``data``: the input at which it showed, the last of its case."""

    target: str
    seed: int
    case: int
    kind: str
    trace: str
    data: bytes

    @property
    def replay(self) -> str:
        """The command that shows it again."""
        return f"python -m tests.fuzz {self.target} --seed {self.seed} --case {self.case}"


def run_case(target: Target, seed: int, number: int) -> tuple[Probe, Finding | None]:
    """Run one case. A slow case must be slow twice: the machine may have been busy."""
    probe, error = _attempt(target, seed, number)
    if isinstance(error, TooSlowError):
        probe, error = _attempt(target, seed, number)
    if error is None:
        return probe, None
    trace = "".join(traceback.format_exception(error))
    return probe, Finding(target.name, seed, number, _kind(error), trace, probe.data)


def _attempt(target: Target, seed: int, number: int) -> tuple[Probe, Exception | None]:
    probe = Probe(target.limit_s)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # no lines on the terminal
            target.case(Random(f"{target.name}/{seed}/{number}"), probe)
    except Exception as error:
        return probe, error
    return probe, None


def _kind(error: Exception) -> str:
    """Type of the error, and where in this repository it came from."""
    place = "?"
    if isinstance(error, ViolationError | TooSlowError):
        place = str(error).partition(":")[0]
    else:
        step: TracebackType | None = error.__traceback__
        while step is not None:
            code = step.tb_frame.f_code
            if code.co_filename.startswith(_ROOT) and ".venv" not in code.co_filename and _ENGINE not in code.co_filename:
                place = f"{code.co_filename.removeprefix(_ROOT)}:{step.tb_lineno}"
            step = step.tb_next
    return f"{type(error).__name__} at {place}"

"""Execution of a campaign's flights in processes on all cores, or on a Dask cluster.

A failed flight is reported, and the other flights continue.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import socket
import threading
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar
from urllib.parse import urlsplit

from radron.agent.errors import ConfigError
from radron.sim.sweep import Case

if TYPE_CHECKING:
    from distributed import Client

    from radron.sim.result import RunResult

_ONE_THREAD = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")}


class Labelled(Protocol):
    """A job of a campaign (one flight), which has a name and can be sent to another process."""

    @property
    def label(self) -> str:
        """Name of the job, with all that is needed to repeat it."""


J = TypeVar("J", bound=Labelled)
R = TypeVar("R")


@dataclass(frozen=True, slots=True)
class Job:
    """One flight of a campaign.

    The job carries its scenario, so that workers on other machines need no files. ``listen``: scores an estimator that reads the
    log without influence on the flight.
    """

    case: Case
    seed: int
    estimator: str | None = None  # None: the scenario's own
    law: str | None = None
    listen: str | None = None

    @property
    def label(self) -> str:
        """Name of the flight, with all that is needed to repeat it."""
        return f"{self.case.label} seed {self.seed}"


@dataclass(frozen=True, slots=True)
class Outcome(Generic[J, R]):
    """Result of a job (one flight of a campaign), or its error.

    ``error``: the last line of ``trace``, which is the whole traceback.
    """

    job: J
    result: R | None = None
    error: str = ""
    trace: str = ""


Fly = Callable[[Job], "RunResult"]


class Executor(Protocol):
    """A function that executes the jobs of a campaign, in any order; a caller that stops early must close it."""

    def __call__(self, jobs: Iterable[J], fly: Callable[[J], R], /) -> Iterator[Outcome[J, R]]:
        """Yield the outcomes as they come."""


def fly_job(job: Job) -> RunResult:
    """Simulate the flight of a job, and return its scores."""
    from radron.sim.lockstep.flight import fly  # noqa: PLC0415  (only the workers need the physics)

    listeners = () if job.listen is None else (job.listen,)
    flight = fly(job.case.scenario, job.seed, estimator=job.estimator, law=job.law, listen=listeners)
    return flight.result if job.listen is None else flight.listened[job.listen]


def attempt(fly: Callable[[J], R], job: J) -> Outcome[J, R]:
    """Execute a job; an exception becomes part of the outcome."""
    try:
        return Outcome(job, result=fly(job))
    except Exception as error:
        return Outcome(job, error=f"{type(error).__name__}: {error}".splitlines()[0], trace=traceback.format_exc())


def cores() -> int:
    """Return the number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)


def in_processes(workers: int) -> Executor:
    """Return an executor that flies on this machine, one flight and one thread per process.

    Raises (when called):
        ConfigError: fewer than one worker.
    """
    if workers < 1:
        raise ConfigError(f"--workers {workers}: give 1 or more")

    def execute(jobs: Iterable[J], fly: Callable[[J], R], /) -> Iterator[Outcome[J, R]]:
        waiting = deque(jobs)
        suspects: deque[J] = deque()  # in flight when a process died: repeated one at a time, to find the cause
        with _one_thread():
            while waiting or suspects:
                yield from _one_pool(waiting, suspects, fly, workers)

    return execute


def _one_pool(waiting: deque[J], suspects: deque[J], fly: Callable[[J], R], workers: int) -> Iterator[Outcome[J, R]]:
    """Fly until no job is left, or until a worker process dies, and the pool with it."""
    flying: dict[Future[Outcome[J, R]], J] = {}
    context = multiprocessing.get_context("spawn")  # nothing of this process, such as a progress bar's thread, leaks in
    others = set(multiprocessing.active_children())
    with ProcessPoolExecutor(workers, mp_context=context, initializer=_die_with_parent) as pool:
        try:
            while waiting or suspects or flying:
                source, room = (suspects, 1) if suspects else (waiting, workers)
                while source and len(flying) < room:
                    with _without_sigint():
                        future = pool.submit(attempt, fly, source[0])  # raises if the pool has died: the job stays
                    flying[future] = source.popleft()
                done, _ = wait(flying, return_when=FIRST_COMPLETED)
                for future in done:
                    outcome = future.result()
                    del flying[future]
                    yield outcome
        except BrokenProcessPool:
            lost = list(flying.values())
        except (KeyboardInterrupt, GeneratorExit):  # else the pool would wait for the running flights
            for worker in set(multiprocessing.active_children()) - others:
                worker.terminate()
            raise
        else:
            return
    if len(lost) == 1:
        yield Outcome(lost[0], error="the worker process died (out of memory, or killed)")
    else:
        suspects.extend(lost)


def on_dask(address: str, timeout_s: float = 10.0) -> Executor:
    """Return an executor that flies on a running Dask cluster, whose workers must have an equal version of radron.

    Raises (when it is run):
        ConfigError: no cluster answers at the address.
    """

    def execute(jobs: Iterable[J], fly: Callable[[J], R], /) -> Iterator[Outcome[J, R]]:
        _probe(address, timeout_s)
        from distributed import Client  # noqa: PLC0415  (takes a second to load)

        try:
            client = Client(  # type: ignore[no-untyped-call]
                address, timeout=timeout_s, set_as_default=False
            )
        except (OSError, ValueError, ImportError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise ConfigError(f"--dask {address}: no Dask cluster answers ({reason}); give its scheduler's address") from None
        with client:
            yield from on_client(client, jobs, fly)

    return execute


def _probe(address: str, timeout_s: float) -> None:
    """Raise ConfigError without a listener at the address: Dask's own client would retry for long, and print tracebacks."""
    wanted, url = f"--dask {address}: ", address if "://" in address else f"tcp://{address}"
    if not url.startswith(("tcp://", "tls://")):
        return  # no TCP address to try
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if not host or not port:
        raise ConfigError(f"{wanted}expected the address of a scheduler, such as tcp://10.0.0.5:8786")
    try:
        socket.create_connection((host, port), timeout_s).close()
    except OSError as error:
        raise ConfigError(
            f"{wanted}no Dask cluster answers ({error.strerror or error}); start one with `dask scheduler`"
        ) from None


def on_client(client: Client, jobs: Iterable[J], fly: Callable[[J], R]) -> Iterator[Outcome[J, R]]:
    """Execute jobs on a connected Dask cluster, and yield their outcomes as they end."""
    from distributed import as_completed  # noqa: PLC0415

    flying: dict[Any, J] = {client.submit(attempt, fly, job, pure=False): job for job in jobs}
    for future in as_completed(list(flying), loop=client.loop):  # type: ignore[no-untyped-call]
        error = future.exception() if future.status == "error" else None
        job = flying.pop(future)
        if error is not None:  # attempt() catches all others: the worker died, or has another version
            yield Outcome(job, error=f"{type(error).__name__}: {error}".splitlines()[0])
        else:
            yield future.result()


@contextmanager
def _one_thread() -> Iterator[None]:
    """Limit child processes started inside to one thread each, as there is one process for every core."""
    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(_ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextmanager
def _without_sigint() -> Iterator[None]:
    """Make processes started inside ignore SIGINT, which a terminal sends to all: this process receives it, and stops them."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _die_with_parent() -> None:
    """End this worker as soon as its parent ends, so that a killed campaign leaves no workers behind."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()

"""The watchdog, with real processes: a hanging agent is killed, a stop on request works, and no process is left behind."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

CHILD = Path(__file__).parents[2] / "lib/support/live/heartbeat_standin.py"
Start = Callable[..., subprocess.Popen[str]]
BUSY_S = 3.0  # by which everything may take longer on a busy computer
PATIENCE_S = 20.0  # for what takes a fraction of it on a computer that has nothing else to do


@pytest.fixture
def start() -> Iterator[Start]:
    """Starts a supervisor with the stand-in as its child, in a process group of its own."""
    started: list[subprocess.Popen[str]] = []

    def run(how: str, **environment: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-m", "radron.agent.shell.supervisor", sys.executable, str(CHILD), how],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            env={**os.environ, **environment}, start_new_session=True,
        )  # fmt: skip
        started.append(process)
        return process

    yield run
    for process in started:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def first_step(process: subprocess.Popen[str]) -> int:
    """Wait until the child has beaten, which it does after it has said that it steps; its process id."""
    assert process.stdout is not None
    process.stdout.readline()
    word, child, _ = process.stdout.readline().split()
    assert word == "step"
    return int(child)


def gone(pid: int) -> bool:
    """Whether a process has ended; a zombie that its init does not collect has."""
    try:
        return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def ended(process: subprocess.Popen[str]) -> tuple[int, str, list[float]]:
    """Exit code, error text, and the times of the steps that had not been read yet."""
    out, err = process.communicate(timeout=PATIENCE_S)
    return process.returncode, err, [float(line.split()[2]) for line in out.splitlines()]


@pytest.mark.parametrize("code", [0, 2, 7])
def test_the_exit_code_is_passed_on(start: Start, code: int) -> None:
    assert ended(start(str(code)))[:2] == (code, "")


def test_an_agent_that_hangs_is_killed_a_second_after_its_last_beat(start: Start) -> None:
    process = start("hangs")
    code, err, steps = ended(process)
    assert (code, err) == (70, "radron-agent: no heartbeat for 1 s: killed\n")
    assert 0.9 < time.monotonic() - steps[-1] < 1.8 + BUSY_S


@pytest.mark.slow
def test_an_agent_that_is_silent_before_its_first_beat_is_killed_but_not_while_it_says_what_it_waits_for() -> None:
    impatient = "import radron.agent.shell.supervisor as one; one.SILENT_START_S = 3.0; one.main()"
    command = [sys.executable, "-c", impatient, sys.executable, str(CHILD), "waits, then hangs"]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert (ran.returncode, ran.stderr) == (70, "radron-agent: no heartbeat for 3 s: killed\n")
    assert ran.stdout.count("waits") == 4  # in 4 s


def test_an_agent_that_asks_for_it_is_started_again(start: Start, tmp_path: Path) -> None:
    process = start("anew", MARK=str(tmp_path / "mark"))
    assert process.stdout is not None
    word, first, _ = process.stdout.readline().split()
    assert word == "first"
    second = first_step(process)
    assert second != int(first)
    assert gone(int(first))
    os.kill(process.pid, signal.SIGTERM)
    assert process.wait(PATIENCE_S) == 0


def test_an_agent_that_is_stopped_is_killed(start: Start) -> None:
    process = start("runs")
    os.kill(first_step(process), signal.SIGSTOP)
    assert ended(process)[0] == 70


def test_an_agent_may_take_its_time_before_its_first_beat(start: Start) -> None:
    assert ended(start("slow start"))[:2] == (0, "")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("how", ["tidy", "runs"])
def test_it_ends_when_asked_to(start: Start, how: str, number: signal.Signals) -> None:
    process = start(how)
    child = first_step(process)
    process.send_signal(number)
    assert ended(process)[:2] == (0, "")
    assert gone(child)


def test_an_agent_that_does_not_end_when_asked_to_is_killed_within_two_seconds(start: Start) -> None:
    process = start("stubborn")
    first_step(process)
    process.terminate()
    asked_s = time.monotonic()
    code, err, _ = ended(process)
    assert (code, err) == (70, "radron-agent: did not stop within 1.5 s: killed\n")
    assert time.monotonic() - asked_s < 2.0 + BUSY_S


def test_an_agent_that_somebody_kills_is_no_clean_end(start: Start) -> None:
    process = start("runs")
    os.kill(first_step(process), signal.SIGKILL)
    assert ended(process)[:2] == (128 + 9, "radron-agent: ended by SIGKILL\n")


@pytest.mark.parametrize("how", ["runs", "hangs"])
def test_an_agent_without_a_supervisor_ends_at_once(start: Start, how: str) -> None:
    process = start(how)
    child = first_step(process)
    process.kill()
    deadline_s = time.monotonic() + PATIENCE_S  # the kernel's doing: it is a matter of milliseconds
    while not gone(child):
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


def test_woken_after_a_stop_nothing_is_sent_any_more(start: Start) -> None:
    process = start("runs")
    first_step(process)
    os.killpg(process.pid, signal.SIGSTOP)
    time.sleep(1.3)  # longer than the second after which the autopilot has taken over
    woken_s = time.monotonic()
    os.killpg(process.pid, signal.SIGCONT)
    code, err, steps = ended(process)
    assert code == 70
    assert "stalled" in err or "no heartbeat" in err  # in either order
    assert not [step_s for step_s in steps if step_s > woken_s]


def test_the_service_manager_is_told(start: Start, tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(PATIENCE_S)
        process = start("tells", NOTIFY_SOCKET=str(tmp_path / "notify"), WATCHDOG_USEC="300000")
        heard: list[str] = []
        while heard.count("WATCHDOG=1") < 3:
            heard += manager.recv(4096).decode().split("\n")
        assert [line for line in heard if line != "WATCHDOG=1"] == ["READY=1", "STATUS=survey"]
        process.terminate()
        while "STOPPING=1" not in heard:
            heard += manager.recv(4096).decode().split("\n")
        assert ended(process)[0] == 0


def test_it_is_small(start: Start) -> None:
    process = start("runs")
    first_step(process)
    assert psutil.Process(process.pid).memory_info().rss < 15_000_000


def test_what_an_agent_leaves_among_the_temporary_files_goes_with_it(start: Start, tmp_path: Path) -> None:
    process = start("runs", TMPDIR=str(tmp_path))
    child = first_step(process)
    assert [path.name for path in tmp_path.glob("*/*")] == ["left"]
    os.kill(child, signal.SIGKILL)
    ended(process)
    assert list(tmp_path.iterdir()) == []

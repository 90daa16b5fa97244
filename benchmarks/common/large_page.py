"""The operator's page of a large swarm in a real browser: its processes and their measurement."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import psutil
from playwright.sync_api import Page, sync_playwright
from websockets.sync.client import ClientConnection, connect

BENCHMARKS = str(Path(__file__).parents[1])
FLAGS = ["--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking", "--disable-sync"]
# Counts pictures of the screen; records the time on the screen (ms UTC) and the place of the first drone for each drawn frame. A
# drawn picture is on the screen before the next one begins. The map is moved as by a finger that drags it.
WATCH = """() => {
  window.seen = { pictures: 0, frames: radron.frames, drawn: [], pan: 0 };
  const now = () => performance.timeOrigin + performance.now();
  const watch = () => {
    seen.pictures += 1;
    if (seen.pan) {
      const map = radron.map.map;
      map._rawPanBy(L.point(seen.pictures % 120 < 60 ? seen.pan : -seen.pan, 0));
      map.fire("move").fire("drag");
      if (seen.pictures % 60 === 0) map.fire("moveend").fire("dragend");
    }
    if (radron.frames !== seen.frames && radron.frame?.drones[0].place) {
      seen.frames = radron.frames;
      const [x, y] = radron.frame.drones[0].place;
      requestAnimationFrame(() => seen.drawn.push([now(), x, y]));
    }
    requestAnimationFrame(watch);
  };
  requestAnimationFrame(watch);
}"""


class Child:
    """A process of this benchmark that prints JSON lines. ``said``: the lines so far."""

    def __init__(self, module: str, *arguments: str) -> None:
        command = [sys.executable, "-m", f"common.{module}", *arguments]
        threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}  # as radron-station sets them
        environment = os.environ | {"PYTHONPATH": BENCHMARKS} | threads
        self.process = psutil.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment)
        self.said: list[Any] = []
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        for line in self.process.stdout:
            self.said.append(json.loads(line) if line[0] in "{[" else line.strip())

    def ask(self) -> Any:
        """Send a line; return the process's next line."""
        known = len(self.said)
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        return self.until(known)

    def until(self, known: int, within_s: float = 60.0) -> Any:
        """The line after so many."""
        deadline_s = time.monotonic() + within_s
        while len(self.said) <= known:
            if self.process.poll() is not None or time.monotonic() > deadline_s:
                sys.exit(f"{' '.join(self.process.args)}: it has said nothing")
            time.sleep(0.02)
        return self.said[known]

    def finish(self) -> Any:
        """End its input; the last line that it prints."""
        self.process.stdin.close()
        self.process.wait(30.0)
        self._thread.join()
        return self.said[-1]

    def close(self) -> None:
        """End it."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()


@contextmanager
def child(module: str, *arguments: str) -> Iterator[Child]:
    """A process as long as the block lasts."""
    found = Child(module, *arguments)
    try:
        yield found
    finally:
        found.close()


@contextmanager
def browsing(address: str) -> Iterator[Page]:
    """A page in headless Chromium."""
    chromium = next((path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None)
    if chromium is None:
        sys.exit("no chromium: apt-get install chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        try:
            page = browser.new_page(viewport={"width": 1400, "height": 900})
            page.goto(address)
            page.wait_for_function("() => window.radron?.mission")
            page.evaluate(WATCH)
            yield page
        finally:
            browser.close()


class Smoothness(NamedTuple):
    """Pictures per second, and the browser's CPU for each of them, ms, which other work on the computer does not change."""

    pictures_ps: float
    cpu_ms: float


def smoothness(page: Page, seconds: float, pan_px: int = 0) -> Smoothness:
    """``pan_px``: by which the map is moved in each picture."""
    browser_s = _browser_s()
    page.evaluate(f"() => {{ seen.pan = {pan_px}; }}")
    before = page.evaluate("() => [performance.now(), seen.pictures]")
    page.wait_for_timeout(1000.0 * seconds)
    after = page.evaluate("() => [performance.now(), seen.pictures]")
    page.evaluate("() => { seen.pan = 0; }")
    pictures = after[1] - before[1]
    return Smoothness(1000.0 * pictures / (after[0] - before[0]), 1000.0 * (_browser_s() - browser_s) / pictures)


def _browser_s() -> float:
    """CPU time of the browser's processes so far."""
    own = psutil.Process(os.getpid()).children(recursive=True)
    return sum(sum(one.cpu_times()[:2]) for one in own if "chrom" in one.name())


def latencies_ms(published: list[list[float]], drawn: list[list[float]]) -> list[float]:
    """From the publication of a place to the picture that shows it first."""
    found, known = [], {(x, y): at_ms for at_ms, x, y in reversed(published)}
    for at_ms, x, y in drawn:
        sent_ms = known.pop((round(x, 2), round(y, 2)), None)
        if sent_ms is not None and 0.0 < at_ms - sent_ms < 5000.0:
            found.append(at_ms - sent_ms)
    return found


def renderer_mb() -> float:
    """Memory of the largest process that draws a page, without shared memory."""
    own = psutil.Process(os.getpid()).children(recursive=True)
    return max((one.memory_full_info().uss / 1e6 for one in own if "--type=renderer" in " ".join(one.cmdline())), default=0.0)


def socket_of(address: str) -> ClientConnection:
    """A page's socket without a page."""
    page, _, token = address.replace("http", "ws", 1).partition("?")
    return connect(f"{page}socket?{token}", max_size=None)


def snapshot_bytes(address: str) -> int:
    """Data for a newly opened page up to its first frame."""
    size = 0
    with socket_of(address) as socket:
        while True:
            text = socket.recv(timeout=30.0)
            size += len(text)
            if json.loads(text)["kind"] == "frame":
                return size


def seek_ms(address: str, times_ms: list[int]) -> list[float]:
    """From the wish to see a time to its frame."""
    found = []
    with socket_of(address) as socket:
        for at_ms in times_ms:
            began_s = time.monotonic()
            socket.send(json.dumps({"at_ms": at_ms, "drawn": True}))
            shown = False
            while not shown:
                message = json.loads(socket.recv(timeout=30.0))
                shown = message["kind"] == "frame" and at_ms - 1500 < message["at_ms"] <= at_ms
            found.append(1000.0 * (time.monotonic() - began_s))
    return found

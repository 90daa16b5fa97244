"""Start of the demo with encryption and certificates against the same without: the user waits no longer for them.

Starts ``radron-sim live`` as ``make demo`` does, alternately with and without ``--insecure``, until all agents are ready and the
start is commanded; certificates are made for each flight. Then it is stopped.

Run: python benchmarks/start_up.py [--runs 6] [--json OUT]; about 3 minutes
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from common.goals import Goal, show

READY = "all agents are ready"
MOST_RATIO = 1.1  # goal
LIMIT_S = 180.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--runs", type=int, default=6, help="of each kind")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    found: dict[bool, list[float]] = {True: [], False: []}
    start(True)  # fills the disk's cache
    for _ in range(options.runs):
        for secured in (True, False):
            found[secured].append(start(secured))
            print(f"{'secured' if secured else 'insecure':8} {found[secured][-1]:6.2f} s from the command to the mission's start")
    ratio = statistics.median(found[True]) / statistics.median(found[False])
    told = " against ".join(f"{statistics.median(one):.2f} ({min(one):.2f}-{max(one):.2f})" for one in found.values())
    title = f"The demo, {options.runs} starts of each kind; load of this machine {os.getloadavg()[0]:.1f}"
    show(title, [Goal("from the command to the start, against --insecure", ratio, MOST_RATIO, "times", f"{told} s")])
    if options.json is not None:
        figures = {"secured_s": found[True], "insecure_s": found[False], "ratio": ratio}
        options.json.write_text(json.dumps({"start_up": figures}, indent=1) + "\n")


def start(secured: bool) -> float:
    """Seconds from the command to the start of the mission."""
    with tempfile.TemporaryDirectory(prefix="radron-start-") as folder:
        program = str(Path(sys.executable).with_name("radron-sim"))
        command = [program, "live", "paper-demo", "--seed", "5", "--out", folder, *([] if secured else ["--insecure"])]
        began_s, told = time.monotonic(), ""
        launcher = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        try:
            assert launcher.stderr is not None
            for line in launcher.stderr:
                told = line.strip() or told
                if READY in line:
                    return time.monotonic() - began_s
                if time.monotonic() > began_s + LIMIT_S:
                    break
            sys.exit(f"{' '.join(command)}: not ready: {told}")
        finally:
            launcher.send_signal(signal.SIGINT)
            launcher.communicate(timeout=30.0)


if __name__ == "__main__":
    main()

"""``python -m agent DRONE.toml [--verbose] PARENT``: the agent itself, as its supervisor starts it."""

import os
import signal
import sys

from agent.beat import BEAT_FD, Beat, die_with

if __name__ == "__main__":
    die_with(int(sys.argv[-1]))  # before anything that takes its time
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of a terminal: the supervisor gets it too, and asks us to end
    from agent.running import run_agent

    os._exit(run_agent(sys.argv[1], "--verbose" in sys.argv, Beat(BEAT_FD)))

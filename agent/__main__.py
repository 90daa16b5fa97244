"""``python -m radron.agent DRONE.toml [--verbose] [--wait] PARENT``: the agent's own process, started by its supervisor."""

import os
import signal
import sys

from radron.agent.shell.heartbeat import HEARTBEAT_FD, Heartbeat, die_with

if __name__ == "__main__":
    die_with(int(sys.argv[-1]))  # first of all: the imports below take a second
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C also reaches the supervisor, which stops this process
    from radron.agent.shell.patience import Patience
    from radron.agent.shell.running import run_agent

    heartbeat = Heartbeat(HEARTBEAT_FD)
    patience = Patience(heartbeat, waits="--wait" in sys.argv)
    os._exit(run_agent(sys.argv[1], "--verbose" in sys.argv, heartbeat, patience=patience))

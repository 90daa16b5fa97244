#!/usr/bin/env python3
"""Stands in for PX4's binary: notes how it was called, and sends heartbeats as that instance until it is ended.

``PX4_STANDIN_ENDS``: ends at once with this code, like an autopilot that cannot start.
"""

import json
import os
import signal
import socket
import sys
import time
from pathlib import Path

if __name__ == "__main__":
    instance = int(sys.argv[sys.argv.index("-i") + 1])
    told = {name: value for name, value in os.environ.items() if name.startswith("PX4_")}
    note = {"arguments": sys.argv[1:], "environment": told, "folder": os.getcwd(), "pid": os.getpid()}
    Path("called.json").write_text(json.dumps(note))
    print("PX4 says something")
    if code := os.environ.get("PX4_STANDIN_ENDS"):
        print("ERROR [px4] Startup script returned with return value: 256")
        sys.exit(int(code))
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    while True:
        link.sendto(b"heartbeat", ("127.0.0.1", 14540 + instance))
        time.sleep(0.05)

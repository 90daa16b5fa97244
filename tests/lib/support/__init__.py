"""Helpers of the tests: pilots and flights made by hand, emulated autopilots, computers, mesh peers and devices.

The folder above is on the path of pytest (``pyproject.toml``). Benchmarks add it; processes started by tests get it by ``PATH``.
"""

from pathlib import Path

PATH = str(Path(__file__).parents[1])  # entry of sys.path or PYTHONPATH

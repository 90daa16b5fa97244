"""``make fuzz``: random and broken input for everything that reads foreign data (``python -m tests.fuzz --help``)."""

import sys
from pathlib import Path

_LIB = str(Path(__file__).parents[1] / "lib")  # the package support, as pytest finds it
if _LIB not in sys.path:
    sys.path.append(_LIB)

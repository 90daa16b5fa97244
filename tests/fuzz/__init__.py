"""``make fuzz``: random and broken input for everything that reads what others wrote (``python -m tests.fuzz --help``)."""

import sys
from pathlib import Path

_SUPPORT = str(Path(__file__).parents[1] / "support")
if _SUPPORT not in sys.path:
    sys.path.append(_SUPPORT)  # the helpers of the tests

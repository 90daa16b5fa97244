"""``make fuzz``: random and broken input for everything that reads foreign data (``python -m tests.fuzz --help``)."""

import sys
from pathlib import Path

_SUPPORT = Path(__file__).parents[1] / "support"
# The helpers of the tests, as pytest finds them.
sys.path += [str(folder) for folder in (_SUPPORT, *sorted(_SUPPORT.glob("[a-z]*/"))) if str(folder) not in sys.path]

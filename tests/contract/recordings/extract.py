"""Everything in this folder out of a folder of recordings (``*.tlog.xz``): runs each ``extract_*.py`` beside this one.

    python extract.py FOLDER-OF-THE-TLOGS

The packages of this repository must be importable.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path


def main() -> None:
    """Run them one after another; ends where one fails."""
    for module in sorted(Path(__file__).parent.glob("extract_*.py")):
        print(module.name)
        subprocess.run([sys.executable, str(module), *sys.argv[1:]], check=True)


if __name__ == "__main__":
    main()

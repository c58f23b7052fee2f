"""The program of an installed package: it starts through the launcher, which sets threads, MPI and
ranks as in a checkout.
"""

import os
import sys
from pathlib import Path

LAUNCHER = Path(__file__).resolve().parents[1] / "environment" / "installed.sh"


def main() -> None:
    """Give way to the launcher, with this Python as the one that computes."""
    own = {"HEADSTOCK_PYTHON": sys.executable}
    os.execve("/bin/sh", ["sh", str(LAUNCHER), *sys.argv[1:]], os.environ | own)


if __name__ == "__main__":
    main()

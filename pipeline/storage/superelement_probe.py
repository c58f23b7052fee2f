"""The child process that reads a superelement file first: ``python -m headstock.pipeline.storage.superelement_probe < FILE``.

The HDF5 library has ended whole processes on damaged files; what this process survives, its parent can read.
"""

import io
import sys

from headstock.meshing.process.guarded import accept_guard
from headstock.pipeline.storage.records import RecordError
from headstock.pipeline.storage.superelements import REFUSED, parse_superelement


def main(arguments: list[str]) -> int:
    """Read the file on standard input within limits; 0 it is sound, 3 it is not and standard error says why."""
    (name,) = accept_guard(arguments)
    try:
        parse_superelement(io.BytesIO(sys.stdin.buffer.read()), name)
    except RecordError as error:
        sys.stderr.write(f"\n{error}\n")
        return REFUSED
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

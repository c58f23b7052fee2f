"""The child process that reads a superelement file first: ``python -m headstock.pipeline.superelement_probe PARENT < FILE``.

The HDF5 library has ended whole processes on damaged files; what this process survives, its parent can read.
"""

import io
import os
import sys

from headstock.meshing.process_limits import end_with_parent, set_limits
from headstock.pipeline.record_files import RecordError
from headstock.pipeline.superelement_files import MEMORY_BYTES, MEMORY_FACTOR, REFUSED, SECONDS, parse_superelement


def main(arguments: list[str]) -> int:
    """Read the file on standard input within limits; 0 it is sound, 3 it is not and standard error says why."""
    end_with_parent(int(arguments[0]))
    size = os.fstat(sys.stdin.fileno()).st_size
    set_limits(memory_bytes=MEMORY_BYTES + MEMORY_FACTOR * size, cpu_seconds=SECONDS + size // 10_000_000)
    try:
        parse_superelement(io.BytesIO(sys.stdin.buffer.read()), arguments[1])
    except RecordError as error:
        sys.stderr.write(f"\n{error}\n")
        return REFUSED
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

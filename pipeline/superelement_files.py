"""Superelements in Headstock's own HDF5 layout: one data set, attribute or group per field of ``Superelement``."""

import io
import os
from pathlib import Path
from typing import BinaryIO

import h5py
import numpy as np

from headstock.meshing.guarded_process import ChildLimits, run_guarded
from headstock.pipeline.outputs import write_output
from headstock.pipeline.record_files import RecordError, read_record, write_record
from headstock.reduction.rails import DEGREE, STATION_DOFS
from headstock.reduction.superelement import Superelement

FORMAT = "headstock superelement"
VERSION = 1
# limits of the child process that reads a file first: fixed, and growing with the file
PROBE = "headstock.pipeline.superelement_probe"
REFUSED = 3
MEMORY_BYTES = 768 << 20
MEMORY_FACTOR = 20
SECONDS = 8
# a process that waits uses no processor time; a busy machine gives one little of it
WALL_SECONDS = 60


def write_superelement(path: Path, superelement: Superelement) -> None:
    """Write a superelement so that a reader sees the old file or the whole new one, never a part.

    Raises:
        OutputError: It cannot be written, or there is a file that Headstock did not write.
    """
    image = io.BytesIO()
    with h5py.File(image, "w", track_order=True) as file:
        file.attrs["format"] = FORMAT
        file.attrs["version"] = VERSION
        write_record(file, superelement)
    write_output(path, image.getvalue())


def read_superelement(path: Path) -> Superelement:
    """Read a superelement file and check that its parts fit together; a child process with limits reads it first.

    Raises:
        RecordError: The file is no superelement file, is damaged, or its arrays contradict each other.
    """
    if path.exists() and not path.is_file():
        raise RecordError(f"{path} cannot be read: it is no regular file")
    try:
        with path.open("rb") as file:
            _probe(file, path.name)
            file.seek(0)
            return parse_superelement(io.BytesIO(file.read()), str(path))
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {error.strerror or error}") from error


def parse_superelement(content: BinaryIO, name: str) -> Superelement:
    """Read a superelement from the content of its file.

    Args:
        content: Of the file.
        name: Of the file, for messages.

    Raises:
        RecordError: It is no superelement file, is damaged, or its arrays contradict each other.
    """
    try:
        with h5py.File(content, "r") as file:
            if file.attrs.get("format") != FORMAT or file.attrs.get("version") != VERSION:
                raise RecordError(f"it is not a {FORMAT} file of version {VERSION}")
            superelement = read_record(file, Superelement)
    except RecordError as error:
        raise RecordError(f"{name}: {error}") from error
    except Exception as error:  # h5py raises almost anything on damaged files
        raise RecordError(f"{name} cannot be read as a superelement: {type(error).__name__}: {error}") from error
    _check_shapes(name, superelement)
    return superelement


def _probe(file: BinaryIO, name: str) -> None:
    size = os.fstat(file.fileno()).st_size
    more = size // 10_000_000
    limits = ChildLimits(MEMORY_BYTES + MEMORY_FACTOR * size, SECONDS + more, WALL_SECONDS + 4 * more)
    end = run_guarded(PROBE, [name], limits=limits, stdin=file)
    if end.code == 0:
        return
    message = end.last_line
    if end.out_of_time:
        message = f"{name}: reading it took more than {end.out_of_time}; {end.time_remedy or 'it is damaged: export it again'}"
    elif end.out_of_memory:
        message = f"{name}: reading it needed more than {end.memory_limit}; {end.memory_remedy or 'it is damaged: export it again'}"
    elif end.code != REFUSED:
        message = f"{name} is damaged: the process that read it within its limits ended with code {end.code} ({message})"
    raise RecordError(message)


def _check_shapes(path: str, superelement: Superelement) -> None:
    size = len(superelement.labels)
    expected = {
        "stiffness": (superelement.stiffness, (size, size)),
        "mass": (superelement.mass, (size, size)),
        "damping": (superelement.damping, (size, size)),
        "missing_energy": (superelement.missing_energy, (size, size)),
        "constraints": (superelement.constraints, (len(superelement.constraints), size)),
        "modal_frequencies_hz": (superelement.modal_frequencies_hz, (size - superelement.boundary_size,)),
        "center_of_mass": (superelement.center_of_mass, (3,)),
        "inertia": (superelement.inertia, (3, 3)),
    }
    if superelement.recovery is not None and superelement.recovery_points is not None:
        expected["recovery"] = (superelement.recovery, (3 * len(superelement.recovery_points), size))
    for name, load in superelement.loads.items():
        expected[f"loads/{name}"] = (load.vector, (size,))
    if superelement.truncation is not None:
        boundary = (superelement.boundary_size, superelement.boundary_size)
        expected["truncation/first"] = (superelement.truncation.first, boundary)
        expected["truncation/second"] = (superelement.truncation.second, boundary)
        if not superelement.truncation.limit > 0.0:
            raise RecordError(f"{path}: truncation/limit is {superelement.truncation.limit}; it must be above zero")
    for name, rail in superelement.rails.items():
        expected[f"rails/{name}/control"] = (rail.control, (STATION_DOFS * (len(rail.knots) - DEGREE - 1), size))
        expected[f"rails/{name}/center"] = (rail.center, (3,))
    for name, (array, shape) in expected.items():
        if array is not None and array.shape != shape:
            raise RecordError(f"{path}: {name} has shape {array.shape}, {shape} fits its {size} labels")
        if array is not None and not np.isfinite(array).all():
            raise RecordError(f"{path}: {name} holds values that are not finite")
    for name, attachment in superelement.attachments.items():
        if not 0 <= attachment.node < len(superelement.frames):
            raise RecordError(f"{path}: interface {name!r} sits on node {attachment.node}; there are {len(superelement.frames)}")

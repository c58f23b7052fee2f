"""Superelements in Headstock's own HDF5 layout: one data set, attribute or group per field of
``Superelement``.

A file is first read by a worker process: the HDF5 library has ended whole processes on damaged
files, and what the worker survives its parent can read.
"""

import io
from pathlib import Path

import numpy as np
import scipy.linalg

from headstock.geometry.errors import printable
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.carriages import DEGREE
from headstock.meshing.process.isolation import WorkerLimits
from headstock.meshing.process.plain_hdf5 import h5py
from headstock.meshing.process.strangers import PART, require_size
from headstock.meshing.process.worker import REFUSED, call_apart
from headstock.pipeline.storage.outputs import write_output
from headstock.pipeline.storage.provenance import Provenance
from headstock.pipeline.storage.records import (
    RecordError,
    read_record,
    require_plain,
    write_record,
    write_words,
)
from headstock.reduction.patch_shapes import PatchShapes, count_patch_shapes, list_degrees
from headstock.reduction.rails import CONTROL_POINT_DOFS
from headstock.reduction.superelement import Superelement
from headstock.reduction.superelement_checks import dof_scale

FORMAT = "headstock superelement"
VERSION = 2  # 1 had the recovery basis and the error estimates among the matrices
# limits of the worker process that reads a file first: fixed, and growing with the file
PARSE = "headstock.pipeline.storage.superelements:parse_superelement"
MEMORY_BYTES = 768 << 20
MEMORY_FACTOR = 20
SECONDS = 8
LONGEST_NAME = 200
HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
MARKUP = set("<>&\"'`\\")
CONSISTENCY = 1e-6  # relative, between numbers that say the same
AXES = (0, 1, 2)
MATRICES = ("stiffness", "mass", "damping")
ERROR_MATRICES = (
    "missing_energy",
    "shape_stiffness",
    "shape_mass",
    "left_out_stiffness",
    "left_out_mass",
)
# a process that waits uses no processor time; a busy machine gives one little of it
WALL_SECONDS = 60


def write_superelement(path: Path, superelement: Superelement) -> None:
    """Write a superelement, so that a reader sees the old file or the whole new one, never a part.

    Raises:
        OutputError: It cannot be written, or there is a file that Headstock did not write.
    """
    write_output(path, encode_superelement(superelement))


def encode_superelement(superelement: Superelement, origin: Provenance | None = None) -> bytes:
    """Return a superelement as a file.

    Args:
        origin: Version, command and scene that it comes from; None leaves them out.
    """
    image = io.BytesIO()
    with h5py.File(image, "w", track_order=True) as file:
        file.attrs["format"] = FORMAT
        file.attrs["version"] = VERSION
        write_record(file, superelement)
        if origin is not None:
            write_words(file.create_group("provenance"), origin.summarise_for_export())
    return image.getvalue()


def read_superelement(path: Path) -> Superelement:
    """Read a superelement file and check that its parts fit together; a worker process with limits
    reads it first.

    Raises:
        RecordError: The file is no superelement file, is damaged, or its arrays contradict each
            other.
    """
    require_size(path, PART, RecordError)
    try:
        with path.open("rb") as file:
            if file.read(len(HDF5_SIGNATURE)) != HDF5_SIGNATURE:
                raise RecordError(f"{path} cannot be read: it is no HDF5 file")
        # once: what the worker finds sound is what is read, whoever writes to the file meanwhile
        content = path.read_bytes()
        _probe(content, path.name)
        return parse_superelement(str(path), content)
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {error.strerror or error}") from error


def parse_superelement(name: str, content: bytes) -> Superelement:
    """Read a superelement from the content of its file.

    Raises:
        RecordError: It is no superelement file, is damaged, or its arrays contradict each other.
    """
    try:
        with h5py.File(io.BytesIO(content), "r") as file:
            require_plain(file)
            if file.attrs.get("format") != FORMAT:
                raise RecordError(f"it is no {FORMAT} file")
            if file.attrs.get("version") != VERSION:
                raise RecordError(
                    f"its version is {file.attrs.get('version')}, {VERSION} is read; export it again"
                )
            superelement = read_record(file, Superelement)
    except RecordError as error:
        raise RecordError(f"{name}: {error}") from error
    except MemoryError:
        raise
    except Exception as error:  # h5py raises almost anything on damaged files
        raise RecordError(
            f"{name} cannot be read as a superelement: {type(error).__name__}: {error}"
        ) from error
    _check_texts(name, superelement)
    _check_shapes(name, superelement)
    _check_meaning(name, superelement)
    return superelement


def _probe(content: bytes, name: str) -> None:
    size = len(content)
    more = size // 10_000_000
    limits = WorkerLimits(
        MEMORY_BYTES + MEMORY_FACTOR * size, SECONDS + more, WALL_SECONDS + 4 * more
    )
    end = call_apart([PARSE], name, limits=limits, content=content)
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


def _check_texts(path: str, superelement: Superelement) -> None:
    """Refuse names and warnings that a terminal, a page or a file name could take for more than
    words.
    """
    nested = (
        superelement.interface_maps,
        superelement.loads,
        superelement.rails,
        superelement.free_dofs,
    )
    names = [name for part in nested for name in part] + [
        name for label in superelement.labels for name in label
    ]
    if any(len(label) != 2 for label in superelement.labels):
        raise RecordError(f"{path}: labels must be pairs of words")
    for name in (superelement.name, *names):
        if (
            not isinstance(name, str)
            or len(name) > LONGEST_NAME
            or printable(name) != name
            or set(name) & MARKUP
        ):
            raise RecordError(
                f"{path}: {printable(str(name))[:LONGEST_NAME]!r} is no name of an interface, a load, a dof or a part"
            )
    for warning in superelement.warnings:
        if not isinstance(warning, str) or printable(warning) != warning:
            raise RecordError(
                f"{path}: a warning holds control characters: {printable(str(warning))[:LONGEST_NAME]!r}"
            )


def _check_meaning(path: str, superelement: Superelement) -> None:
    """Refuse numbers that contradict each other: what coupling and errors are computed from must
    belong together.
    """
    single = {
        "cutoff_hz": superelement.cutoff_hz,
        "mass_kg": superelement.mass_kg,
        "residual": superelement.residual,
        "full_dofs": float(superelement.full_dofs),
    }
    for name, value in single.items():
        if not value >= 0.0 or (np.isinf(value) and name != "cutoff_hz"):
            raise RecordError(f"{path}: {name} is {value}; it must be a number of at least zero")
    errors = superelement.errors
    least = 0.0 if errors.corrected else 1.0
    if not least <= errors.mesh_safety < np.inf:
        raise RecordError(
            f"{path}: mesh_safety is {errors.mesh_safety}; it must be a number of at least {least:g}"
        )
    if not all(0.0 <= share < np.inf for share in errors.mesh_truth):
        raise RecordError(
            f"{path}: mesh_truth is {errors.mesh_truth}; it must be two numbers of at least zero"
        )
    scale = dof_scale(superelement)
    if errors.missing_energy is not None:
        _check_semidefinite(path, "missing_energy", errors.missing_energy, scale)
    truncation = errors.truncation
    if truncation is not None:
        if not truncation.limit > 0.0:
            raise RecordError(
                f"{path}: truncation/limit is {truncation.limit}; it must be above zero"
            )
        scale = scale[: superelement.boundary_size]
        _check_semidefinite(path, "truncation/first", truncation.first, scale)
        _check_semidefinite(path, "truncation/second", truncation.second, scale)
        # p p^T / omega^4 is at most p p^T / omega^2 over the lowest omega^2
        rest = truncation.first / truncation.limit - truncation.second
        if _lowest_share(rest, truncation.second, scale) < -CONSISTENCY:
            raise RecordError(
                f"{path}: truncation/second is larger than truncation/first allows above its limit"
            )
    _check_frequencies(path, superelement)
    _check_rails(path, superelement)
    _check_places(path, superelement)


def _check_frequencies(path: str, superelement: Superelement) -> None:
    """The frequencies of the modal dofs must be those of their stiffness and mass."""
    modal = slice(superelement.boundary_size, None)
    stated = np.sort(superelement.modal_frequencies_hz)
    if not stated.size:
        return
    try:
        eigenvalues = scipy.linalg.eigh(
            superelement.stiffness[modal, modal], superelement.mass[modal, modal], eigvals_only=True
        )
    except (ValueError, np.linalg.LinAlgError) as error:
        raise RecordError(f"{path}: the mass of its modal dofs is not positive: {error}") from error
    computed = np.sqrt(np.maximum(eigenvalues, 0.0)) / (2.0 * np.pi)
    worst = int(np.argmax(np.abs(computed - stated) / np.maximum(stated, np.finfo(float).tiny)))
    if not abs(computed[worst] - stated[worst]) <= CONSISTENCY * stated[worst]:
        raise RecordError(
            f"{path}: modal_frequencies_hz says {stated[worst]:.6g} Hz where stiffness and mass have {computed[worst]:.6g} Hz"
        )


def _check_places(path: str, superelement: Superelement) -> None:
    """Nodes, interfaces and control points must lie within the body."""
    places = {f"node {number}": frame.origin for number, frame in enumerate(superelement.frames)}
    places |= {
        f"interface {name!r}": interface_map.frame.origin
        for name, interface_map in superelement.interface_maps.items()
    }
    for number, control in enumerate(superelement.control_points):
        sound = control.point.shape == (3,) and np.isfinite(control.point).all()
        if control.axis not in AXES or not sound:
            raise RecordError(f"{path}: control point {number} has no place along an axis")
        places[f"control point {number}"] = control.point
    if superelement.recovery is None or not len(superelement.recovery.points):
        return
    points = superelement.recovery.points
    low, high = points.min(axis=0), points.max(axis=0)
    # a beam of segments is drawn as a line: its interfaces lie up to its length beside it
    outside = float(np.linalg.norm(high - low)) * (CONSISTENCY if superelement.modal_count else 1.0)
    for name, point in places.items():
        if (point < low - outside).any() or (point > high + outside).any():
            raise RecordError(
                f"{path}: {name} lies outside the body, at {np.round(point, 6).tolist()} m"
            )


def _check_rails(path: str, superelement: Superelement) -> None:
    """Rails must be rails."""
    for name, rail in superelement.rails.items():
        finite = np.isfinite([rail.low, rail.high, rail.blur, *rail.knots]).all()
        if rail.axis not in AXES or not (finite and rail.low < rail.high and rail.blur >= 0.0):
            raise RecordError(f"{path}: rail {name!r} has no ends along an axis")
        if (np.diff(rail.knots) < 0.0).any():
            raise RecordError(f"{path}: the knots of rail {name!r} do not rise")


def _check_semidefinite(path: str, name: str, matrix: FloatArray, scale: FloatArray) -> None:
    if (np.abs(matrix - matrix.T) > CONSISTENCY * float(np.abs(matrix).max(initial=0.0))).any():
        raise RecordError(f"{path}: {name} is not symmetric")
    lowest = _lowest_share(matrix, matrix, scale)
    if lowest < -CONSISTENCY:
        raise RecordError(
            f"{path}: {name} has a negative direction, {lowest:.2g} of its largest entry; errors cannot be negative"
        )


def _lowest_share(matrix: FloatArray, size: FloatArray, scale: FloatArray) -> float:
    """Lowest eigenvalue of a matrix over the largest entry of another one, both scaled so that
    every dof is a length.
    """
    largest = float(np.abs(size * scale * scale[:, None]).max(initial=0.0))
    scaled = 0.5 * (matrix + matrix.T) * scale * scale[:, None]
    return float(np.linalg.eigvalsh(scaled)[0]) / largest if largest > 0.0 else 0.0


def _check_shapes(path: str, superelement: Superelement) -> None:
    """Refuse arrays whose shapes do not fit the labels, or that hold what is no number."""
    size, nodes = len(superelement.labels), len(superelement.frames)
    for name, (array, shape) in _list_arrays(superelement).items():
        if array is not None and array.shape != shape:
            raise RecordError(
                f"{path}: {name} has shape {array.shape}, {shape} fits its {size} labels"
            )
        if array is not None and not np.isfinite(array).all():
            raise RecordError(f"{path}: {name} holds values that are not finite")
    for name, interface_map in superelement.interface_maps.items():
        if not 0 <= interface_map.node < nodes:
            raise RecordError(
                f"{path}: interface {name!r} sits on node {interface_map.node}; there are {nodes}"
            )
        shapes = interface_map.shapes
        if shapes is not None and not _fits(shapes, superelement):
            raise RecordError(
                f"{path}: the deformation shapes of interface {name!r} do not fit its {size} labels"
            )


def _list_arrays(
    superelement: Superelement,
) -> dict[str, tuple[FloatArray | None, tuple[int, ...]]]:
    """Return the arrays of a superelement by name, and the shape that fits its labels."""
    size, boundary = len(superelement.labels), superelement.boundary_size
    recovery = superelement.recovery
    errors = superelement.errors
    truncation = superelement.errors.truncation
    points = 0 if recovery is None else len(recovery.points)
    arrays: dict[str, tuple[FloatArray | None, tuple[int, ...]]] = {
        name: (getattr(holder, name), (size, size))
        for holder, names in ((superelement, MATRICES), (errors, ERROR_MATRICES))
        for name in names
    }
    arrays |= {
        "constraints": (superelement.constraints, (len(superelement.constraints), size)),
        "modal_frequencies_hz": (superelement.modal_frequencies_hz, (size - boundary,)),
        "center_of_mass": (superelement.center_of_mass, (3,)),
        "inertia": (superelement.inertia, (3, 3)),
    }
    if recovery is not None:
        arrays["recovery/points"] = recovery.points, (points, 3)
        arrays["recovery/basis"] = recovery.basis, (3 * points, size)
    if truncation is not None:
        arrays["truncation/first"] = truncation.first, (boundary, boundary)
        arrays["truncation/second"] = truncation.second, (boundary, boundary)
    for name, load in superelement.loads.items():
        arrays[f"loads/{name}"] = load.vector, (size,)
        arrays[f"loads/{name}/missing"] = load.missing, (size,)
        arrays[f"loads/{name}/particular"] = load.particular, (3 * points,)
    for name, rail in superelement.rails.items():
        controlled = CONTROL_POINT_DOFS * (len(rail.knots) - DEGREE - 1)
        arrays[f"rails/{name}/control"] = rail.control, (controlled, size)
        arrays[f"rails/{name}/center"] = rail.center, (3,)
    return arrays


def _fits(shapes: PatchShapes, superelement: Superelement) -> bool:
    """Return whether deformation shapes are those of a patch, and have their dofs."""
    first = superelement.boundary_size - superelement.shape_size
    return (
        shapes.center.shape == (3,)
        and shapes.half_lengths.shape == (2,)
        and bool(np.isfinite([*shapes.center, *shapes.half_lengths]).all())
        and bool((shapes.half_lengths > 0.0).all())
        and shapes.normal in AXES
        and (shapes.hole is None or 0.0 <= shapes.hole < 1.0)
        and 0 <= shapes.count == count_patch_shapes(list_degrees(shapes.outline, shapes.count))
        and first <= shapes.first
        and shapes.first + shapes.count <= superelement.boundary_size
    )

"""Which mesh files are read and written, by their endings, and which files belong to one."""

import mmap
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from headstock.meshing.errors import MeshError

# an XDMF file names its arrays as FILE.h5:/PATH
_HDF5_ENDING = re.compile(rb"(\.(?:h5|hdf5)):", re.IGNORECASE)
_HDF5_STEM = re.compile(rb"[^<>:\"\n]+\Z")
LONGEST_NAME, MOST_FILES = 255, 100


@dataclass(frozen=True)
class MeshFormat:
    """A format of finished meshes.

    Attributes:
        suffixes: Endings of its files, lower case.
        reader: Function that reads it in a worker process, ``MODULE:NAME``.
        written: ``export --mesh`` writes it.
        lines: It is a text of lines, which no reader could take as one.
    """

    name: str
    suffixes: tuple[str, ...]
    reader: str
    written: bool = True
    lines: bool = False


MESH_FORMATS = (
    MeshFormat("gmsh", (".msh",), "headstock.meshing.files.gmsh:read_gmsh"),
    MeshFormat(
        "Abaqus", (".inp",), "headstock.meshing.files.abaqus:read_abaqus", written=False, lines=True
    ),
    MeshFormat(
        "Nastran", (".bdf", ".nas"), "headstock.meshing.files.nastran:read_nastran", lines=True
    ),
    MeshFormat("XDMF", (".xdmf", ".xmf"), "headstock.meshing.files.hdf5:read_xdmf"),
    MeshFormat("MED", (".med",), "headstock.meshing.files.hdf5:read_med"),
    MeshFormat("Exodus", (".exo", ".e", ".ex2"), "headstock.meshing.files.exodus:read_exodus"),
)
MESH_SUFFIXES = tuple(suffix for known in MESH_FORMATS for suffix in known.suffixes)


def find_format(path: Path, *, written: bool = False) -> MeshFormat:
    """Find the format of a mesh file by its ending.

    Args:
        written: Only formats that are written count.

    Raises:
        MeshError: It ends like none of them.
    """
    formats = [one for one in MESH_FORMATS if one.written or not written]
    for one in formats:
        if path.suffix.lower() in one.suffixes:
            return one
    endings = ", ".join(f"{' '.join(one.suffixes)} ({one.name})" for one in formats)
    raise MeshError(f"{path.name}: mesh files end in {endings}")


def list_array_files(path: Path) -> dict[str, NDArray[np.str_]]:
    """Return the ``names`` of the HDF5 files that an XDMF file reads its arrays from.

    Raises:
        MeshError: It names one in another folder, or too many.
    """
    file_names: set[bytes] = set()
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
        # the ending first: looking for whole names takes time quadratic in the length of lines
        for match in _HDF5_ENDING.finditer(text):
            before = text[max(0, match.start() - LONGEST_NAME) : match.start()]
            stem = _HDF5_STEM.search(before)
            file_names |= {(stem[0] + match[1]).strip()} if stem is not None else set()
            if len(file_names) > MOST_FILES:
                raise MeshError(
                    f"{path.name} reads arrays from more than {MOST_FILES} files; write one"
                )
    names = sorted(name.decode(errors="replace") for name in file_names)
    for name in names:
        if "/" in name or "\\" in name or not name.isprintable():
            raise MeshError(
                f"{path.name} reads arrays from {name!r}, which is not beside it; "
                "put the HDF5 file into the same folder and name it without a path"
            )
    return {"names": np.array(names, dtype=np.str_)}

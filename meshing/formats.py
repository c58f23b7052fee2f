"""Which mesh files are read and written, by their endings, and which files belong to one."""

import mmap
import re
from dataclasses import dataclass
from pathlib import Path

from headstock.meshing.errors import MeshError

# an XDMF file names its arrays as FILE.h5:/PATH
_HDF5_NAME = re.compile(rb"([^<>:\"\n]{1,255}\.(?:h5|hdf5)):", re.IGNORECASE)


@dataclass(frozen=True)
class MeshFormat:
    """A format of finished meshes.

    Attributes:
        name: As users know it.
        suffixes: Endings of its files, lower case.
        worker: Module whose worker process reads it.
        written: ``export --mesh`` writes it.
    """

    name: str
    suffixes: tuple[str, ...]
    worker: str
    written: bool = True


MESH_FORMATS = (
    MeshFormat("gmsh", (".msh",), "headstock.meshing.cad.worker"),
    MeshFormat("Abaqus", (".inp",), "headstock.meshing.files.foreign", written=False),
    MeshFormat("Nastran", (".bdf", ".nas"), "headstock.meshing.files.foreign"),
    MeshFormat("XDMF", (".xdmf", ".xmf"), "headstock.meshing.files.hdf5"),
    MeshFormat("MED", (".med",), "headstock.meshing.files.hdf5"),
    MeshFormat("Exodus", (".exo", ".e", ".ex2"), "headstock.meshing.files.exodus"),
)
MESH_SUFFIXES = tuple(suffix for known in MESH_FORMATS for suffix in known.suffixes)


def find_format(path: Path, *, written: bool = False) -> MeshFormat:
    """The format of a mesh file by its ending.

    Args:
        path: Of the file.
        written: Only formats that are written count.

    Raises:
        MeshError: It ends like none of them.
    """
    known = [one for one in MESH_FORMATS if one.written or not written]
    for one in known:
        if path.suffix.lower() in one.suffixes:
            return one
    endings = ", ".join(f"{' '.join(one.suffixes)} ({one.name})" for one in known)
    raise MeshError(f"{path.name}: mesh files end in {endings}")


def files_beside(path: Path) -> tuple[str, ...]:
    """Names of the HDF5 files that an XDMF file reads its arrays from; none for other formats.

    Raises:
        MeshError: It names one in another folder.
    """
    if find_format(path).name != "XDMF" or not path.stat().st_size:
        return ()
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
        found = {match.group(1).strip() for match in _HDF5_NAME.finditer(text)}
    names = sorted(name.decode(errors="replace") for name in found)
    for name in names:
        if "/" in name or "\\" in name or not name.isprintable():
            raise MeshError(
                f"{path.name} reads arrays from {name!r}, which is not beside it; "
                "put the HDF5 file into the same folder and name it without a path"
            )
    return tuple(names)

"""Files of element sizes from place to place: views of gmsh (``.pos``), which it takes as background
meshes, too.
"""

import re
from pathlib import Path

import numpy as np

from headstock.geometry.parts.size_field import DECIMALS, DIGITS, SizeField
from headstock.meshing.errors import MeshError

SUFFIX = ".pos"
# a scalar tetrahedron: twelve coordinates of its corners, a value at each
_TET = re.compile(r"\bSS\s*\(([^()]*)\)\s*\{([^{}]*)\}")
VALUES = 16


def encode_sizes(field: SizeField) -> bytes:
    """Sizes as a view of scalar tetrahedra, in metres."""
    rows = np.hstack([field.points[field.tets].reshape(-1, 12), field.sizes[field.tets]])
    lines = [
        f"SS({','.join(f'{value:.{DECIMALS}f}' for value in row[:12])})"
        f"{{{','.join(f'{value:.{DIGITS}g}' for value in row[12:])}}};"
        for row in rows
    ]
    return "\n".join(['View "element sizes [m]" {', *lines, "};", ""]).encode()


def read_sizes(path: Path) -> SizeField:
    """Sizes from a view of scalar tetrahedra, in metres.

    Raises:
        MeshError: The file holds no such view, or sizes that are not above zero.
    """
    try:
        found = _TET.findall(path.read_text(encoding="utf-8"))
        rows = np.array(
            [[*map(float, f"{places},{values}".split(","))] for places, values in found]
        )
    except (OSError, ValueError) as error:
        raise MeshError(f"{path.name} cannot be read: {error}") from error
    if rows.ndim != 2 or rows.shape[1] != VALUES:
        raise MeshError(
            f"{path.name} holds no view of scalar tetrahedra; write SS(x,y,z,...){{s1,s2,s3,s4}}; for each, in metres"
        )
    sizes = rows[:, 12:].ravel()
    if not (np.isfinite(rows).all() and (sizes > 0.0).all()):
        raise MeshError(f"{path.name}: element sizes must be finite and above zero")
    corners, first, tets = np.unique(
        rows[:, :12].reshape(-1, 3), axis=0, return_index=True, return_inverse=True
    )
    return SizeField(corners, tets.reshape(-1, 4), sizes[first])

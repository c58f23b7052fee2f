"""Files of element sizes from place to place: views of gmsh (``.pos``), which it takes as background
meshes, too.
"""

import math
import re
from array import array
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.parts.size_field import DECIMALS, DIGITS, SizeField
from headstock.meshing.errors import MeshError

SUFFIX = ".pos"
# a scalar tetrahedron: twelve coordinates of its corners, a value at each
_TET = re.compile(r"\bSS\s*\(([^()]*)\)\s*\{([^{}]*)\}")
VALUES = 16


def encode_sizes(field: SizeField) -> bytes:
    """Return the sizes as a view of scalar tetrahedra, in metres."""
    rows = np.hstack([field.points[field.tets].reshape(-1, 12), field.sizes[field.tets]])
    lines = [
        f"SS({','.join(f'{value:.{DECIMALS}f}' for value in row[:12])})"
        f"{{{','.join(f'{value:.{DIGITS}g}' for value in row[12:])}}};"
        for row in rows
    ]
    return "\n".join(['View "element sizes [m]" {', *lines, "};", ""]).encode()


def parse_sizes(path: Path) -> dict[str, NDArray[Any]]:
    """Return ``points``, ``tets`` and ``sizes`` of a `SizeField` from a view of scalar tetrahedra,
    in metres.

    Raises:
        MeshError: The file holds no such view, or sizes that are not above zero.
    """
    numbers = array("d")
    try:
        for match in _TET.finditer(path.read_text(encoding="utf-8")):
            row = [*map(float, f"{match[1]},{match[2]}".split(","))]
            numbers.extend(row if len(row) == VALUES else [math.nan] * VALUES)
    except (OSError, ValueError) as error:
        raise MeshError(f"{path.name} cannot be read: {error}") from error
    rows = np.array(numbers).reshape(-1, VALUES)
    if not len(rows) or np.isnan(rows).all(axis=1).any():
        raise MeshError(
            f"{path.name} holds no view of scalar tetrahedra; write SS(x,y,z,...){{s1,s2,s3,s4}}; for each, in metres"
        )
    sizes = rows[:, 12:].ravel()
    if not (np.isfinite(rows).all() and (sizes > 0.0).all()):
        raise MeshError(f"{path.name}: element sizes must be finite and above zero")
    corners, first, tets = np.unique(
        rows[:, :12].reshape(-1, 3), axis=0, return_index=True, return_inverse=True
    )
    return {"points": corners, "tets": tets.reshape(-1, 4), "sizes": sizes[first]}

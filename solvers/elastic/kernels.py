"""Names of the compiled kernels of finite elements, and where they are kept: what stands there is
known without loading the compiler.
"""

import functools
import os
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Literal

from headstock.meshing.component_mesh import CellKind

KernelPart = Literal["stiffness", "mass", "corners"]


def kernel_name(part: KernelPart, kind: CellKind, *, straight: bool) -> str:
    """Return the name of what computes one matrix of a cell.

    Args:
        part: Of the operators: stiffness, mass, or stiffness of the corners alone.
    """
    if part == "corners" and kind in ("tet4", "hex8"):
        part = "stiffness"  # it has no other nodes
    return f"{part}-{kind}" if straight else f"{part}-{kind}-curved"


def form_cache_folder() -> Path:
    """Return ``headstock/forms`` in the user's cache folder."""
    cache = os.environ.get("XDG_CACHE_HOME")
    return (Path(cache) if cache else Path.home() / ".cache") / "headstock" / "forms"


def kernel_link(name: str) -> Path:
    """Return a link in the cache folder that leads to the compiled kernel of a name, of this FFCx;
    it is missing, or leads nowhere, where the kernel is still to be compiled.
    """
    return form_cache_folder() / f"{name}.ffcx-{_compiler_version()}"


@functools.cache
def _compiler_version() -> str:
    try:
        return version("fenics-ffcx")
    except PackageNotFoundError:
        return "unknown"

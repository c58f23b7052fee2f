"""STEP parts that tests build themselves."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

import gmsh


@contextlib.contextmanager
def gmsh_session() -> Iterator[None]:
    gmsh.initialize(interruptible=False, readConfigFiles=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("General.NumThreads", 1)
    try:
        yield
    finally:
        gmsh.finalize()


@contextlib.contextmanager
def built_part(path: Path) -> Iterator[None]:
    """What the body builds with `gmsh.model.occ` [mm] is written to a STEP file."""
    with gmsh_session():
        yield
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))

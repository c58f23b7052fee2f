"""Seconds of generating and compiling each kernel of finite elements, beside those that ``plan``
foresees; nothing is taken from the cache.

    ./headstock exec python3 benchmarks/kernels.py
"""

import os
import resource
import sys
import tempfile
from itertools import product
from typing import Any

import ufl
from dolfinx import fem
from mpi4py import MPI

from headstock.geometry.parts.components import Component, Interface, Material, MeshSettings, Patch
from headstock.geometry.parts.solids import Box, Tube
from headstock.meshing.components.meshing import mesh_component
from headstock.pipeline.planning.budgets import KERNEL_SECONDS
from headstock.solvers.elastic import elasticity
from headstock.solvers.elastic.form_cache import compile_form

STEEL = Material("steel", 210e9, 0.3, 7850.0)
BLOCK, TUBE = Box((0.1, 0.1, 0.1)), Tube(0.1, 0.06, 0.2)


def processor_seconds() -> float:
    """Of this process and its children that have ended [s]."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def compile_timed(form: ufl.Form, comm: MPI.Comm, name: str) -> fem.Form:
    """As ``compile_form``, with a line of what it took."""
    start = processor_seconds()
    compiled = compile_form(form, comm, name)
    took = processor_seconds() - start
    print(f"{name:24s} CPU s {KERNEL_SECONDS[name]:5.2f} / {took:5.2f}", flush=True)
    return compiled


def measure_kernels() -> None:
    """Assemble a coarse mesh of each kind in an empty cache."""
    patched: Any = elasticity
    patched.compile_form = compile_timed
    solids = [(BLOCK, *each) for each in product(("tet", "hex"), (1, 2))] + [(TUBE, "tet", 2)]
    for solid, cells, order in solids:
        foot = {"foot": Interface("foot", (Patch("z-"),))}
        settings = MeshSettings(size=0.05, cells=cells, order=order)  # type: ignore[arg-type]
        mesh = mesh_component(Component("part", solid, STEEL, interfaces=foot, mesh=settings))
        elasticity.assemble_elasticity(
            mesh, STEEL, comm=MPI.COMM_SELF, with_mass=True, with_corners=order == 2
        )


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder
        print(f"{sys.argv[0]}: planned / real", flush=True)
        measure_kernels()

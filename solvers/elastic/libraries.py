"""dolfinx, PETSc and SLEPc, which are loaded together when something of them is first used."""

from typing import TYPE_CHECKING

from headstock.geometry.loading import Library

if TYPE_CHECKING:
    import dolfinx as dolfinx
    import ufl as ufl
    from dolfinx import fem as fem
    from dolfinx import la as la
    from ffcx import options
    from petsc4py import PETSc as PETSc
    from slepc4py import SLEPc as SLEPc

    ffcx_options = options
else:
    dolfinx = Library("dolfinx")
    fem = Library("dolfinx.fem")
    ffcx_options = Library("ffcx.options")
    la = Library("dolfinx.la")
    PETSc = Library("petsc4py.PETSc")
    SLEPc = Library("slepc4py.SLEPc")
    ufl = Library("ufl")

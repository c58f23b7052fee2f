"""Elasticity operators, factorisations, eigenproblems and the analyses of any second-order system (the only users of dolfinx, PETSc and SLEPc)."""

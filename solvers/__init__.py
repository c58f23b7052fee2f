"""Mathematics of systems: finite elements, responses, control, paths, mechanisms, milling; the only
users of dolfinx, PETSc and SLEPc.

Never scenes, superelements or files of results.
"""

"""Names of the forms in which bodies and machines leave for other programs."""

BODIES = ("h5", "op4", "dmig", "abaqus", "calculix", "mtx")
FMUS = {"fmu3": 3, "fmu2": 2}
ENDINGS = {"mat": ".mat", "npz": ".npz", **dict.fromkeys(FMUS, ".fmu")}
MACHINES = tuple(ENDINGS)

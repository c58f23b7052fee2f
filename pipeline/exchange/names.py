"""Names of the forms in which bodies and machines leave for other programs."""

BODIES = {
    "h5": "Headstock's own file",
    "op4": "Nastran OUTPUT4, with the points as bulk data",
    "dmig": "Nastran bulk data with DMIG",
    "abaqus": "Abaqus matrices",
    "calculix": "CalculiX matrices",
    "mtx": "Matrix Market",
}
MACHINES = {
    "mat": "state space for MATLAB",
    "npz": "state space for NumPy",
    "fmu3": "FMI 3.0 co-simulation",
    "fmu2": "FMI 2.0 co-simulation",
}
FMUS = {"fmu2": 2, "fmu3": 3}
ENDINGS = {"mat": ".mat", "npz": ".npz", "fmu2": ".fmu", "fmu3": ".fmu"}

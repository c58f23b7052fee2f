"""Cutting coefficients of work materials, with their source; linear chip and edge model of :mod:`headstock.solvers.milling.forces`."""

from headstock.solvers.milling.forces import CuttingCoefficients

_TABLE = "table 5 of doi 10.1186/s10033-021-00536-9 (Chin. J. Mech. Eng. 2021); edge terms printed in N mm, taken as N/mm"

# axial terms are zero where the table gives none
CUTTING_MATERIALS: dict[str, CuttingCoefficients] = {
    "al7075-t6": CuttingCoefficients((600.46e6, 180.96e6, 0.0), (17.9e3, 20.42e3, 0.0), _TABLE),
    "al7075-t6-dry": CuttingCoefficients((767.01e6, 168.8e6, 222e6), (27.7e3, 26.6e3, 0.7e3), _TABLE),
    "al6061-t6": CuttingCoefficients((243.77e6, 113.5e6, 0.0), (7.53e3, 7.83e3, 0.0), _TABLE),
}

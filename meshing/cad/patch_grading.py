"""Element sizes around imprinted patches: small at their rims, growing with the distance from them."""

from collections.abc import Mapping

import gmsh

from headstock.meshing.sizing import count_rim_cells

RIM_SAMPLES = 200  # points of a curve from which distances are taken


def add_grading_fields(rims: Mapping[int, float], *, growth: float, size: float) -> list[int]:
    """Tell gmsh to let elements grow from curves, and return the tags of its fields.

    Where stresses are singular, as at the rim of a rigid patch, the error of an element of size ``h = growth * distance`` is the same
    at any distance, so that the number of elements grows with the inverse of the smallest size only.

    Args:
        rims: Element size at each curve.
        growth: Share of the distance from the curve that is added to it.
        size: Element size far away.

    Source: Babuska, Kellogg and Pitkaranta (1979), Numer. Math. 33, 447-471, graded meshes at singular corners.
    """
    sizes = sorted({smallest for smallest in rims.values() if smallest < size})
    return [_add_grading(sorted(curve for curve in rims if rims[curve] == smallest), smallest, growth, size) for smallest in sizes]


def count_graded_cells(rims: Mapping[int, float], *, growth: float, size: float) -> int:
    """Number of cells that growing from curves adds, roughly; of each curve the element size there."""
    length = gmsh.model.occ.getMass
    return int(sum(count_rim_cells(float(length(1, curve)), s, growth=growth, size=size) for curve, s in rims.items()))


def _add_grading(curves: list[int], smallest: float, growth: float, size: float) -> int:
    fields = gmsh.model.mesh.field
    distance = int(fields.add("Distance"))
    fields.setNumbers(distance, "CurvesList", curves)
    fields.setNumber(distance, "Sampling", RIM_SAMPLES)
    grown = int(fields.add("Threshold"))
    fields.setNumber(grown, "InField", distance)
    fields.setNumber(grown, "SizeMin", smallest)
    fields.setNumber(grown, "SizeMax", size)
    fields.setNumber(grown, "DistMin", 0.0)
    fields.setNumber(grown, "DistMax", (size - smallest) / growth)
    return grown

"""How well different sets of rail dofs show a carriage's local compliance, by error and ripple
against their number.
"""

import dataclasses
from collections.abc import Callable, Iterator

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Component, Interface, Material, Patch, RailSettings
from headstock.geometry.parts.solids import Box
from headstock.meshing.elements.surface import extract_surface
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.rails import Rail, carriage_rows, place_knots
from headstock.reduction.requests import ReductionRequest
from headstock.solvers.mpi import MPI
from headstock.validation.parts.structured_meshes import lattice_mesh, straight_lattice
from headstock.validation.references.rows import ValidationRow, compare_bound, show

SPAN, CARRIAGE, FINE = 0.4, 0.1, 32  # the finest rail has eight intervals per carriage length
PLACES = np.linspace(0.15, 0.25, 81)
STATION_COUNTS = (11, 13, 15, 19)  # 2, 2.5, 3 and 4 intervals per carriage length
# of the normal compliance under a carriage alone: a tenth at most of that of carriage and rail
# together, and a frequency changes by half of what a stiffness does, so that this is 0.05 % of a
# frequency
RIPPLE = 1e-2

Rows = Callable[[float], FloatArray]


def check_rail_bases() -> Iterator[ValidationRow]:
    """Splines with and without averaging, polynomials and interpolated frames, all compared with
    eight intervals per length.
    """
    rail, flexibility = _finest_rail()
    bare = dataclasses.replace(rail, blur=0.0)
    right = _local_compliance(lambda place: carriage_rows(bare, place, CARRIAGE), flexibility)
    for control_points in STATION_COUNTS:
        dofs = 4 * control_points
        splines = _coarse_rail(rail, control_points)
        sets = {
            "splines": _ride(splines),
            "splines not averaged": _ride(dataclasses.replace(splines, blur=0.0)),
            "polynomials": _ride_polynomials(bare, control_points),
            "frames between splines": _ride_frames(bare, dofs // 6),
        }
        for name, seen in sets.items():
            yield from _describe(
                f"{name}, {dofs} dofs", _local_compliance(seen, flexibility), right
            )


def _finest_rail() -> tuple[Rail, FloatArray]:
    """Return a rail of 30 mm along a steel bar on a fixed sole, and the compliance of its control
    values.
    """
    mesh = lattice_mesh(straight_lattice((FINE, 8, 4), (SPAN, 0.12, 0.06)), "hex27", straight=True)
    surface = extract_surface(mesh.cells, mesh.kind)
    centers = mesh.points[surface.facets[:, : surface.corners]].mean(axis=1)
    top = (np.abs(centers[:, 2] - 0.06) < 1e-9) & (np.abs(centers[:, 1] - 0.06) < 0.0151)
    sole = np.abs(centers[:, 2]) < 1e-9
    mesh = dataclasses.replace(
        mesh, patches={"rail": surface.facets[top], "sole": surface.facets[sole]}
    )
    interfaces = {
        "sole": Interface("sole", (Patch("z-"),)),
        "rail": Interface("rail", (Patch("z+"),), "average", rail=RailSettings("x", FINE + 3)),
    }
    component = Component(
        "bar",
        Box((SPAN, 0.12, 0.06)),
        Material("steel", 2.1e11, 0.3, 7850.0),
        interfaces=interfaces,
    )
    element = reduce_elastic(
        component, mesh, comm=MPI.COMM_SELF, request=ReductionRequest(recovery=False)
    )
    rail = element.rails["rail"]
    own = dataclasses.replace(rail, control=rail.control[:, element.node_size :])
    return own, np.asarray(
        np.linalg.inv(element.stiffness[element.node_size :, element.node_size :])
    )


def _coarse_rail(rail: Rail, control_points: int) -> Rail:
    """Return the rail fitted with fewer control points: fits of fits are fits, as coarse splines
    with nested knots are fine ones too.
    """
    knots = place_knots(rail.low, rail.high, control_points)
    points, weights = _quadrature(rail)
    coarse = BSpline(knots, np.eye(control_points), 3)(points)
    fine = BSpline(rail.knots, np.eye(FINE + 3), 3)(points)
    fit = np.linalg.solve(
        coarse.T @ (weights[:, None] * coarse), coarse.T @ (weights[:, None] * fine)
    )
    return dataclasses.replace(
        rail,
        knots=knots,
        control=np.kron(fit, np.eye(4)) @ rail.control,
        blur=SPAN / (control_points - 3),
    )


def _ride(rail: Rail) -> Rows:
    return lambda place: carriage_rows(rail, place, CARRIAGE)


def _ride_polynomials(rail: Rail, count: int) -> Rows:
    """Return the even mean and slope of the polynomial of so many terms that fits the rail's motion
    best.
    """
    points, weights = _quadrature(rail)
    middle, half = 0.5 * (rail.low + rail.high), 0.5 * (rail.high - rail.low)
    terms = np.polynomial.legendre.legvander((points - middle) / half, count - 1)
    fine = BSpline(rail.knots, np.eye(FINE + 3), 3)(points)
    fit = np.linalg.solve(terms.T @ (weights[:, None] * terms), terms.T @ (weights[:, None] * fine))
    # a spline on the finest knots that takes the polynomial's values: as good as the polynomial at
    # this count
    sites = np.linspace(rail.low, rail.high, 8 * FINE)
    back = make_interp_spline(
        sites, np.polynomial.legendre.legvander((sites - middle) / half, count - 1) @ fit, k=3
    )
    return _ride(
        dataclasses.replace(rail, knots=back.t, control=np.kron(back.c, np.eye(4)) @ rail.control)
    )


def _ride_frames(rail: Rail, count: int) -> Rows:
    """Averaging interfaces of the carriage's length at fixed places, six dofs each, a cubic spline
    between them.
    """
    sites = np.linspace(rail.low + 0.5 * CARRIAGE, rail.high - 0.5 * CARRIAGE, count)
    frames = np.array([carriage_rows(rail, float(site), CARRIAGE) for site in sites])
    spline = make_interp_spline(sites, frames, k=3)
    return lambda place: np.asarray(spline(place))


def _local_compliance(seen: Rows, flexibility: FloatArray) -> FloatArray:
    """Compliance ``(places, 2)`` of the normal motion [m/N] and of the pitch [rad/(N m)] of a
    carriage at every place.
    """
    rows = np.array([seen(float(place))[[2, 4]] for place in PLACES])
    return np.einsum("pin,nm,pim->pi", rows, flexibility, rows)


def _describe(name: str, found: FloatArray, right: FloatArray) -> Iterator[ValidationRow]:
    smooth = np.polynomial.chebyshev.chebvander((PLACES - 0.2) / 0.05, 4)
    rest = np.abs(found - smooth @ np.linalg.lstsq(smooth, found, rcond=None)[0]).max(
        axis=0
    ) / found.mean(axis=0)
    error = found.mean(axis=0) / right.mean(axis=0) - 1.0
    for index, what in enumerate(("normal", "pitch")):
        yield show(f"{name}: {what}, error", 100.0 * float(error[index]), "%")
        if name.startswith("splines,") and what == "normal":
            yield compare_bound(f"{name}: {what}, ripple", rest[index], RIPPLE)
        else:
            yield show(f"{name}: {what}, ripple", 100.0 * float(rest[index]), "%")


def _quadrature(rail: Rail) -> tuple[FloatArray, FloatArray]:
    nodes, weights = np.polynomial.legendre.leggauss(6)
    edges = np.linspace(rail.low, rail.high, 16 * FINE + 1)
    middle, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
    return np.asarray((middle[:, None] + half[:, None] * nodes).ravel()), np.asarray(
        (half[:, None] * weights).ravel()
    )

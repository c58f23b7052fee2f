"""A bar as rigid segments in a row, coupled by six-dof beam springs: the elastic body of the Axis
Construction Kit.
"""

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import cast

import numpy as np

from headstock.geometry.frames import DOF_NAMES, FloatArray, rigid_transfer
from headstock.geometry.machine.carriages import DEGREE
from headstock.geometry.machine.machine import Sensor
from headstock.geometry.parts.components import Component, Load
from headstock.geometry.parts.mass_properties import SolidProperties
from headstock.geometry.parts.patches import PlanarSolid
from headstock.geometry.parts.prismatic_bars import prismatic_bar
from headstock.geometry.parts.skins import Skin, prism_skin
from headstock.geometry.parts.solids import Solid, Tube
from headstock.reduction.components.segment_chain import (
    SegmentedBar,
    attach_interfaces,
    chain_stiffness,
    section_motion,
    segment_mass,
    surface_motion,
    traction_load,
)
from headstock.reduction.rails import Rail, control_point_motion, evaluate_splines, lay_out_rail
from headstock.reduction.superelement import Recovery, SensorRows, StaticLoad, Superelement
from headstock.reduction.superelement_checks import check_superelement
from headstock.solvers.errors import ModelError

# pictures show a bend smoothly from about so many slices on
FEWEST_SLICES = 16


def reduce_segmented(
    component: Component,
    properties: SolidProperties,
    loads: Sequence[Load] = (),
    sensors: Sequence[Sensor] = (),
) -> Superelement:
    """Reduce a component to a row of rigid segments with six dofs each.

    Neighbours are coupled by the exact stiffness of the beam between their centres, an interface on
    an end face by that of half a segment. Under a rigid interface the bar is rigid from edge to
    edge of the patch, wherever the segments' borders lie; an averaging interface takes the best fit
    of its surface's motion. Loads at interfaces are therefore answered as by the beam itself with
    any number of segments, and only the mass is lumped.

    Args:
        component: Its solid must be a bar of one section; ``mass`` scales its density when given.
        properties: Volume, centre and interface centroids of its solid.
        loads: Body loads and tractions become one unit load per component axis, as in
            ``reduce_rigid``.
        sensors: On this component; each moves with its section.

    Raises:
        ModelError: The solid is no bar of one section, or a load cannot act on segments.
        AccuracyError: The superelement fails its own check.

    Source: Kono, Lorenzer, Weikert and Wegener, section 2.2 (segmented bodies coupled with each
    other).
    """
    try:
        bar = dataclasses.replace(
            prismatic_bar(component.solid, component.segments.along),
            bending_factor=component.segments.bending,
            torsion_factor=component.segments.torsion,
        )
        row = attach_interfaces(
            component, cast(PlanarSolid | Tube, component.solid), bar, properties
        )
    except ValueError as error:
        raise ModelError(
            f'component {component.name!r} cannot be segmented: {error}; or write fidelity = "elastic"'
        ) from error
    density = (
        component.material.density
        if component.mass is None
        else component.mass / (bar.area * bar.length)
    )
    mass = _row_mass(row, density)
    motions = np.vstack([rigid_transfer(bar.center, frame.origin) for frame in row.frames])
    whole = motions.T @ mass @ motions
    points = segment_skin(component).points
    superelement = Superelement(
        name=component.name,
        labels=tuple((name, dof) for name in row.names for dof in DOF_NAMES),
        frames=row.frames,
        interface_maps=row.interface_maps,
        stiffness=_over_all_nodes(row, _over_all_nodes(row, chain_stiffness(row.chain)).T),
        mass=mass,
        recovery=Recovery(basis=_motion_at(row, points), points=points),
        constraints=row.constraints,
        modal_frequencies_hz=np.zeros(0),
        cutoff_hz=np.inf,
        full_dofs=6 * row.chain.count,
        mass_kg=float(whole[0, 0]),
        center_of_mass=bar.center,
        inertia=0.5 * (whole[3:, 3:] + whole[3:, 3:].T),
        loads=_row_loads(row, component, mass, loads),
        rails={
            name: _fit_rail(
                row,
                lay_out_rail(component, interface, properties.patch_centroids[name]),
                f"{component.name}.{name}",
            )
            for name, interface in component.interfaces.items()
            if interface.rail is not None
        },
        sensors={
            sensor.name: SensorRows(_motion_at(row, np.array([sensor.position])))
            for sensor in sensors
        },
    )
    check_superelement(superelement)
    return superelement


def segment_skin(component: Component) -> Skin:
    """Return the surface of a segmented component, cut across so that it can bend; its points are
    those of the recovery basis.

    Raises:
        ValueError: The solid is no bar of one section.
    """
    bar = prismatic_bar(component.solid, component.segments.along)
    # a whole number of slices per segment, so that each segment shows the same
    slices = component.segments.count * math.ceil(FEWEST_SLICES / component.segments.count)
    return _slice_skin(component.solid, bar.axis, (bar.low, bar.high), slices)


@functools.lru_cache(maxsize=32)
def _slice_skin(solid: Solid, axis: int, ends: tuple[float, float], slices: int) -> Skin:
    """Return the surface of a bar, cut across into slices; models of a body share it."""
    return prism_skin(solid, axis, np.asarray(np.linspace(*ends, slices + 1), dtype=float))


def _fit_rail(row: SegmentedBar, rail: Rail, name: str) -> Rail:
    """Return a rail along the bar: a cubic spline through the motion of the beam at the segments'
    centres and borders.
    """
    bar = row.chain.bar
    if rail.axis != bar.axis:
        along = "xyz"[rail.axis]
        raise ModelError(
            f'rail {name} runs along {along}, across its segments; write segments = {{ along = "{along}" }}'
        )
    count = max(2 * row.chain.count + 1, DEGREE + 1)
    sites = np.linspace(bar.low, bar.high, count, dtype=np.float64)
    motions = []
    for site in sites:
        center, point = np.array(bar.center), np.array(rail.center)
        center[bar.axis] = point[bar.axis] = site
        motions.append(
            control_point_motion(point, bar.axis, center) @ section_motion(row.chain, float(site))
        )
    values = _over_all_nodes(row, np.vstack(motions).T).T
    # without knots next to the ends: "not a knot"
    knots = np.concatenate([[bar.low] * (DEGREE + 1), sites[2:-2], [bar.high] * (DEGREE + 1)])
    solved = np.linalg.solve(evaluate_splines(knots, sites), values.reshape(len(sites), -1))
    control = np.asarray(solved.reshape(len(values), -1), dtype=np.float64)
    return dataclasses.replace(rail, knots=knots, control=control)


def _row_mass(row: SegmentedBar, density: float) -> FloatArray:
    chain = row.chain
    carried = np.diag([1.0] * chain.count + [0.0] * (len(row.frames) - chain.count))
    return np.asarray(
        np.kron(carried, segment_mass(chain.bar, density, chain.bar.length / chain.count)),
        dtype=np.float64,
    )


def _over_all_nodes(row: SegmentedBar, values: FloatArray) -> FloatArray:
    """Return the rows for the chain's dofs, and zero rows for those of averaging interfaces."""
    return np.vstack([values, np.zeros((6 * len(row.frames) - len(values), values.shape[1]))])


def _motion_at(row: SegmentedBar, points: FloatArray) -> FloatArray:
    """Return the displacement ``(3 k, n)`` of points ``(k, 3)`` of the bar per dof."""
    return _over_all_nodes(row, surface_motion(row.chain, points).T).T


def _row_loads(
    row: SegmentedBar, component: Component, mass: FloatArray, loads: Sequence[Load]
) -> dict[str, StaticLoad]:
    """Return the unit loads along each component axis: body loads by mass, tractions by the motion
    of the surface under them.
    """
    unit_loads: dict[str, StaticLoad] = {}
    for load in loads:
        if load.component != component.name or load.kind == "force":
            continue
        if load.kind == "body":
            unit = mass @ np.tile(np.eye(6, 3), (len(row.frames), 1))
        elif load.kind == "traction":
            unit = _over_all_nodes(row, traction_load(row.chain, row.solid, load.patches))
        else:
            raise ModelError(
                f"load {load.name!r}: {load.kind} cannot act on the segmented component {component.name!r}; "
                "write a traction, a force at one of its interfaces, or make the component elastic"
            )
        unit_loads |= {
            f"{load.name}:{axis}": StaticLoad(unit[:, i]) for i, axis in enumerate("xyz")
        }
    return unit_loads

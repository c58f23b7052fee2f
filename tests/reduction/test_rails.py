"""A carriage anywhere on a rail sees the motion of what is under it, on every kind of component."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline, make_interp_spline

from common import STEEL, Dense, approx, make_box, make_faced
from headstock.geometry.frames import FloatArray, Frame, rigid_transfer, rotation_about
from headstock.geometry.machine.joints import Axis, Joint, JointEnd
from headstock.geometry.machine.machine import Machine, Point, Pose
from headstock.geometry.parts.components import (
    Component,
    Fidelity,
    Interface,
    Patch,
    RailSettings,
    SegmentSettings,
)
from headstock.geometry.parts.solids import Box, Tube
from headstock.meshing.component_mesh import ComponentMesh, IntArray
from headstock.reduction.components.interface_patches import measure_patch
from headstock.reduction.components.rail_fits import fit_rail
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.rails import (
    Rail,
    carriage_rows,
    control_point_positions,
    evaluate_splines,
    place_knots,
)
from headstock.reduction.superelement import Superelement
from headstock.reduction.superelement_checks import check_superelement, rigid_motions
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.linear.static_response import solve_static
from lumped_machines import reduce_shape
from reduced_parts import reduce_mesh

LENGTH, WIDTH, HEIGHT = 0.6, 0.08, 0.05
CONTROL_POINTS = 9  # 100 mm apart
CARRIAGE = 0.15  # the shortest for them


def rail_interface(control_points: int = CONTROL_POINTS) -> Interface:
    return Interface("rail", (Patch("z+"),), "average", rail=RailSettings("x", control_points))


def bar(fidelity: Fidelity, *, segments: int = 10) -> Component:
    interfaces = {"end": Interface("end", (Patch("x-"),)), "rail": rail_interface()}
    return Component(
        "bar",
        Box((LENGTH, WIDTH, HEIGHT)),
        STEEL,
        interfaces=interfaces,
        fidelity=fidelity,
        segments=SegmentSettings(segments),
    )


@pytest.fixture(scope="module")
def mesh() -> ComponentMesh:
    """A bar from the origin to x = 0.6 whose foot x = 0 is an interface and whose upper side is a
    rail.
    """
    return make_box((6, 2, 1), (LENGTH, WIDTH, HEIGHT), {"end": "x-", "rail": "z+"})


@pytest.fixture(scope="module")
def elastic(mesh: ComponentMesh) -> Superelement:
    return reduce_mesh(bar("elastic"), mesh)


@pytest.fixture(scope="module", params=["rigid", "segmented", "elastic"])
def element(request: pytest.FixtureRequest, elastic: Superelement) -> Superelement:
    return elastic if request.param == "elastic" else reduce_shape(bar(request.param))


@settings(max_examples=25, deadline=None)
@given(share=st.floats(0.0, 1.0), length=st.floats(CARRIAGE, LENGTH))
def test_a_rigid_motion_of_the_body_is_the_same_motion_of_every_carriage(
    element: Superelement, share: float, length: float
) -> None:
    rail = element.rails["rail"]
    place = rail.low + 0.5 * length + share * (rail.high - rail.low - length)
    beside = rail.center.copy()
    beside[0] = place
    found = carriage_rows(rail, place, length) @ rigid_motions(element, np.array([0.1, -0.2, 0.3]))
    np.testing.assert_allclose(
        found, rigid_transfer(np.array([0.1, -0.2, 0.3]), beside), atol=2e-10
    )


def test_a_superelement_with_a_rail_passes_its_check(element: Superelement) -> None:
    check_superelement(element)
    assert set(element.rails) == {"rail"} and "rail" not in element.interface_maps


def test_stations_have_four_dofs_each_and_are_named(elastic: Superelement) -> None:
    assert elastic.labels[6:10] == tuple(("rail[0]", dof) for dof in ("x", "y", "z", "rx"))
    assert elastic.boundary_size == 6 + 4 * CONTROL_POINTS == len(elastic.labels)


@pytest.mark.parametrize("place", [0.08, 0.231, 0.3, 0.5199])
def test_compliance_under_a_carriage_is_that_of_the_whole_mesh_at_any_place(
    mesh: ComponentMesh, elastic: Superelement, dense: Dense, place: float
) -> None:
    """The full mesh under the tractions the carriage makes, with no reduction and no constraint in
    between.
    """
    stiffness, _ = dense.pencil(mesh, STEEL)
    fit = fit_rail("bar", rail_interface(), measure_patch(mesh, "rail"))
    dofs = (3 * fit.patch.nodes[:, None] + np.arange(3)).ravel()
    rows = carriage_rows(
        dataclasses.replace(elastic.rails["rail"], control=np.eye(4 * CONTROL_POINTS)), place, 0.16
    )
    seen = np.zeros((6, 3 * len(mesh.points)))
    seen[:, dofs] = rows @ fit.operator.T
    fixed = np.unique(mesh.patches["end"])
    free = np.setdiff1d(
        np.arange(3 * len(mesh.points)), (3 * fixed[:, None] + np.arange(3)).ravel()
    )
    expected = seen[:, free] @ np.linalg.solve(stiffness[np.ix_(free, free)], seen[:, free].T)

    own = carriage_rows(elastic.rails["rail"], place, 0.16)[:, 6:]
    found = own @ np.linalg.solve(elastic.stiffness[6:, 6:], own.T)
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


def test_what_a_carriage_sees_is_smooth_across_the_control_points() -> None:
    """Third differences of every row are bounded by the third derivative between two control
    points: no jump, no kink.
    """
    rail = Rail(0, np.zeros(3), 0.0, 1.0, place_knots(0.0, 1.0, 8), np.eye(32))
    step = 1e-3
    places = np.arange(0.1, 0.9, step)
    rows = np.array([carriage_rows(rail, float(place), 0.15) for place in places])
    jumps = np.abs(np.diff(rows, 4, axis=0)).max() / step**3
    smooth = np.abs(np.diff(rows, 3, axis=0)).max() / step**3
    assert jumps < 0.05 * smooth


def test_a_carriage_takes_the_mean_and_the_slope_of_the_motion_under_it() -> None:
    """For a motion that is itself a spline, by quadrature over the carriage."""
    knots = place_knots(0.0, 1.0, 8)
    rail = Rail(0, np.zeros(3), 0.0, 1.0, knots, np.eye(32))
    values = np.random.default_rng(3).standard_normal((8, 4))
    place, length = 0.437, 0.21
    nodes, weights = np.polynomial.legendre.leggauss(40)
    # split at the knots, where the spline is not smooth
    edges = np.concatenate(
        [
            [place - length / 2],
            [k for k in knots if abs(k - place) < length / 2],
            [place + length / 2],
        ]
    )
    low, high = edges[:-1, None], edges[1:, None]
    x = (0.5 * (low + high) + 0.5 * (high - low) * nodes).ravel()
    w = (0.5 * (high - low) * weights).ravel()
    motion = BSpline(knots, values, 3)(x)
    found = carriage_rows(rail, place, length) @ values.ravel()
    np.testing.assert_allclose(found[:4], w @ motion / length, rtol=1e-12)
    slope = (w * (x - place)) @ motion / (length**3 / 12.0)
    np.testing.assert_allclose(found[4:], [-slope[2], slope[1]], rtol=1e-10)


def test_averaging_over_the_stations_leaves_the_mean_of_parabolas_and_the_slope_of_cubics(
    elastic: Superelement,
) -> None:
    rail = dataclasses.replace(elastic.rails["rail"], control=np.eye(4 * CONTROL_POINTS))
    middle = 0.5 * (rail.low + rail.high)
    sites = control_point_positions(rail.knots, rail.center, rail.axis)[:, 0]
    values = np.zeros((2, CONTROL_POINTS, 4))
    for number, power in enumerate((2, 3)):
        curve = make_interp_spline(sites, (sites - middle) ** power, t=rail.knots, k=3)
        values[number, :, 1] = curve.c
    parabola, cubic = values.reshape(2, -1) @ carriage_rows(rail, middle + 0.05, 0.2).T
    assert parabola[[1, 5]] == approx([0.05**2 + 0.2**2 / 12.0, 2.0 * 0.05], rel=1e-10)
    assert cubic[5] == approx(3.0 * 0.05**2 + 3.0 * 0.2**2 / 20.0, rel=1e-10)


def cantilever_compliance(reach: float, length: float) -> float:
    """Mean deflection of a cantilever over a carriage under a load of 1 N spread evenly over it
    (Timoshenko 1921).
    """
    area, second, shear = WIDTH * HEIGHT, WIDTH * HEIGHT**3 / 12.0, STEEL.youngs_modulus / 2.6
    # two rules of different order: no node falls on the kink of the Green's function
    (a, wa), (b, wb) = (np.polynomial.legendre.leggauss(count) for count in (40, 41))
    x, y = (reach + 0.5 * length * nodes for nodes in (a[:, None], b[None, :]))
    low, high = np.minimum(x, y), np.maximum(x, y)
    bending = low**2 * (3.0 * high - low) / (6.0 * STEEL.youngs_modulus * second)
    return float(0.25 * wa @ (bending + low / (13.0 / 15.3 * shear * area)) @ wb)


def clamped_flexibility(part: Superelement) -> tuple[IntArray, FloatArray]:
    """The dofs of the nodes but for those of the end, and their flexibility with the end held."""
    node = part.interface_maps["end"].node
    free = np.setdiff1d(np.arange(part.node_size), np.arange(6 * node, 6 * node + 6))
    return free, np.linalg.inv(part.stiffness[np.ix_(free, free)])


def test_a_segmented_bar_bends_under_a_carriage_as_a_cantilever_does() -> None:
    worst = []
    for count in (10, 20, 40):
        part = reduce_shape(bar("segmented", segments=count))
        free, flexibility = clamped_flexibility(part)
        errors = []
        for place in np.linspace(-0.1, 0.24, 15):
            rows = carriage_rows(part.rails["rail"], float(place), 0.1)[:, free]
            errors.append(
                (rows @ flexibility @ rows.T)[2, 2] / cantilever_compliance(place + LENGTH / 2, 0.1)
                - 1.0
            )
        worst.append(np.abs(errors).max())
    assert worst[2] < 2e-4
    assert worst[1] < 0.5 * worst[0] and worst[2] < 0.5 * worst[1]


def sliding_machine(
    fidelity: Fidelity, block: float = CARRIAGE, turn: Frame | None = None
) -> Machine:
    place = turn or Frame()
    base = dataclasses.replace(bar(fidelity), placement=place)
    up = Frame(place.origin + place.rotation @ np.array([0.0, 0.0, HEIGHT]), place.rotation)
    area = Patch("z-", "rect", (0.0, 0.0, 0.0), (block, WIDTH))
    faces = {"block": Interface("block", (area,)), "top": Interface("top", (Patch("z+"),))}
    settings = {"placement": up, "fidelity": "rigid", "interfaces": faces}
    slide = make_faced("slide", Box((0.1, WIDTH, 0.04)), {}, **settings)
    stiffness = np.diag([1e7, 3e8, 4e8, 1e5, 2e5, 3e5])
    joints = {
        "foot": Joint("foot", (JointEnd("bar", "end"), JointEnd()), "rigid", fixed=tuple(range(6))),
        "guide": Joint(
            "guide", (JointEnd("bar", "rail"), JointEnd("slide", "block")), "linear_guide",
            rotation=place.rotation, stiffness=stiffness, length=block,
        ),
    }  # fmt: skip
    axis = Axis("X", ("guide",), ("slide",), place.rotation[:, 0])
    point = Point("tcp", JointEnd("slide", "top"), JointEnd())
    return Machine("m", {"bar": base, "slide": slide}, joints, {"tcp": point}, {"X": axis})


@pytest.mark.parametrize("place", [-0.2, 0.0, 0.13])
def test_on_a_rigid_body_a_rail_is_a_fixed_interface_wherever_the_carriage_stands(
    place: float,
) -> None:
    machine = sliding_machine("rigid")
    area = Patch("z+", "rect", (place, 0.0, 0.0), (CARRIAGE, WIDTH))
    base = dataclasses.replace(
        machine.components["bar"],
        interfaces={"end": bar("rigid").interfaces["end"], "rail": Interface("rail", (area,))},
    )
    fixed = dataclasses.replace(
        machine,
        components=machine.components | {"bar": base},
        joints=machine.joints
        | {
            "guide": dataclasses.replace(
                machine.joints["guide"], ends=machine.joints["guide"].ends[::-1], length=None
            )
        },
    )
    slide = reduce_shape(machine.components["slide"])
    pose = Pose("p", {"X": place})
    with_rail = couple({"bar": reduce_shape(bar("rigid")), "slide": slide}, machine, pose).system
    without = couple({"bar": reduce_shape(base), "slide": slide}, fixed, pose).system
    np.testing.assert_allclose(
        solve_modal(with_rail, count=6).frequencies_hz,
        solve_modal(without, count=6).frequencies_hz,
        rtol=1e-9,
    )


@pytest.mark.parametrize("fidelity", ["segmented", "elastic"])
def test_a_machine_with_a_rail_answers_the_same_when_it_is_turned(
    fidelity: Fidelity, elastic: Superelement
) -> None:
    # the structured mesh begins at the origin
    shift = 0.5 * LENGTH if fidelity == "elastic" else 0.0
    frame = Frame(np.array([1.0, -2.0, 0.5]), rotation_about(np.array([1.0, 2.0, -0.5]), 1.1))
    part = elastic if fidelity == "elastic" else reduce_shape(bar("segmented"))
    found = []
    for turn in (Frame(), frame):
        machine = sliding_machine(fidelity, turn=turn)
        coupled = couple(
            {"bar": part, "slide": reduce_shape(machine.components["slide"])},
            machine,
            Pose("p", {"X": 0.17 + shift}),
        )
        channels = np.column_stack([coupled.system.inputs["tcp", dof] for dof in "xyz"])
        compliance = (
            turn.rotation.T
            @ (channels.T @ solve_static(coupled.system, channels).displacements)
            @ turn.rotation
        )
        found.append(compliance)
    np.testing.assert_allclose(found[1], found[0], rtol=1e-8, atol=1e-9 * np.abs(found[0]).max())


def test_a_carriage_that_leaves_its_rail_is_named_with_the_joint() -> None:
    machine = sliding_machine("rigid")
    parts = {"bar": reduce_shape(bar("rigid")), "slide": reduce_shape(machine.components["slide"])}
    with pytest.raises(ModelError, match=r"joint 'guide'.*bar\.rail.*150 mm.*235 mm.*10 mm"):
        couple(parts, machine, Pose("far", {"X": 0.235}))
    with pytest.raises(ModelError, match=r"700 mm.*600 mm"):
        couple(parts, sliding_machine("rigid", block=0.7), Pose("home"))


def test_a_carriage_without_a_length_is_refused() -> None:
    machine = sliding_machine("rigid")
    joints = machine.joints | {"guide": dataclasses.replace(machine.joints["guide"], length=None)}
    with pytest.raises(ModelError, match=r"joint 'guide'.*length"):
        couple(
            {"bar": reduce_shape(bar("rigid")), "slide": reduce_shape(machine.components["slide"])},
            dataclasses.replace(machine, joints=joints),
            Pose("home"),
        )


def test_a_rail_across_the_segments_is_refused() -> None:
    component = bar("segmented")
    across = dataclasses.replace(rail_interface(), rail=RailSettings("y", 5))
    component = dataclasses.replace(component, interfaces={"rail": across})
    with pytest.raises(ModelError, match=r"bar\.rail.*along = \"y\""):
        reduce_shape(component)


def test_stations_too_few_for_a_carriage_are_refused_with_a_remedy(elastic: Superelement) -> None:
    with pytest.raises(ModelError, match=r"\b9 control points.*100 mm.*600 mm.*at least 12"):
        carriage_rows(elastic.rails["rail"], 0.3, 0.1)


def test_more_stations_than_the_mesh_can_tell_apart_are_refused(mesh: ComponentMesh) -> None:
    with pytest.raises(ModelError, match=r"too few points.*rail.*40 control points"):
        fit_rail("bar", rail_interface(40), measure_patch(mesh, "rail"))


def test_the_remedy_for_the_mesh_of_a_file_is_no_mesh_size(mesh: ComponentMesh) -> None:
    with pytest.raises(ModelError, match=r"write a mesh file with elements of \"[\d.]+ mm\""):
        fit_rail("bar", rail_interface(40), measure_patch(mesh, "rail"), own_mesh=False)


def test_stations_that_a_mesh_barely_tells_apart_are_refused(mesh: ComponentMesh) -> None:
    """Thirteen points along the rail for thirteen intervals can be solved for, with any answer
    between the points.
    """
    fit_rail("bar", rail_interface(13), measure_patch(mesh, "rail"))
    with pytest.raises(ModelError, match=r"too few points along rail rail"):
        fit_rail("bar", rail_interface(16), measure_patch(mesh, "rail"))


@pytest.mark.parametrize(("segments", "allowed"), [(20, 1.5e-2), (40, 5e-3)])
def test_a_segmented_screw_is_as_stiff_along_and_about_itself_as_its_shaft_wherever_the_nut_stands(
    segments: int, allowed: float
) -> None:
    """The mean motion of a nut of length L under an even load, a from the bearing: (a - L / 6) /
    EA, and the same over GJ.
    """
    interfaces = {
        "end": Interface("end", (Patch("z-"),)),
        "shaft": Interface("shaft", (Patch("outer"),), "average", rail=RailSettings("z", 4)),
    }
    screw = Component(
        "screw",
        Tube(0.028, 0.0, 0.9),
        STEEL,
        interfaces=interfaces,
        fidelity="segmented",
        segments=SegmentSettings(segments),
    )
    part = reduce_shape(screw)
    free, flexibility = clamped_flexibility(part)
    axial, torsional = 2.1e11 * np.pi * 0.014**2, 2.1e11 / 2.6 * np.pi * 0.014**4 / 2.0
    for distance in np.linspace(0.1, 0.8, 29):
        rows = carriage_rows(part.rails["shaft"], float(distance), 0.06)[:, free]
        found = rows @ flexibility @ rows.T
        assert found[2, 2] == approx((distance - 0.01) / axial, rel=allowed)
        assert found[5, 5] == approx((distance - 0.01) / torsional, rel=allowed)


def test_splines_and_their_ends_are_those_of_scipy() -> None:
    knots = place_knots(-0.2, 0.7, 9)
    points = np.concatenate([np.linspace(-0.25, 0.75, 23), knots])
    expected = BSpline(knots, np.eye(9), 3)(points)
    np.testing.assert_allclose(evaluate_splines(knots, points), expected, atol=1e-14)

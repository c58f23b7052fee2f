"""Contact layers between two blocks: stiffness per area against closed forms and the rigid joint."""

import dataclasses
import functools

import numpy as np
import pytest
from mpi4py import MPI
from scipy.optimize import brentq

from common import make_box, make_component
from headstock.geometry.frames import FloatArray, Frame, rotation_about
from headstock.geometry.machine.drives import Cascade, Drive
from headstock.geometry.machine.joints import ContactLayer, Joint, JointEnd
from headstock.geometry.machine.machine import Machine, Pose
from headstock.geometry.parts.components import Component, Material
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.coupling.drives import make_rigid_train, release_motors
from headstock.reduction.motions.compliance_budget import strain_energies
from headstock.reduction.requests import ReductionRequest
from headstock.reduction.superelement import Superelement
from headstock.solvers.elastic.eigenpairs import ModeTarget
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.modal_analysis import solve_modal

LENGTH, WIDTH, DEPTH = 0.2, 0.05, 0.04
E, DENSITY = 2.1e11, 7850.0
# without lateral contraction a block is the rod of the textbook
ROD = Material("rod", E, 0.0, DENSITY)
Part = tuple[Component, Superelement]


@functools.cache
def half(name: str, form: str, flexible: int, turned: bool = False) -> Part:
    side = "z+" if (name == "lower") != turned else "z-"
    mesh = make_box((2, 2, 6), (WIDTH, DEPTH, LENGTH), {"cut": side})
    component = make_component({"cut": form}, name=name, material=ROD)
    interfaces = {"cut": dataclasses.replace(component.interfaces["cut"], flexible=flexible)}
    place = Frame(np.array([0.0, 0.0, LENGTH if name == "upper" else 0.0]))
    if turned:
        turn = rotation_about(np.array([1.0, 0.0, 0.0]), np.pi)
        place = Frame(np.array([0.0, DEPTH, 2.0 * LENGTH]), turn)
    component = dataclasses.replace(component, interfaces=interfaces, free=True, placement=place)
    request = ReductionRequest(modes=ModeTarget(count=70))
    return component, reduce_elastic(component, mesh, (), (), request=request, comm=MPI.COMM_SELF)


def join(
    lower: Part,
    upper: Part,
    layer: ContactLayer | None,
    *,
    point: FloatArray | None = None,
    rotation: FloatArray | None = None,
) -> CoupledMachine:
    components = {component.name: component for component, _ in (lower, upper)}
    ends = (JointEnd("lower", "cut"), JointEnd("upper", "cut"))
    fixed = () if layer else (0, 1, 2, 3, 4, 5)
    turn = np.eye(3) if rotation is None else rotation
    joint = Joint("glue", ends, "bolted", turn, fixed, point=point, layer=layer)
    machine = Machine("glued", components, {"glue": joint})
    return couple({element.name: element for _, element in (lower, upper)}, machine, Pose("home"))


def elastic(coupled: CoupledMachine, count: int = 10) -> FloatArray:
    return solve_modal(coupled.system).frequencies_hz[6 : 6 + count]


def axial_frequencies(coupled: CoupledMachine, count: int) -> FloatArray:
    """Frequencies of the modes in which both faces move apart."""
    modes = solve_modal(coupled.system)
    apart = np.abs(coupled.joint_springs[0].rows[2] @ modes.shapes)
    scale = 1.0 / np.sqrt(DENSITY * WIDTH * DEPTH * LENGTH)
    return np.asarray(modes.frequencies_hz[apart > 0.1 * scale][:count])


@pytest.mark.parametrize("form", ["rigid", "average"])
@pytest.mark.parametrize("share", [0.1, 1.0, 5.0])
def test_two_rods_and_a_layer_ring_as_the_closed_form_says(form: str, share: float) -> None:
    normal = share * E / LENGTH
    coupled = join(half("lower", form, 12), half("upper", form, 12), ContactLayer(normal, normal))
    # each half is a free rod on a spring of twice the layer: E beta tan(beta L) = 2 k
    roots = [
        brentq(lambda x: x * np.tan(x) - 2.0 * share, n * np.pi + 1e-9, (n + 0.5) * np.pi - 1e-9)
        for n in range(2)
    ]
    exact = np.array(roots) / LENGTH * np.sqrt(E / DENSITY) / (2.0 * np.pi)
    np.testing.assert_allclose(axial_frequencies(coupled, 2), exact, rtol=1e-3)


@pytest.mark.parametrize("form", ["rigid", "average"])
def test_a_stiff_layer_is_a_rigid_joint_and_a_soft_one_lets_the_faces_deform(form: str) -> None:
    lower, upper = half("lower", form, 12), half("upper", form, 12)
    rigid = elastic(join(lower, upper, None))
    found = [elastic(join(lower, upper, ContactLayer(k, k))) for k in (1e12, 1e14, 1e18)]
    assert (found[0] < found[1]).all() and (found[1] < rigid).all()
    np.testing.assert_allclose(found[2], rigid, rtol=1e-5)


def test_across_and_along_the_faces_are_told_apart() -> None:
    lower, upper = half("lower", "rigid", 12), half("upper", "rigid", 12)
    stiff, soft = 1e14, 1e11
    sliding = join(lower, upper, ContactLayer(stiff, soft))
    spring = sliding.joint_springs[0].stiffness
    area = WIDTH * DEPTH
    np.testing.assert_allclose(spring.diagonal()[:3], area * np.array([soft, soft, stiff]))
    tilt = area * stiff * np.array([DEPTH, WIDTH]) ** 2 / 12.0
    np.testing.assert_allclose(spring.diagonal()[3:5], tilt)
    np.testing.assert_allclose(spring[5, 5], area * soft * (WIDTH**2 + DEPTH**2) / 12.0)
    assert set(np.round(spring.diagonal()[6:] / area)) == {soft, stiff}
    # one normal shape for each of the three products of degree two, nine along the faces
    assert np.count_nonzero(spring.diagonal()[6:] > 0.5 * area * stiff) == 3


@pytest.mark.parametrize("hole", [0.0, 0.6])
def test_on_a_disk_and_a_ring_it_acts_over_their_area(hole: float) -> None:
    parts = []
    for part in (half("lower", "rigid", 12), half("upper", "rigid", 12)):
        component, element = part
        entry = element.interface_maps["cut"]
        shapes = entry.shapes
        assert shapes is not None
        round_one = dataclasses.replace(shapes, half_lengths=np.full(2, 0.02), hole=hole)
        maps = {"cut": dataclasses.replace(entry, shapes=round_one)}
        parts.append((component, dataclasses.replace(element, interface_maps=maps)))
    stiff, soft = 1e14, 1e11
    lower, upper = parts
    spring = join(lower, upper, ContactLayer(stiff, soft)).joint_springs[0].stiffness
    area = np.pi * 0.02**2 * (1.0 - hole**2)
    # squared radius of gyration about a diameter
    tilt = 0.02**2 * (1.0 + hole**2) / 4.0
    np.testing.assert_allclose(spring.diagonal()[:3], area * np.array([soft, soft, stiff]))
    np.testing.assert_allclose(
        spring.diagonal()[3:6], area * tilt * np.array([stiff, stiff, 2.0 * soft])
    )
    assert set(np.round(spring.diagonal()[6:] / area)) == {soft, stiff}


def test_a_layer_over_the_middle_of_the_patch_is_integrated_over_that_part() -> None:
    lower, upper = half("lower", "rigid", 12), half("upper", "rigid", 12)
    stiff, soft, share = 1e14, 1e11, 0.6
    joined = join(lower, upper, ContactLayer(stiff, soft, covers=share)).joint_springs[0]
    area = WIDTH * DEPTH * share**2
    spring = joined.stiffness
    np.testing.assert_allclose(spring.diagonal()[:3], area * np.array([soft, soft, stiff]))
    tilt = area * stiff * (share * np.array([DEPTH, WIDTH])) ** 2 / 12.0
    np.testing.assert_allclose(spring.diagonal()[3:5], tilt)
    # a field q of the upper face across the layer, over the points of a rule of its own
    points, weights = np.polynomial.legendre.leggauss(8)
    x = share * np.repeat(points, len(points))
    bow = np.sqrt(5.0) * (1.5 * x**2 - 0.5)
    energy = area * stiff * float(np.outer(weights, weights).ravel() @ (1.0 + bow) ** 2) / 4.0
    across = [
        row
        for row in range(6, len(spring))
        if spring[row, row] > stiff * area * 1e-2 and abs(spring[2, row]) > stiff * area * 1e-2
    ]
    energies = [
        spring[2, 2] + 2.0 * side * spring[2, row] + spring[row, row]
        for row in across
        for side in (1.0, -1.0)
    ]
    assert min(abs(np.array(energies) / energy - 1.0)) < 1e-12
    with_less = elastic(join(lower, upper, ContactLayer(3e12, 1e12, covers=share)))
    assert (with_less <= elastic(join(lower, upper, ContactLayer(3e12, 1e12))) + 1e-6).all()


@pytest.mark.parametrize("covers", [1.0, 0.7])
def test_the_joint_point_and_turned_frames_change_nothing(covers: float) -> None:
    layer = ContactLayer(3e12, 1e12, covers)
    lower = half("lower", "rigid", 12)
    straight = elastic(join(lower, half("upper", "rigid", 12), layer))
    turned = elastic(join(lower, half("upper", "rigid", 12, turned=True), layer))
    np.testing.assert_allclose(turned, straight, rtol=1e-8)
    moved = join(
        lower,
        half("upper", "rigid", 12),
        layer,
        point=np.array([0.3, 0.1, 0.2]),
        rotation=rotation_about(np.array([0.6, 0.0, 0.8]), 0.7),
    )
    np.testing.assert_allclose(elastic(moved), straight, rtol=1e-8)


def test_further_shapes_of_one_side_work_against_the_layer() -> None:
    layer = ContactLayer(3e12, 3e12)
    fewer = join(half("lower", "rigid", 3), half("upper", "rigid", 12), layer)
    both = join(half("lower", "rigid", 12), half("upper", "rigid", 12), layer)
    # shapes that only one side has are stretched, too: the strong form stays above
    assert (elastic(both) <= elastic(fewer) * (1.0 + 1e-9)).all()
    assert len(fewer.joint_springs[0].rows) == 6 + 12


def test_energies_of_the_layer_are_those_of_the_joint() -> None:
    coupled = join(half("lower", "rigid", 12), half("upper", "rigid", 12), ContactLayer(1e12, 1e12))
    modes = solve_modal(coupled.system, count=12)
    energies = strain_energies(coupled, modes.shapes)
    total = np.sum([*energies.values()], axis=0)
    np.testing.assert_allclose(
        total[6:], 0.5 * (2.0 * np.pi * modes.frequencies_hz[6:]) ** 2, rtol=1e-6
    )
    assert (energies["glue"][6:] > 0.0).all()


def test_without_shapes_nothing_says_how_large_the_layer_is() -> None:
    with pytest.raises(ModelError, match="deformation shapes"):
        join(half("lower", "rigid", 0), half("upper", "rigid", 0), ContactLayer(1e12, 1e12))


def test_motors_are_let_go_beside_a_layer() -> None:
    lower, upper = half("lower", "rigid", 12), half("upper", "rigid", 12)
    coupled = join(lower, upper, ContactLayer(1e14, 1e11))
    row: FloatArray = coupled.system.outputs["upper.cut", "z"]
    train = make_rigid_train(
        Drive("Z", "Z", "glue", 1e-3, 0.01, Cascade(50.0, 1e4).control),
        slide=row,
        scale=row,
        stator=np.zeros(len(row)),
        moved_mass=1.0,
    )
    stiff = dataclasses.replace(train, coupling=1e7)
    released = release_motors(coupled, (stiff,))
    rows = released.joint_springs[0].rows
    assert rows.shape == (len(coupled.joint_springs[0].rows), len(released.system.mass))
    assert not rows[:, -1].any()

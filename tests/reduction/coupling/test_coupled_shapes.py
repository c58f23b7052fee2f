"""Halves of a block on flexible interfaces against the block in one piece."""

import dataclasses
import functools

import numpy as np
import pytest
from mpi4py import MPI

from common import make_box, make_component
from headstock.geometry.frames import FloatArray, Frame, rotation_about
from headstock.geometry.machine.joints import Joint, JointEnd
from headstock.geometry.machine.machine import Machine, Pose
from headstock.geometry.parts.components import Component, Patch
from headstock.meshing.component_mesh import ComponentMesh
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.coupling.coupled_shapes import _shape_moments
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.requests import ReductionRequest
from headstock.reduction.superelement import Superelement
from headstock.solvers.elastic.eigenpairs import ModeTarget
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.modal_analysis import solve_modal

SIZE = (0.2, 0.15, 0.12)
ALL = (0, 1, 2, 3, 4, 5)
WATCHED = 8
EVERY = 1_000_000  # fixed-interface modes: bounds hold where none is left out
STRONG, WEAK = "rigid", "average"
Part = tuple[Component, Superelement]


def reduce_part(
    component: Component, mesh: ComponentMesh, flexible: int = 0, modes: int = 25
) -> Part:
    interfaces = {
        name: dataclasses.replace(entry, flexible=flexible)
        for name, entry in component.interfaces.items()
    }
    component = dataclasses.replace(component, interfaces=interfaces, free=True)
    request = ReductionRequest(modes=ModeTarget(count=modes))
    return component, reduce_elastic(component, mesh, (), (), request=request, comm=MPI.COMM_SELF)


@functools.cache
def lower(form: str, flexible: int) -> Part:
    """Below the cut, which is at z = 0.12 m."""
    mesh = make_box((4, 3, 2), SIZE, {"cut": "z+"})
    return reduce_part(make_component({"cut": form}, name="lower"), mesh, flexible)


@functools.cache
def upper(form: str, flexible: int, turned: bool = False, width: float = SIZE[0]) -> Part:
    """Above the cut, on a mesh of its own; perhaps in a frame upside down."""
    mesh = make_box((3, 4, 2), (width, *SIZE[1:]), {"cut": "z+" if turned else "z-"})
    component, element = reduce_part(make_component({"cut": form}, name="upper"), mesh, flexible)
    place = Frame(np.array([0.0, 0.0, SIZE[2]]))
    if turned:
        turn = rotation_about(np.array([1.0, 0.0, 0.0]), np.pi)
        place = Frame(np.array([0.0, SIZE[1], 2.0 * SIZE[2]]), turn)
    return dataclasses.replace(component, placement=place), element


def glue(*parts: Part, ground: bool = False) -> CoupledMachine:
    components = {component.name: component for component, _ in parts}
    ends = [JointEnd(name, "cut") for name in components]
    joint = Joint("glue", (ends[0], JointEnd() if ground else ends[1]), "rigid", fixed=ALL)
    machine = Machine("glued", components, {"glue": joint})
    return couple({element.name: element for _, element in parts}, machine, Pose("home"))


def elastic(coupled: CoupledMachine) -> FloatArray:
    return solve_modal(coupled.system).frequencies_hz[6 : 6 + WATCHED]


def matching_halves(form: str, flexible: int) -> tuple[Part, Part]:
    """With every fixed-interface mode, so that bounds hold."""
    parts = []
    for name, side, height in (("lower", "z+", 0.0), ("upper", "z-", SIZE[2])):
        mesh = make_box((5, 4, 2), SIZE, {"cut": side}, kind="hex8")
        component = make_component({"cut": form}, name=name)
        component, element = reduce_part(component, mesh, flexible, modes=EVERY)
        place = Frame(np.array([0.0, 0.0, height]))
        parts.append((dataclasses.replace(component, placement=place), element))
    return parts[0], parts[1]


@pytest.fixture(scope="module")
def whole() -> FloatArray:
    mesh = make_box((5, 4, 4), (SIZE[0], SIZE[1], 2.0 * SIZE[2]), kind="hex8")
    _, element = reduce_part(make_component(name="whole"), mesh, modes=WATCHED)
    return element.modal_frequencies_hz[:WATCHED]


def test_more_shapes_approach_one_piece_from_above_and_from_below(whole: FloatArray) -> None:
    strong, weak = (
        np.array([elastic(glue(*matching_halves(form, n))) for n in (0, 12, 30)])
        for form in (STRONG, WEAK)
    )
    assert (np.diff(strong, axis=0) <= 1e-9 * whole).all()
    assert (np.diff(weak, axis=0) >= -1e-9 * whole).all()
    assert (weak[-1] <= whole * (1.0 + 1e-9)).all()
    assert (whole <= strong[-1] * (1.0 + 1e-9)).all()
    for errors in (strong / whole - 1.0, weak / whole - 1.0):
        assert np.abs(errors[0]).max() > 0.05
    assert np.abs(weak[-1] / whole - 1.0).max() < 3e-3
    assert np.abs(strong[-1] / whole - 1.0).max() < 1.5e-2


@pytest.mark.parametrize("form", [STRONG, WEAK])
def test_a_part_that_lies_upside_down_in_its_frame_shares_the_same_shapes(form: str) -> None:
    straight = elastic(glue(lower(form, 12), upper(form, 12)))
    turned = elastic(glue(lower(form, 12), upper(form, 12, turned=True)))
    np.testing.assert_allclose(turned, straight, rtol=1e-8)


@pytest.mark.parametrize("form", [STRONG, WEAK])
def test_a_rigid_motion_moves_no_shape_and_the_mass_comes_out(form: str) -> None:
    coupled = glue(lower(form, 12), upper(form, 12))
    assert np.count_nonzero(solve_modal(coupled.system).frequencies_hz < 1.0) == 6
    mass = 7850.0 * 2.0 * np.prod(SIZE)
    rigid = np.linalg.lstsq(coupled.basis[:3], np.eye(3)[0], rcond=None)[0]
    assert rigid @ coupled.system.stiffness @ rigid >= 0.0
    parts = coupled.layout.superelements.values()
    np.testing.assert_allclose(sum(part.mass_kg for part in parts), mass, rtol=1e-12)


def test_ground_holds_every_shape() -> None:
    clamped = solve_modal(glue(lower(STRONG, 12), ground=True).system).frequencies_hz[:WATCHED]
    rigid = solve_modal(glue(lower(STRONG, 0), ground=True).system).frequencies_hz[:WATCHED]
    np.testing.assert_allclose(clamped, rigid, rtol=1e-9)


def test_where_one_side_has_more_shapes_the_further_ones_are_free_and_named() -> None:
    coupled = glue(lower(STRONG, 3), upper(STRONG, 12))
    assert any("9 further shapes of upper.cut are free" in text for text in coupled.warnings)
    free = elastic(coupled)
    assert (free <= elastic(glue(lower(STRONG, 3), upper(STRONG, 3))) * (1.0 + 1e-9)).all()
    averaged = glue(lower(WEAK, 0), upper(WEAK, 3))
    assert any("those of upper.cut are free" in text for text in averaged.warnings)


def test_shapes_that_only_springs_hold_are_named() -> None:
    (low, below), (up, above) = lower(STRONG, 3), upper(STRONG, 3)
    ends = (JointEnd("lower", "cut"), JointEnd("upper", "cut"))
    joint = Joint("spring", ends, "spring", stiffness=1e9 * np.eye(6))
    machine = Machine("sprung", {"lower": low, "upper": up}, {"spring": joint})
    warnings = couple({"lower": below, "upper": above}, machine, Pose("home")).warnings
    for end in ("lower.cut", "upper.cut"):
        assert any(f"six motions of {end}" in text for text in warnings)
    assert not any(
        "six motions" in text for text in glue(lower(STRONG, 3), upper(STRONG, 3)).warnings
    )


def test_other_rectangles_are_refused_with_both_sizes() -> None:
    with pytest.raises(ModelError, match=r"200 x 150 mm .* 180 x 150 mm"):
        glue(lower(STRONG, 3), upper(STRONG, 3, width=0.18))


def test_a_mesh_too_coarse_for_its_shapes_is_refused() -> None:
    mesh = make_box((1, 1, 1), SIZE, {"cut": "z+"}, kind="hex8")
    with pytest.raises(ModelError, match="too few points on interface cut"):
        reduce_part(make_component({"cut": STRONG}), mesh, 12, modes=1)


def test_a_bent_patch_is_refused() -> None:
    def bend(points: FloatArray) -> FloatArray:
        return points + [0.0, 0.0, 1.0] * points[:, :1] ** 2

    mesh = make_box((4, 3, 2), SIZE, {"cut": "z+"}, warp=bend)
    with pytest.raises(ModelError, match="not one flat patch"):
        reduce_part(make_component({"cut": STRONG}), mesh, 3, modes=1)


DISK = Patch("z+", "disk", (0.1, 0.075, 0.0), (0.12,))


@functools.cache
def with_disk(name: str, diameter: float = 0.12, angle: float = 0.0) -> Part:
    """A block with a disk on top; perhaps turned about its axis, upside down above another one."""
    mesh = make_box(
        (8, 6, 2),
        SIZE,
        {"cut": lambda x: (x[:, 2] > 0.1199) & (np.hypot(x[:, 0] - 0.1, x[:, 1] - 0.075) < 0.06)},
    )
    component = make_component({"cut": STRONG}, name=name)
    patch = dataclasses.replace(DISK, size=(diameter,))
    interfaces = {"cut": dataclasses.replace(component.interfaces["cut"], patches=(patch,))}
    component = dataclasses.replace(component, interfaces=interfaces)
    component, element = reduce_part(component, mesh, 24, modes=1)
    turn = rotation_about(np.array([0.0, 0.0, 1.0]), angle)
    if name == "upper":
        turn = turn @ rotation_about(np.array([1.0, 0.0, 0.0]), np.pi)
    middle = np.array([0.1, 0.075, SIZE[2]])
    place = Frame(middle - turn @ middle, turn)
    return dataclasses.replace(component, placement=place), element


def test_a_disk_is_what_is_written_whatever_the_mesh_has() -> None:
    shapes = with_disk("lower")[1].interface_maps["cut"].shapes
    assert shapes is not None
    assert (shapes.hole, shapes.count) == (0.0, 24)
    np.testing.assert_allclose(shapes.half_lengths, 0.06)
    np.testing.assert_allclose(shapes.center, [0.1, 0.075, 0.12])


@pytest.mark.parametrize("angle", [0.0, 0.4, 2.0])
def test_a_disk_shares_its_shapes_however_it_is_turned(angle: float) -> None:
    coupled = glue(with_disk("lower"), with_disk("upper", angle=angle))
    ends = (JointEnd("lower", "cut"), JointEnd("upper", "cut"))
    moments = _shape_moments(Joint("glue", ends, "rigid"), coupled.layout, *ends)
    np.testing.assert_allclose(moments @ moments.T, np.eye(24), atol=1e-12)


def test_disks_of_other_size_are_refused() -> None:
    with pytest.raises(ModelError, match=r"a disk of 120 mm .* a disk of 118 mm"):
        glue(with_disk("lower"), with_disk("upper", diameter=0.118))
    with pytest.raises(ModelError, match=r"200 x 150 mm .* a disk of 120 mm"):
        glue(with_disk("lower"), upper(STRONG, 12))

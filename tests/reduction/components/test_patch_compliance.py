"""the compliance of an area patch does not hang on the mesh; of a point, a line or a single
facet it does, so those are refused.
"""

import dataclasses

import numpy as np
import pytest

from common import make_box, make_component
from headstock.geometry.frames import BoolArray, FloatArray
from headstock.geometry.parts.components import (
    CellShape,
    CouplingKind,
    Interface,
    MeshSettings,
    Patch,
    Support,
)
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.components.meshing import mesh_component
from headstock.reduction.superelement import Superelement
from headstock.solvers.errors import ModelError
from reduced_parts import reduce_mesh

pytestmark = pytest.mark.hard("H12")

SIZE = (0.06, 0.06, 0.03)
PAD = Patch("z+", "rect", (0.0, 0.0, 0.0), (0.04, 0.04))
CLAMP = (Support("clamp", "block", (Patch("z-"),), ("x", "y", "z")),)


def reduce_pad(mesh: ComponentMesh, coupling: str = "rigid", patch: Patch = PAD) -> Superelement:
    component = make_component({"pad": coupling}, name="block", size=SIZE)
    pad = dataclasses.replace(component.interfaces["pad"], patches=(patch,))
    component = dataclasses.replace(component, interfaces={"pad": pad})
    return reduce_mesh(component, mesh, CLAMP)


def pad_compliance(coupling: CouplingKind, cells: CellShape, size: float) -> FloatArray:
    component = dataclasses.replace(
        make_component(name="block", size=SIZE),
        interfaces={"pad": Interface("pad", (PAD,), coupling)},
        mesh=MeshSettings(size, 2, cells),
    )
    mesh = mesh_component(component, CLAMP)
    element = reduce_mesh(component, mesh, CLAMP, recovery=False)
    return np.asarray(np.linalg.inv(element.stiffness), dtype=np.float64)


@pytest.mark.parametrize(
    ("coupling", "cells"),
    [
        ("average", "hex"),
        pytest.param("average", "tet", marks=pytest.mark.trials),
        pytest.param("rigid", "hex", marks=pytest.mark.trials),
        ("rigid", "tet"),
    ],
)
def test_halving_the_element_size_changes_how_far_a_force_moves_a_patch_by_less_than_three_percent(
    coupling: CouplingKind, cells: CellShape
) -> None:
    coarse, fine = (
        np.diag(pad_compliance(coupling, cells, PAD.size[0] / count)) for count in (4, 8)
    )
    assert np.abs(coarse / fine - 1.0)[:3].max() < 0.03
    if (coupling, cells) == ("average", "hex"):
        # how far a moment tilts a patch needs finer elements: three percent here, five elsewhere (a
        # stamp's edge stress has no bound)
        assert np.abs(coarse / fine - 1.0).max() < 0.03


def corner_facet(centers: FloatArray) -> BoolArray:
    return (centers[:, 2] > SIZE[2] - 1e-9) & (np.abs(centers[:, :2]) < 0.015).all(axis=1)


@pytest.mark.parametrize("coupling", ["rigid", "average"])
def test_a_patch_of_one_facet_is_refused_with_a_remedy_and_kept_with_a_warning_when_forced(
    coupling: str,
) -> None:
    mesh = make_box((4, 4, 2), SIZE, {"pad": corner_facet, "support:clamp": "z-"})
    assert len(mesh.patches["pad"]) == 1
    with pytest.raises(
        ModelError, match=r"pad of component block is 1 facet\(s\).*allow_singular = true"
    ):
        reduce_pad(mesh, coupling)
    warnings = reduce_pad(mesh, f"{coupling}!").warnings
    assert any("allow_singular = true" in warning for warning in warnings)


def test_a_whole_face_that_is_one_facet_is_an_area() -> None:
    mesh = make_box((1, 1, 2), SIZE, {"pad": "z+", "support:clamp": "z-"})
    warnings = reduce_pad(mesh, patch=Patch("z+")).warnings
    assert [warning for warning in warnings if "pad" in warning or "facet" in warning] == []


def point_compliance(counts: tuple[int, int, int]) -> tuple[float, Superelement]:
    mesh = make_box(counts, SIZE, {"support:clamp": "z-"}, kind="hex8")
    middle = np.flatnonzero(
        np.linalg.norm(mesh.points - [SIZE[0] / 2, SIZE[1] / 2, SIZE[2]], axis=1) < 1e-9
    )
    mesh = dataclasses.replace(
        mesh, patches=mesh.patches | {"pad": np.repeat(middle[:, None], 4, axis=1)}
    )
    element = reduce_pad(mesh, "rigid!")
    return 1.0 / element.stiffness[2, 2], element


def test_the_compliance_of_a_forced_point_grows_as_the_mesh_is_refined_and_says_so() -> None:
    values = [point_compliance((n, n, n // 2))[0] for n in (4, 8, 16)]
    steps = np.diff(values)
    # 1/h: every halving adds twice as much as the one before
    assert 1.5 < steps[1] / steps[0] < 2.5
    assert any(
        "grows without bound" in warning for warning in point_compliance((4, 4, 2))[1].warnings
    )


def test_a_point_is_refused_unless_forced() -> None:
    mesh = make_box((2, 2, 2), SIZE, {"support:clamp": "z-"})
    mesh = dataclasses.replace(
        mesh, patches=mesh.patches | {"pad": np.full((1, 9), len(mesh.points) - 1)}
    )
    with pytest.raises(ModelError, match="a point or a line"):
        reduce_pad(mesh)

"""What probes see of a superelement, against dense models with every dof; where stresses are singular."""

import dataclasses
from collections.abc import Mapping

import numpy as np
import pytest
from mpi4py import MPI

from common import Dense, make_box, make_component, present
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Probe
from headstock.geometry.parts.components import Load, Patch, Support
from headstock.meshing.component_mesh import CellKind, ComponentMesh
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.components.probes import _find_singular_edges
from headstock.reduction.requests import ReductionRequest, trim_superelement
from headstock.reduction.superelement import Superelement
from headstock.solvers.elastic.eigenpairs import ModeTarget
from headstock.solvers.elastic.stress_recovery import find_point_rows
from headstock.solvers.errors import ModelError
from reduced_parts import reduce_mesh

SIZE = (0.1, 0.1, 0.5)
COUNTS = (2, 2, 5)
GROUPS = {"support:foot": "z-", "top": "z+", "load:oil": "x+"}
FOOT = (Support("foot", "body", (Patch("z-"),), ("x", "y", "z")),)
OIL = (Load("oil", "body", "pressure", (Patch("x+"),), magnitude=1e6),)
PROBES = tuple(
    Probe(name, "body", place)
    for name, place in {"node": (0.1, 0.05, 0.2), "inside": (0.03, 0.07, 0.33)}.items()
)
TOP = {"top": "average"}


def reduce_body(modes: int, mesh: ComponentMesh) -> Superelement:
    component = make_component(TOP, modes=modes)
    return reduce_elastic(component, mesh, FOOT, OIL, comm=MPI.COMM_SELF, probes=PROBES)


@pytest.fixture(scope="module")
def mesh() -> ComponentMesh:
    return make_box(COUNTS, SIZE, GROUPS, kind="hex27")


@pytest.fixture(scope="module")
def elements(mesh: ComponentMesh) -> Mapping[int, Superelement]:
    return {count: reduce_body(count, mesh) for count in (6, 14)}


def harmonic(element: Superelement, name: str, hz: float) -> tuple[FloatArray, FloatArray]:
    """What a probe sees under the pressure, with what the modes left out add at rest, and that part
    alone.
    """
    square = (2.0 * np.pi * hz) ** 2
    probe, load = element.probes[name], element.loads["oil"]
    moved = np.linalg.solve(element.stiffness - square * element.mass, load.vector)
    late = square * probe.inertia @ moved[: element.boundary_size] + probe.loads["oil"].values
    return probe.values @ moved + late, late


@pytest.fixture(scope="module")
def full(mesh: ComponentMesh) -> Mapping[float, dict[str, FloatArray]]:
    """The same of all dofs at once, by a dense solve."""
    component = make_component(TOP)
    stiffness, mass = Dense().pencil(mesh, component.material)
    facets = mesh.patches["load:oil"]
    # an even pressure on second-order squares: weights of Simpson's rule
    weights = np.array([1.0, 1, 1, 1, 4, 4, 4, 4, 16]) / 36.0
    area = SIZE[1] / COUNTS[1] * SIZE[2] / COUNTS[2]
    parts = np.tile(-1e6 * area * weights, len(facets))
    push = np.zeros((len(mesh.points), 3))
    push[:, 0] = np.bincount(facets.ravel(), parts, len(mesh.points))
    free = np.repeat(mesh.points[:, 2] > 1e-9, 3)
    found = {}
    for hz in (0.0, 150.0, 900.0):
        dynamic = stiffness - (2.0 * np.pi * hz) ** 2 * mass
        moved = np.zeros(push.size)
        moved[free] = np.linalg.solve(dynamic[np.ix_(free, free)], push.ravel()[free])
        found[hz] = {
            probe.name: find_point_rows(mesh, component.material, np.array(probe.position)).apply(
                moved[:, None]
            )[:, 0]
            for probe in PROBES
        }
    return found


@pytest.mark.parametrize(("count", "allowed"), [(6, 3e-3), (14, 4e-4)])
@pytest.mark.parametrize("name", ["node", "inside"])
@pytest.mark.parametrize("hz", [0.0, 150.0, 900.0])
def test_few_modes_and_the_static_share_of_the_others_see_what_all_dofs_see(
    elements: Mapping[int, Superelement],
    full: Mapping[float, dict[str, FloatArray]],
    name: str,
    hz: float,
    count: int,
    allowed: float,
) -> None:
    exact = full[hz][name]
    seen, late = harmonic(elements[count], name, hz)
    for part in (slice(3), slice(3, 9)):
        off, bare = (
            np.abs(values[part] - exact[part]).max() / np.abs(exact[part]).max()
            for values in (seen, seen - late)
        )
        assert off < (1e-10 if hz == 0.0 else allowed)
    # stresses without that share are off by 3 to 12 %
    assert 50.0 * off < bare


def test_a_probe_of_fewer_modes_is_that_of_a_smaller_reduction(
    elements: Mapping[int, Superelement],
) -> None:
    request = ReductionRequest(ModeTarget(count=6))
    cut, own = trim_superelement(elements[14], request, mass=True), elements[6]
    for name, probe in own.probes.items():
        found, load = cut.probes[name], probe.loads["oil"]
        pairs = [
            (found.values[:, :6], probe.values[:, :6]),
            (found.inertia, probe.inertia),
            (present(found.smoothing)[..., :6], present(probe.smoothing)[..., :6]),
            (present(found.missing)[:, :6], present(probe.missing)[:, :6]),
            (found.loads["oil"].values, load.values),
            (present(found.loads["oil"].smoothing), present(load.smoothing)),
            (present(found.loads["oil"].missing), present(load.missing)),
        ]
        for one, other in pairs:
            np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-4 * np.abs(other).max())
        # exact but for the energies, which are in single precision
        for one, other in (pairs[1], pairs[4]):
            np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6 * np.abs(other).max())


def test_an_even_stress_is_hardly_smoothed(elements: Mapping[int, Superelement]) -> None:
    probe = elements[6].probes["inside"]
    # stresses of a pulled body, away from its foot
    pull = elements[6].labels.index(("top", "z"))
    assert probe.smoothing is not None
    share = np.linalg.norm(probe.smoothing[:, 2, pull]) / np.abs(probe.values[5, pull])
    assert share < 0.02


def test_rims_of_rigid_faces_and_of_supports_are_singular_and_planes_of_symmetry_are_not(
    mesh: ComponentMesh,
) -> None:
    groups = dataclasses.replace(
        mesh, patches={**mesh.patches, "support:sym": mesh.patches["load:oil"]}
    )
    symmetric = Support("sym", "body", (Patch("x+"),), ("x",))
    component = make_component({"top": "rigid"})
    found = _find_singular_edges(component, groups, (*FOOT, symmetric))
    assert list(found) == ["the rim of support 'foot'", "the rim of rigid interface 'top'"]
    heights = mesh.points[found["the rim of support 'foot'"]]
    assert np.abs(heights[:, 2]).max() < 1e-12
    on_edge = (heights[:, :2] < 1e-9) | (heights[:, :2] > 0.1 - 1e-9)
    assert on_edge.any(axis=1).all()
    assert list(_find_singular_edges(make_component(TOP), mesh, ())) == []
    skew = dataclasses.replace(symmetric, directions=("x", "y"))
    assert "the rim of support 'sym'" in _find_singular_edges(component, groups, (skew,))


@pytest.mark.parametrize("kind", ["hex27", "tet10"])
def test_a_corner_that_turns_inwards_is_singular(kind: CellKind) -> None:
    block = make_box((2, 2, 2), (0.2, 0.2, 0.1), kind=kind)
    middles = block.points[block.cells].mean(axis=1)
    kept = block.cells[~((middles[:, 0] > 0.1) & (middles[:, 1] > 0.1))]
    angle = dataclasses.replace(block, cells=kept)
    (nodes,) = _find_singular_edges(make_component(), angle, ()).values()
    assert len(nodes) == 3
    np.testing.assert_allclose(angle.points[nodes][:, :2], 0.1, atol=1e-12)


def test_a_probe_outside_is_refused_by_name(mesh: ComponentMesh) -> None:
    lost = (Probe("lost", "body", (0.1, 0.05, 0.6)),)
    with pytest.raises(ModelError, match=r"probe 'lost'.*outside"):
        reduce_mesh(make_component(TOP), mesh, FOOT, probes=lost)  # fmt: skip

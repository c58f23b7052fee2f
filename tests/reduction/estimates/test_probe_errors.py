"""Estimates of what a mesh does to displacement and stress at probes, against a finer mesh."""

from collections.abc import Mapping

import numpy as np
import pytest
from mpi4py import MPI

from common import make_box, make_component, present
from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.geometry.machine.joints import JointEnd
from headstock.geometry.machine.machine import Machine, Point, Pose, Probe
from headstock.geometry.parts.components import Load, Patch, Support
from headstock.meshing.component_mesh import CellKind
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.coupling.probes import PlacedProbe, missing_of_loads, place_probe
from headstock.reduction.estimates.static_errors import (
    MOVED,
    RestErrors,
    bound_von_mises,
    estimate_at_rest,
)
from headstock.solvers.linear.static_response import solve_static
from headstock.solvers.stresses import largest_von_mises
from reduced_parts import reduce_mesh

SIZE = (0.1, 0.15, 0.4)
GROUPS = {"support:foot": "z-", "top": "z+", "load:oil": "x+"}
FOOT = (Support("foot", "body", (Patch("z-"),), ("x", "y", "z")),)
OIL = Load("oil", "body", "pressure", (Patch("x+"),), magnitude=1e6)
FINE: tuple[CellKind, tuple[int, int, int]] = ("hex27", (4, 5, 10))
SEEDS = range(5)
COMPONENT = make_component({"top": "average"}, size=SIZE)


def seeded_places() -> dict[str, Probe]:
    """A place off the foot and the rim of the top for each seed, half of them on a side."""
    found = {}
    for seed in SEEDS:
        random = np.random.default_rng(seed)
        x, y, z = random.uniform([0.1, 0.1, 0.3], [0.9, 0.9, 0.8]) * SIZE
        place = (float(x), 0.0 if seed % 2 else float(y), float(z))
        found[f"seed {seed}"] = Probe(f"seed {seed}", "body", place)
    return found


PROBES = seeded_places()
MACHINE = Machine(
    "block",
    {"body": COMPONENT},
    points={"tcp": Point("tcp", JointEnd("body", "top"), JointEnd())},
    supports={"foot": FOOT[0]},
    loads={"oil": OIL},
    probes=PROBES,
)
Seen = Mapping[str, tuple[FloatArray, RestErrors]]


def see(kind: CellKind, counts: tuple[int, int, int]) -> Seen:
    """Displacement and stress at every place with their errors, under a pressure, and a force and a
    moment at the top that differ from seed to seed.
    """
    mesh = make_box(counts, SIZE, GROUPS, kind=kind)
    element = reduce_elastic(
        COMPONENT, mesh, FOOT, (OIL,), comm=MPI.COMM_SELF, probes=tuple(PROBES.values())
    )
    coupled = couple({"body": element}, MACHINE, Pose("reference"))
    inside = missing_of_loads(coupled, MACHINE, None)
    found = {}
    for seed, (name, probe) in enumerate(PROBES.items()):
        placed = place_probe(coupled, MACHINE, probe, None)
        moved = solve_static(coupled.system, give_load(coupled, seed)[:, None]).displacements[:, 0]
        found[name] = (read(placed, moved), estimate_at_rest(coupled, placed, moved, inside))
    return found


def give_load(coupled: CoupledMachine, seed: int) -> FloatArray:
    sizes = np.random.default_rng([1, seed]).normal(size=6) * [2e4, 2e4, 1e5, 1e3, 1e3, 1e3]
    inputs = [coupled.system.inputs["tcp", name] for name in DOF_NAMES]
    return coupled.loads["oil"] + np.column_stack(inputs) @ sizes


def read(placed: PlacedProbe, moved: FloatArray) -> FloatArray:
    return placed.values @ moved + placed.loads["oil"].values


@pytest.fixture(scope="module")
def fine() -> Seen:
    return see(*FINE)


@pytest.mark.parametrize(("kind", "counts"), [("hex27", (2, 2, 4)), ("tet10", (2, 3, 6))])
def test_true_errors_at_seeded_places_lie_within_their_estimates(
    fine: Seen, kind: CellKind, counts: tuple[int, int, int]
) -> None:
    coarse, shares = see(kind, counts), []
    for name, (values, errors) in coarse.items():
        exact, rest = fine[name]
        # what the fine mesh may be off itself is small beside the errors that are judged
        doubt = rest.meshes["body"]
        true, sizes = np.abs(values - exact), errors.meshes["body"]
        for part in (slice(MOVED), slice(MOVED, None)):
            assert np.linalg.norm(doubt[part]) < 0.7 * np.linalg.norm(sizes[part])
        equal, other = (float(largest_von_mises(each[MOVED:])) for each in (values, exact))
        sizes = np.append(sizes, bound_von_mises(values[MOVED:], errors)[0])
        shares.append(np.append(true, abs(equal - other)) / sizes)
    assert len(shares) == len(SEEDS)
    found = np.array(shares)
    assert (found <= 1.0).mean() >= 0.95
    assert np.median(found[:, :MOVED]) > 0.05 and np.median(found[:, MOVED:]) > 0.05


def test_modes_that_are_kept_change_no_error_at_rest() -> None:
    """The parts by way of the coordinates and inside differ with the modes, their sum does not."""
    mesh = make_box((2, 3, 6), SIZE, GROUPS, kind="tet10")
    found, inner = [], []
    for count in (0, 5):
        element = reduce_mesh(
            COMPONENT, mesh, FOOT, (OIL,), modes=count, probes=tuple(PROBES.values())
        )
        coupled = couple({"body": element}, MACHINE, Pose("reference"))
        inside = missing_of_loads(coupled, MACHINE, None)
        for seed, probe in enumerate(PROBES.values()):
            placed = place_probe(coupled, MACHINE, probe, None)
            moved = solve_static(coupled.system, give_load(coupled, seed)[:, None]).displacements
            found.append(estimate_at_rest(coupled, placed, moved[:, 0], inside))
            own = present(placed.missing) @ moved[:, 0]
            inner.append(own + present(placed.loads["oil"].missing))
    assert len(found) == 2 * len(PROBES)
    for seed in SEEDS:
        first, second = (found[seed + place].products["body"] for place in (0, len(SEEDS)))
        apart = inner[seed] - inner[seed + len(SEEDS)]
        for part in (slice(MOVED), slice(MOVED, None)):
            size = float(np.linalg.norm(first[part]))
            # natural modes are known to about that
            np.testing.assert_allclose(second[part], first[part], rtol=0.0, atol=1e-5 * size)
            assert np.linalg.norm(apart[part]) > 1e-2 * size

"""A small table on a bed with a rail, at places of its axis, against an unreduced model that knows
nothing of coupling.
"""

import numpy as np
import pytest
from mpi4py import MPI

from common import approx
from headstock.geometry.machine.machine import Machine, Pose
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.components.meshing import mesh_component
from headstock.reduction.components import elastic
from headstock.reduction.superelement import Superelement
from headstock.scene.building.loader import load_scene
from headstock.validation.machines.machine_cases import (
    SCENE,
    _answer_fresh_mesh,
    _answer_reduced,
    _answer_same_mesh,
    _find_ripple,
    _reduce_parts,
    _relative_deviations,
)
from headstock.validation.machines.monolithic_machines import fix_carriages

Model = tuple[Machine, ComponentMesh, dict[str, Superelement]]


@pytest.fixture(scope="module")
def model() -> Model:
    """The shipped guideway with a coarser bed and fewer fixed-interface modes."""
    machine = load_scene(
        SCENE,
        overrides=("components.bed.mesh.size=75 mm", "components.bed.reduction.modes_to=6 kHz"),
    ).machine
    mesh = mesh_component(machine.components["bed"])
    return machine, mesh, _reduce_parts(machine, {"bed": mesh}, MPI.COMM_SELF)


def test_statics_are_those_of_the_same_mesh_at_any_place_and_frequencies_come_from_above(
    model: Model,
) -> None:
    machine, mesh, parts = model
    found = _answer_reduced(machine, parts, 0.0871)
    expected = _answer_same_mesh(machine, mesh, 0.0871)
    errors = _relative_deviations(found, expected)
    assert errors[:3].max() < 1e-7
    assert errors[3:].max() < 1e-2 and np.median(errors[3:]) < 1e-3
    assert (found[1] > expected[1] * (1.0 - 1e-9)).all()


def test_an_evenly_averaging_patch_imprinted_in_a_fresh_mesh_says_the_same(model: Model) -> None:
    machine, _, parts = model
    errors = _relative_deviations(
        _answer_reduced(machine, parts, 0.0871), _answer_fresh_mesh(machine, 0.0871)
    )
    assert errors.max() < 1e-2 and np.median(errors) < 2e-3


def test_frequencies_have_no_ripple_over_the_stations(model: Model) -> None:
    machine, _, parts = model
    assert _find_ripple(machine, parts, samples=17) < 5e-4


def test_another_place_factorises_nothing(model: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    machine, _, parts = model

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a pose must not factorise or reduce anything")

    monkeypatch.setattr("headstock.solvers.elastic.factorization.Factorization.__init__", refuse)
    monkeypatch.setattr(elastic, "_reduce_operators", refuse)
    places = np.linspace(-0.24, 0.24, 5)
    lowest = [_answer_reduced(machine, parts, float(place))[1][0] for place in places]
    assert np.ptp(lowest) > 1.0


def test_the_unreduced_model_has_each_carriage_on_a_patch_where_it_stands() -> None:
    machine = load_scene(SCENE).machine
    fixed = fix_carriages(machine, Pose("p", {"X": 0.05}))
    patch = fixed.components["bed"].interfaces["carriage_2"].patches[0]
    assert (patch.shape, patch.size) == ("rect", approx((0.1, 0.03)))
    assert patch.center[:2] == approx((-0.06, 0.09))
    assert all(joint.length is None and joint.screw is None for joint in fixed.joints.values())
    distance = 0.4 + 0.05
    expected = 1.0 / (1.0 / 4e8 + 1.0 / 6e8 + distance / (210e9 * np.pi * 0.014**2))
    assert fixed.joints["x_drive"].stiffness[0, 0] == approx(expected)
    assert fixed.components["bed"].interfaces["carriage_2"].coupling == "average"

"""Estimates of what a mesh does to frequency responses: against dense solves of the softened
machine, and against a finer mesh.
"""

import dataclasses

import numpy as np
import pytest

from common import approx, present
from elastic_columns import COLUMN, reduce_column
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Pose
from headstock.meshing.component_mesh import CellKind
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.estimates.mesh_errors import (
    compliance_mesh_errors,
    frequency_mesh_errors,
    meshed_parts,
)
from headstock.reduction.estimates.response_errors import (
    ErrorSources,
    ResponseSpace,
    bound_response_errors,
    project_response,
    soften_response,
)
from headstock.reduction.motions.compliance_budget import point_budget
from headstock.solvers.linear.frequency_response import solve_frf
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.second_order import SecondOrderSystem, input_columns, output_rows
from lumped_machines import clamped_machine

LOSS = 0.03
CHANNELS = (("tcp", "x"), ("tcp", "y"), ("tcp", "z"))


def column(kind: CellKind, counts: tuple[int, int, int], *, fixed: bool = True) -> CoupledMachine:
    """The column, clamped at its foot or free, with errors as estimated, without the factor that
    covers 95 %.
    """
    element = reduce_column(kind, counts)
    element = dataclasses.replace(
        element, errors=dataclasses.replace(element.errors, mesh_safety=1.0)
    )
    machine = clamped_machine(COLUMN)
    machine = machine if fixed else dataclasses.replace(machine, joints={})
    return couple({"body": element}, machine, Pose("reference"))


def judged(
    coupled: CoupledMachine, hz: FloatArray | list[float]
) -> tuple[SecondOrderSystem, ResponseSpace]:
    """The lossy system and its trial space for lines up to a frequency."""
    system = dataclasses.replace(
        coupled.system, damping=None, hysteretic=LOSS * coupled.system.stiffness
    )
    sources = ErrorSources(meshed=meshed_parts(coupled), loss_factors={"body": LOSS})
    modes = solve_modal(coupled.system)
    return system, project_response(
        system,
        sources,
        modes,
        (input_columns(system, CHANNELS), output_rows(system, CHANNELS)),
        max(hz),
    )


def test_a_softened_response_is_that_of_the_whole_machine_less_the_missing_energy() -> None:
    coupled = column("tet10", (1, 3, 8))
    first = float(solve_modal(coupled.system, count=1).frequencies_hz[0])
    lines = first * np.array([0.3, 0.99, 1.0, 1.5, 4.0])
    system, space = judged(coupled, lines)
    missing = np.sum(
        [part.rows.T @ part.energy @ part.rows for part in meshed_parts(coupled).values()], axis=0
    )
    flexibility = np.linalg.inv(system.stiffness)
    stiffness = np.linalg.inv(flexibility + flexibility @ missing @ flexibility)
    softer = dataclasses.replace(system, stiffness=stiffness, hysteretic=LOSS * stiffness)
    whole = solve_frf(softer, lines, inputs=CHANNELS, outputs=CHANNELS).receptance
    plain = solve_frf(system, lines, inputs=CHANNELS, outputs=CHANNELS).receptance
    np.testing.assert_allclose(
        soften_response(space, lines), whole, atol=2e-2 * np.abs(whole - plain).max()
    )
    np.testing.assert_allclose(
        present(bound_response_errors(space, lines).mesh),
        whole - plain,
        atol=2e-2 * np.abs(whole - plain).max(),
    )
    dropped = frequency_mesh_errors(coupled, solve_modal(coupled.system, count=1))["body"][0]
    assert 1.0 - space.softening(first) == approx(dropped / first, rel=0.05)


@pytest.mark.parametrize("kind", ["hex27", "hex8"])
def test_at_rest_it_is_the_estimate_of_the_static_compliance(kind: CellKind) -> None:
    """Of linear hexes it is as large as the compliance itself."""
    coupled = column(kind, (2, 3, 8))
    _, space = judged(coupled, [100.0])
    found = bound_response_errors(space, np.array([0.0]))
    assert not found.bounds.any()
    static = compliance_mesh_errors(coupled, point_budget(coupled, "tcp").displacements)["body"][
        :3, :3
    ]
    np.testing.assert_allclose(present(found.mesh)[0].real, static, rtol=1e-6)
    assert not present(found.mesh).imag.any()


def test_a_free_machine_has_a_finite_error_on_every_line() -> None:
    coupled = column("tet10", (1, 2, 6), fixed=False)
    lines = np.array([0.0, 1.0, 500.0])
    _, space = judged(coupled, lines)
    mesh = present(bound_response_errors(space, lines).mesh)
    assert np.isfinite(mesh).all()
    # next to nothing strains a free column that is pushed slowly: its error is that of inertia
    # relief, whatever the rigid motion
    np.testing.assert_allclose(mesh[1], mesh[0], atol=0.1 * np.abs(mesh[0]).max())


def test_a_peak_that_passes_over_a_line_is_in_its_error() -> None:
    coupled = column("tet10", (1, 2, 6))
    modes = solve_modal(coupled.system)
    first = float(modes.frequencies_hz[0])
    dropped = frequency_mesh_errors(coupled, modes)["body"][0]
    # damped so little that a line half-way is beside the peak before and after the change
    lines, loss, parts = (
        np.array([first - 0.5 * dropped]),
        0.1 * dropped / first,
        meshed_parts(coupled),
    )
    system = dataclasses.replace(
        coupled.system, damping=None, hysteretic=loss * coupled.system.stiffness
    )
    channels = (input_columns(system, CHANNELS), output_rows(system, CHANNELS))
    space = project_response(
        system, ErrorSources(meshed=parts, loss_factors={"body": loss}), modes, channels, first
    )
    errors = bound_response_errors(space, lines)
    row = int(np.argmax(present(errors.mesh_sizes)[0].diagonal()))
    plain = solve_frf(system, lines, inputs=CHANNELS, outputs=CHANNELS).receptance
    missing = parts["body"].rows.T @ parts["body"].energy @ parts["body"].rows
    passing = []
    for share in np.linspace(0.4, 0.6, 41):
        stiffness, hysteretic = (
            system.stiffness - share * missing,
            system.hysteretic - loss * share * missing,
        )
        moved = dataclasses.replace(system, stiffness=stiffness, hysteretic=hysteretic)
        passing.append(
            abs(
                (solve_frf(moved, lines, inputs=CHANNELS, outputs=CHANNELS).receptance - plain)[
                    0, row, row
                ]
            )
        )
    assert abs(present(errors.mesh)[0, row, row]) < 0.5 * max(passing)
    assert max(passing) <= present(errors.mesh_sizes)[0, row, row] <= 1.5 * max(passing)


def test_a_line_is_off_by_the_largest_change_anywhere_on_the_way_to_finer_meshes() -> None:
    coupled = column("tet10", (1, 2, 6))
    coarse = {
        name: dataclasses.replace(part, energy=3.0 * part.energy)
        for name, part in meshed_parts(coupled).items()
    }
    peaks = solve_modal(coupled.system, count=3).frequencies_hz
    lines = np.concatenate([peak * np.linspace(0.9, 1.03, 27) for peak in peaks])
    system = dataclasses.replace(
        coupled.system, damping=None, hysteretic=LOSS * coupled.system.stiffness
    )
    channels = input_columns(system, CHANNELS), output_rows(system, CHANNELS)
    space = project_response(
        system,
        ErrorSources({}, coarse, {"body": LOSS}),
        solve_modal(coupled.system),
        channels,
        max(lines),
    )
    found = bound_response_errors(space, lines)
    eigenvalues, loads = (2.0 * np.pi * lines) ** 2, space.loads.astype(complex)
    plain = space.rows @ np.linalg.solve(space.dynamic_stiffness(eigenvalues), loads)
    shares = np.linspace(0.0, 1.0, 41)
    way = [
        space.rows
        @ np.linalg.solve(space.dynamic_stiffness(eigenvalues, space.finer, share), loads)
        - plain
        for share in shares
    ]
    along = np.arange(3)
    covered = (found.mesh_sizes / np.abs(way).max(axis=0))[:, along, along]
    visible = np.abs(plain)[:, along, along] >= 1e-2 * np.abs(plain)[:, along, along].max(axis=0)
    assert covered[visible].min() > 0.95

"""Every broken superelement is refused by name; sound ones pass."""

import dataclasses
from functools import partial

import numpy as np
import pytest

from headstock.geometry.frames import FloatArray
from headstock.reduction.superelement_checks import FILE_ROUNDING, check_superelement
from headstock.solvers.errors import AccuracyError
from lumped_machines import rigid_body, two_node_body

PART = two_node_body("column", 40.0, 0.5, (1e8, 2e8, 5e8, 2e6, 3e6, 1e6))[1]
E_X = np.eye(12)[0]


def off(matrix: FloatArray, row: int, column: int, share: float) -> FloatArray:
    changed = matrix.copy()
    changed[row, column] += share * np.abs(matrix).max()
    return changed


broken = partial(dataclasses.replace, PART)
BROKEN = {
    "unsymmetric stiffness": (
        broken(stiffness=off(PART.stiffness, 0, 7, 1e-9)),
        "stiffness is unsymmetric",
    ),
    "unsymmetric mass": (broken(mass=off(PART.mass, 1, 2, 1e-9)), "mass is unsymmetric"),
    "grounded": (broken(stiffness=off(PART.stiffness, 0, 0, 1e-6)), "rigid motion"),
    "indefinite stiffness": (
        broken(stiffness=off(PART.stiffness, 3, 3, -0.9)),
        "stiffness has a negative direction",
    ),
    "indefinite mass": (broken(mass=off(PART.mass, 5, 5, -0.9)), "mass has a negative direction"),
    "lost mass": (broken(mass_kg=40.0 * (1.0 + 1e-13)), "its mass is off"),
    "shifted centre": (
        broken(center_of_mass=PART.center_of_mass + np.array([1e-13, 0.0, 0.0])),
        "centre of mass is off",
    ),
    "wrong inertia": (broken(inertia=PART.inertia * (1.0 + 1e-12)), "inertia is off"),
    "NaN": (broken(stiffness=np.full((12, 12), np.nan)), "not finite"),
    "infinite mass": (broken(mass=np.full((12, 12), np.inf)), "not finite"),
    "NaN constraint": (broken(constraints=np.full((1, 12), np.nan)), "constraints holds values"),
}


@pytest.mark.parametrize("what", BROKEN)
def test_a_broken_superelement_is_refused_by_name(what: str) -> None:
    part, text = BROKEN[what]
    with pytest.raises(AccuracyError, match=f"'column'.*{text}"):
        check_superelement(part)


def test_sound_ones_pass() -> None:
    check_superelement(PART)
    check_superelement(rigid_body("body", 3.0, {"foot": (0, 0, 0)}, center=(5.0, 0.0, 0.0))[1])
    check_superelement(rigid_body("nothing", 0.0, {"foot": (0, 0, 0)}, inertia=(0, 0, 0))[1])


def test_a_supported_one_needs_no_rigid_motions_and_one_without_mass_no_mass() -> None:
    grounded = dataclasses.replace(PART, stiffness=PART.stiffness + 1e8 * np.outer(E_X, E_X))
    with pytest.raises(AccuracyError, match="supported"):
        check_superelement(grounded)
    check_superelement(dataclasses.replace(grounded, supported=True))
    check_superelement(dataclasses.replace(PART, mass=np.zeros((12, 12))))


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e4])
def test_the_checks_do_not_depend_on_size(scale: float) -> None:
    check_superelement(
        two_node_body(
            "column",
            40.0 * scale**3,
            0.5 * scale,
            np.array([1e8] * 3 + [1e6 * scale**2] * 3) * scale,
        )[1]
    )


def test_numbers_from_a_file_need_agree_only_as_far_as_they_were_printed() -> None:
    printed = dataclasses.replace(
        PART, mass=np.array([[float(f"{value:.11e}") for value in row] for row in PART.mass / 3.0])
    )
    printed = dataclasses.replace(
        printed, mass_kg=PART.mass_kg / 3.0, inertia=(1.0 / 3.0) * PART.inertia
    )
    check_superelement(printed, rounding=FILE_ROUNDING)
    lost = dataclasses.replace(printed, mass_kg=printed.mass_kg * (1.0 + 1e-9))
    with pytest.raises(AccuracyError, match="its mass is off"):
        check_superelement(lost, rounding=FILE_ROUNDING)


def test_shapes_that_all_but_cancel_in_a_translation_may_leave_the_rounding_of_their_own_mass() -> (
    None
):
    swing = np.zeros((12, 12))
    # a large shape that no rigid motion holds, as psi of a slender part has them between two ends
    # that move alike
    difference = np.concatenate([np.eye(6)[2], -np.eye(6)[2]])
    swing += 1e8 * np.outer(difference, difference)
    heavy = dataclasses.replace(PART, mass=PART.mass + swing)
    check_superelement(dataclasses.replace(heavy, mass_kg=PART.mass_kg * (1.0 + 1e-10)))
    with pytest.raises(AccuracyError, match="its mass is off"):
        check_superelement(dataclasses.replace(heavy, mass_kg=PART.mass_kg * (1.0 + 1e-6)))

"""A small superelement written by hand, for tests of files that hold superelements."""

import numpy as np

from headstock.geometry.frames import Frame
from headstock.reduction.superelement import (
    ErrorEstimates,
    InterfaceMap,
    Recovery,
    StaticLoad,
    Superelement,
    Truncation,
)

FREQUENCIES = np.array([100.0, 200.0])


def bar() -> Superelement:
    """A bar of 2 kg from 0 to 1 m along z with one interface at its foot and two modes; its numbers
    agree with each other.
    """
    square = (2.0 * np.pi * FREQUENCIES) ** 2
    stiffness, mass = np.zeros((8, 8)), np.eye(8)
    stiffness[6:, 6:] = np.diag(square)
    labels = (
        *(("foot", dof) for dof in ("x", "y", "z", "rx", "ry", "rz")),
        ("mode", "1"),
        ("mode", "2"),
    )
    part = np.outer(np.arange(1.0, 7.0), np.arange(1.0, 7.0))
    points = np.array([[0.0, 0, 0], [0.1, 0.1, 0.5], [0.05, 0, 1.0]])
    return Superelement(
        name="bar",
        labels=labels,
        frames=(Frame(),),
        interface_maps={"foot": InterfaceMap(0, Frame())},
        stiffness=stiffness,
        mass=mass,
        recovery=Recovery(basis=np.ones((9, 8)), points=points),
        constraints=np.zeros((0, 8)),
        modal_frequencies_hz=FREQUENCIES,
        cutoff_hz=300.0,
        full_dofs=9,
        mass_kg=2.0,
        center_of_mass=np.zeros(3),
        inertia=np.eye(3),
        loads={"push": StaticLoad(np.ones(8), np.ones(9))},
        warnings=("wobbles ± 3 µm → look",),
        errors=ErrorEstimates(
            truncation=Truncation(part / 4e6, part / 16e12, 4e6), missing_energy=np.eye(8)
        ),
    )

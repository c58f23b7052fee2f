"""Rigid superelements carry mass, centre and inertia exactly."""

import dataclasses

import numpy as np
import pytest

from common import approx, make_faced
from headstock.geometry.frames import FloatArray, Frame, rotation_about
from headstock.geometry.machine.machine import Machine, Pose
from headstock.geometry.parts.components import Load, Patch
from headstock.geometry.parts.mass_properties import SolidProperties
from headstock.geometry.parts.solids import Box
from headstock.reduction.components.rigid import reduce_rigid
from headstock.reduction.coupling.coupling import couple
from headstock.solvers.errors import ModelError

SIZE = (0.4, 0.2, 0.1)
VOLUME = 0.4 * 0.2 * 0.1
INERTIA: FloatArray = (
    VOLUME / 12.0 * np.diag(np.array([0.2**2 + 0.1**2, 0.4**2 + 0.1**2, 0.4**2 + 0.2**2]))
)
TOP = np.array([0.1, 0.05, 0.1])
PROPERTIES = SolidProperties(
    VOLUME,
    np.array([0.0, 0.0, 0.05]),
    INERTIA,
    {"top": 0.01, "load:push": 0.02},
    {"top": TOP, "load:push": TOP},
)
COMPONENT = make_faced("table", Box(SIZE), {"top": "z+"}, fidelity="rigid")


def test_mass_and_inertia_are_density_times_volume_properties() -> None:
    part = reduce_rigid(COMPONENT, PROPERTIES)
    assert part.mass_kg == approx(7850.0 * VOLUME, rel=1e-15)
    np.testing.assert_allclose(
        part.mass, np.diag([part.mass_kg] * 3 + list(7850.0 * INERTIA.diagonal())), rtol=1e-14
    )
    assert (
        part.labels[0] == ("center", "x") and part.boundary_size == 6 and not part.stiffness.any()
    )


def test_a_stated_mass_scales_the_inertia_too() -> None:
    part = reduce_rigid(dataclasses.replace(COMPONENT, mass=10.0), PROPERTIES)
    assert part.mass_kg == approx(10.0, rel=1e-15)
    np.testing.assert_allclose(part.inertia, 10.0 / VOLUME * INERTIA, rtol=1e-14)


def test_interfaces_sit_at_their_centroids_on_the_one_node() -> None:
    part = reduce_rigid(COMPONENT, PROPERTIES)
    assert part.interface_maps["top"].node == 0
    np.testing.assert_array_equal(part.interface_maps["top"].frame.origin, TOP)


def test_body_loads_and_tractions_act_in_machine_axes_with_their_moments() -> None:
    turn = rotation_about(np.array([0.0, 0.0, 1.0]), 0.4)
    turned = dataclasses.replace(COMPONENT, placement=Frame(np.array([1.0, 0.0, 0.0]), turn))
    loads = {
        "fall": Load("fall", "table", "body", vector=(1.0, 2.0, -3.0)),
        "push": Load("push", "table", "traction", patches=(Patch("z+"),), vector=(100.0, 0.0, 0.0)),
        "other": Load("other", "elsewhere", "body", vector=(1.0, 0.0, 0.0)),
    }
    part = reduce_rigid(turned, PROPERTIES, tuple(loads.values()))
    machine = Machine(
        "m", {"table": turned}, loads={name: loads[name] for name in ("fall", "push")}
    )
    coupled = couple({"table": part}, machine, Pose("home"))
    np.testing.assert_allclose(
        coupled.loads["fall"],
        coupled.basis.T @ [*(part.mass_kg * np.array([1.0, 2.0, -3.0])), 0, 0, 0],
        rtol=1e-13,
        atol=1e-13,
    )
    force = np.array([2.0, 0.0, 0.0])
    expected = [*force, *np.cross(turn @ (TOP - PROPERTIES.center), force)]
    np.testing.assert_allclose(
        coupled.loads["push"], coupled.basis.T @ expected, rtol=1e-13, atol=1e-14
    )


@pytest.mark.parametrize(
    ("volume", "mass"),
    [(0.0, None), (np.nan, None), (np.inf, 1.0), (-1.0, 1.0), (1.0, -2.0), (1.0, np.nan)],
)
def test_impossible_mass_properties_are_refused(volume: float, mass: float | None) -> None:
    with pytest.raises(ModelError, match="'table'"):
        reduce_rigid(
            dataclasses.replace(COMPONENT, mass=mass),
            dataclasses.replace(PROPERTIES, volume=volume),
        )


def test_a_pressure_on_a_rigid_body_is_refused_with_a_remedy() -> None:
    load = Load("squeeze", "table", "pressure", patches=(Patch("z+"),), magnitude=1e5)
    with pytest.raises(ModelError, match=r"'squeeze'.*make the component elastic"):
        reduce_rigid(COMPONENT, PROPERTIES, [load])

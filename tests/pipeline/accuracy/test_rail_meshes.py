"""Meshes that a search chooses tell the control points of their rails apart."""

import pytest

from headstock.geometry.parts.components import Component, Interface, Material, Patch, RailSettings
from headstock.geometry.parts.solids import Box
from headstock.pipeline.accuracy.settings import refine_mesh, start_component

LENGTH, POINTS = 0.88, 23
INTERVAL = LENGTH / (POINTS - 3)


def make_table(height: float) -> Component:
    rail = Interface(
        "rail",
        (Patch("z-", "strip", size=(0.03,), along="x"),),
        "average",
        rail=RailSettings("x", POINTS),
    )
    steel = Material("steel", 210e9, 0.3, 7850.0)
    return Component("table", Box((LENGTH, 0.4, height)), steel, interfaces={"rail": rail})


@pytest.mark.parametrize("height", [0.05, 0.1, 0.2])
@pytest.mark.parametrize("rough", [None, 0.05])
def test_elements_are_no_longer_than_two_intervals(height: float, rough: float | None) -> None:
    start = start_component(make_table(height), 0.05, 500.0, rough_for=rough)
    assert start.mesh.size is not None and start.mesh.size <= 2.0 * INTERVAL
    finer = refine_mesh(start, ratio=0.5, trials=())
    assert finer.mesh.size is not None and finer.mesh.size <= 2.0 * INTERVAL

"""An exported superelement serves another scene as the component itself would."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from common import approx, make_box, make_component, present
from fixture_machines import stored_scene
from headstock.geometry.parts.components import Interface, Patch, RailSettings
from headstock.pipeline.exports import export_superelement
from headstock.pipeline.numbers.estimates import REDUCTION
from headstock.pipeline.runner import run_scene
from headstock.pipeline.storage.records import RecordError
from headstock.pipeline.storage.store import Store
from headstock.pipeline.storage.superelements import read_superelement, write_superelement
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.rails import carriage_rows
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError

SCENE = stored_scene("superelement_export")
ELASTIC = """solid = { box = ["38 mm", "100 mm", "500 mm"] }
material = "steel"
mesh = { size = "30 mm" }
reduction = { modes = 10 }
interfaces = { foot = { face = "z-" }, tip = { face = "z+", coupling = "average" } }"""


@pytest.mark.parametrize("coupling", ['"average"', '{ flexible = 9, form = "weak" }'])
def test_an_exported_superelement_gives_the_same_machine(tmp_path: Path, coupling: str) -> None:
    store = Store(tmp_path / "store")
    elastic, imported = tmp_path / "elastic.toml", tmp_path / "imported.toml"
    elastic.write_text(SCENE.replace("SOLID", ELASTIC.replace('"average"', coupling)))
    scene = load_scene(elastic)
    export_superelement(scene, "column", tmp_path / "column.h5", comm=MPI.COMM_SELF, store=store)
    imported.write_text(SCENE.replace("SOLID", 'solid = { superelement = "column.h5" }'))
    first = run_scene(scene, tmp_path / "a", comm=MPI.COMM_SELF, store=store)
    second = run_scene(load_scene(imported), tmp_path / "b", comm=MPI.COMM_SELF, store=store)
    assert second.modal[0].frequencies_hz == approx(first.modal[0].frequencies_hz, rel=1e-12)
    bounds = [
        [present(error.shares[REDUCTION]) for error in results.modal[0].list_errors()]
        for results in (first, second)
    ]
    assert bounds[1] == approx(bounds[0], rel=1e-6) and bounds[0][-1] > 0.0
    given, found = (results.static["reference"]["tcp"].compliance for results in (first, second))
    assert np.abs(found - given).max() <= 1e-12 * np.abs(given).max()


def test_a_component_that_does_not_exist_is_named(tmp_path: Path) -> None:
    scene_file = tmp_path / "elastic.toml"
    scene_file.write_text(SCENE.replace("SOLID", ELASTIC))
    with pytest.raises(SceneError, match=r"did you mean 'column'\? components: column"):
        export_superelement(
            load_scene(scene_file),
            "colum",
            tmp_path / "x.h5",
            comm=MPI.COMM_SELF,
            store=Store(tmp_path / "s"),
        )


def test_a_rail_and_its_control_points_go_through_a_file(tmp_path: Path) -> None:
    rail = Interface("rail", (Patch("z+"),), "average", rail=RailSettings("x", 6))
    mesh = make_box((4, 1, 1), (0.4, 0.05, 0.05), {"rail": "z+", "foot": "z-"})
    component = make_component({"foot": "rigid"})
    component = dataclasses.replace(component, interfaces=component.interfaces | {"rail": rail})
    element = reduce_elastic(component, mesh, comm=MPI.COMM_SELF)
    write_superelement(tmp_path / "bed.h5", element)
    found = read_superelement(tmp_path / "bed.h5")
    assert len(found.control_points) == 6 and found.boundary_size == element.boundary_size
    expected = carriage_rows(element.rails["rail"], 0.17, 0.25)
    np.testing.assert_array_equal(carriage_rows(found.rails["rail"], 0.17, 0.25), expected)
    truncation = present(element.errors.truncation)
    np.testing.assert_array_equal(present(found.errors.truncation).first, truncation.first)
    wrong = dataclasses.replace(truncation, second=truncation.second[:-1])
    write_superelement(
        tmp_path / "wrong.h5",
        dataclasses.replace(element, errors=dataclasses.replace(element.errors, truncation=wrong)),
    )
    with pytest.raises(RecordError, match="truncation/second has shape"):
        read_superelement(tmp_path / "wrong.h5")
    short = dataclasses.replace(element.rails["rail"], control=element.rails["rail"].control[:-4])
    write_superelement(tmp_path / "short.h5", dataclasses.replace(element, rails={"rail": short}))
    with pytest.raises(RecordError, match=r"rails/rail/control.*\(20, 30\).*\(24, 30\)"):
        read_superelement(tmp_path / "short.h5")


def test_deformation_shapes_that_do_not_fit_their_labels_are_refused(tmp_path: Path) -> None:
    component = make_component({"top": "rigid"})
    flexible = dataclasses.replace(component.interfaces["top"], flexible=9)
    component = dataclasses.replace(component, interfaces={"top": flexible})
    mesh = make_box((3, 3, 2), (0.3, 0.2, 0.1), {"top": "z+"})
    element = reduce_elastic(component, mesh, (), (), comm=MPI.COMM_SELF)
    entry = element.interface_maps["top"]
    shapes = present(entry.shapes)
    write_superelement(tmp_path / "good.h5", element)
    found = present(read_superelement(tmp_path / "good.h5").interface_maps["top"].shapes)
    assert (found.first, found.count, found.strong) == (6, 9, True)
    np.testing.assert_array_equal(found.half_lengths, shapes.half_lengths)
    changed = (
        dataclasses.replace(shapes, first=7),
        dataclasses.replace(shapes, normal=3),
        dataclasses.replace(shapes, half_lengths=np.zeros(2)),
    )
    for number, one in enumerate(changed):
        wrong = dataclasses.replace(entry, shapes=one)
        path = tmp_path / f"{number}.h5"
        write_superelement(path, dataclasses.replace(element, interface_maps={"top": wrong}))
        with pytest.raises(RecordError, match="deformation shapes of interface 'top'"):
            read_superelement(path)

"""Mode files can be read back: ``.vtu`` by meshio, ``.glb`` by the rules of glTF 2.0."""

import dataclasses
import json
import struct
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
import pyvista
from made_results import make_modes

from common import approx
from headstock.geometry.frames import FloatArray, Frame, rotation_about
from headstock.geometry.machine.machine import Pose
from headstock.geometry.parts.skins import box_skin
from headstock.pipeline.answers.modal import PoseModes
from headstock.pipeline.results.mode_files import (
    SHOWN_SHARE,
    _encode_glb,
    file_stem,
    machine_size,
    write_mode_files,
)
from headstock.pipeline.results.views import MachineView, PoseView
from headstock.pipeline.storage.outputs import replace_outputs

NAMES = ("base", 'slider "<&> 2"')
MODES = make_modes([0.0, 87.25], ["free", "slider moves"], "a/b", rigid_count=1)
ARRAYS = ("mode 01 shape [m/sqrt(kg)]", "mode 02 shape [m/sqrt(kg)]", "static tcp x shape [m/N]")
Gltf = dict[str, Any]  # JSON of glTF 2.0


def make_view() -> MachineView:
    skins = {name: box_skin(np.zeros(3), np.full(3, 0.1 * (i + 1))) for i, name in enumerate(NAMES)}
    turn = rotation_about(np.array([0.0, 0.0, 1.0]), np.pi / 2)
    placements = {NAMES[0]: Frame(), NAMES[1]: Frame(np.array([1.0, 2.0, 3.0]), turn)}
    rng = np.random.default_rng(1)
    shifts = {name: rng.normal(size=(2, 8, 3)).astype(np.float32) for name in NAMES}
    pushes = {name: rng.normal(size=(8, 3)).astype(np.float32) for name in NAMES}
    return MachineView(skins, {}, {"a/b": PoseView(placements, {}, {}, shifts, {"tcp x": pushes})})


def write_modes(folder: Path, modes: PoseModes) -> Path:
    assert write_mode_files(folder, [modes], make_view()) == []
    return folder / "modes" / "a_b.vtu"


def read_glb(content: bytes) -> tuple[Gltf, bytes]:
    magic, version, length = struct.unpack_from("<4sII", content)
    assert (magic, version, length) == (b"glTF", 2, len(content))
    size, kind = struct.unpack_from("<I4s", content, 12)
    assert kind == b"JSON" and size % 4 == 0
    start = 20 + size
    binary, tag = struct.unpack_from("<I4s", content, start)
    assert tag == b"BIN\0" and start + 8 + binary == len(content)
    return json.loads(content[20 : 20 + size]), content[start + 8 :]


def accessor(gltf: Gltf, binary: bytes, number: int) -> FloatArray:
    about = gltf["accessors"][number]
    view = gltf["bufferViews"][about["bufferView"]]
    width = {"SCALAR": 1, "VEC3": 3}[about["type"]]
    kind = {5126: "<f4", 5125: "<u4"}[about["componentType"]]
    assert view["byteOffset"] % 4 == 0
    assert view["byteLength"] == 4 * width * about["count"]
    assert view["byteOffset"] + view["byteLength"] <= gltf["buffers"][0]["byteLength"]
    return np.frombuffer(binary, kind, width * about["count"], view["byteOffset"]).reshape(
        -1, width
    )


def test_a_vtu_holds_the_placed_surface_and_every_mode(tmp_path: Path) -> None:
    view = make_view()
    mesh = meshio.read(write_modes(tmp_path, MODES))
    assert len(mesh.points) == 16
    np.testing.assert_allclose(mesh.points[8:].min(axis=0), [0.8, 2.0, 3.0], atol=1e-12)
    (cells,) = mesh.cells
    assert cells.type == "triangle" and len(cells.data) == 24 and cells.data.max() == 15
    np.testing.assert_array_equal(mesh.point_data["component"], [0] * 8 + [1] * 8)
    assert list(mesh.point_data) == ["component", *ARRAYS]
    np.testing.assert_array_equal(
        mesh.point_data[ARRAYS[2]], np.vstack([view.poses["a/b"].pushes["tcp x"][n] for n in NAMES])
    )
    found = mesh.point_data[ARRAYS[1]]
    np.testing.assert_array_equal(
        found, np.vstack([view.poses["a/b"].shifts[name][1] for name in NAMES])
    )


@pytest.mark.parametrize("hz", [87.25, 91.5])
def test_the_frequencies_of_a_vtu_stand_in_its_field_data_and_its_names_do_not_change_with_them(
    tmp_path: Path, hz: float
) -> None:
    modes = dataclasses.replace(
        MODES, frequencies_hz=np.array([0.0, hz]), damping_ratio=(None, 0.02)
    )
    grid = pyvista.read(write_modes(tmp_path, modes))
    np.testing.assert_array_equal(grid.field_data["frequencies [Hz]"], [0.0, hz])
    np.testing.assert_array_equal(grid.field_data["damping ratios [1]"], [np.nan, 0.02])
    assert grid.point_data.keys() == ["component", *ARRAYS]


def test_static_shapes_are_written_without_modes(tmp_path: Path) -> None:
    view = make_view()
    pose = dataclasses.replace(view.poses["a/b"], shifts={})
    assert write_mode_files(tmp_path, [], dataclasses.replace(view, poses={"a/b": pose})) == []
    written = sorted((tmp_path / "modes").iterdir())
    assert [path.name for path in written] == ["a_b.vtu", "poses.pvd"]
    assert list(meshio.read(written[0]).point_data) == ["component", ARRAYS[2]]


def test_the_poses_are_the_steps_of_one_collection_with_the_same_arrays(tmp_path: Path) -> None:
    view = make_view()
    moved = dataclasses.replace(
        view.poses["a/b"], placements={name: Frame(np.full(3, 5.0)) for name in NAMES}
    )
    both = dataclasses.replace(view, poses={"z": view.poses["a/b"], "a": moved})
    modal = [dataclasses.replace(MODES, pose=Pose(name)) for name in both.poses]
    write_mode_files(tmp_path, modal, both)
    reader = pyvista.get_reader(tmp_path / "modes" / "poses.pvd")
    assert reader.time_values == [0.0, 1.0]
    steps = []
    for time in reader.time_values:
        reader.set_active_time_value(time)
        steps.append(reader.read()[0])
    assert steps[0].point_data.keys() == steps[1].point_data.keys() == ["component", *ARRAYS]
    # in the order of the scene, not of the names
    np.testing.assert_allclose(steps[1].points.min(axis=0), 5.0 - np.array([0.0, 0.0, 0.0]))


def test_a_glb_moves_every_body_from_rest_to_the_shown_amplitude_and_back() -> None:
    view = make_view()
    pose = view.poses["a/b"]
    gltf, binary = read_glb(_encode_glb(view, pose, MODES, 1))
    assert [mesh["name"] for mesh in gltf["meshes"]] == list(NAMES)
    assert gltf["scenes"][0]["name"] == "87.250 Hz: slider moves"
    largest = 0.0
    for name, mesh in zip(NAMES, gltf["meshes"], strict=True):
        (primitive,) = mesh["primitives"]
        place = accessor(gltf, binary, primitive["attributes"]["POSITION"])
        move = accessor(gltf, binary, primitive["targets"][0]["POSITION"])
        frame = pose.placements[name]
        np.testing.assert_allclose(
            place, view.skins[name].points @ frame.rotation.T + frame.origin, atol=1e-6
        )
        np.testing.assert_array_equal(
            accessor(gltf, binary, primitive["indices"]).ravel(), view.skins[name].triangles.ravel()
        )
        bounds = gltf["accessors"][primitive["attributes"]["POSITION"]]
        np.testing.assert_allclose(
            [bounds["min"], bounds["max"]], [place.min(axis=0), place.max(axis=0)]
        )
        largest = max(largest, float(np.linalg.norm(move, axis=1).max()))
    assert largest == approx(SHOWN_SHARE * machine_size(view, pose), rel=1e-6)
    (animation,) = gltf["animations"]
    weights = accessor(gltf, binary, animation["samplers"][0]["output"]).ravel()
    assert weights[[0, 6, 12, 18, 24]] == approx([0, 1, 0, -1, 0], abs=1e-6)
    assert {channel["target"]["node"] for channel in animation["channels"]} == {0, 1}


def test_files_are_named_after_pose_and_number_and_those_of_an_earlier_run_go(
    tmp_path: Path,
) -> None:
    (tmp_path / "modes").mkdir()
    replace_outputs(tmp_path, "modes", {"old_01.glb": b"old"})
    assert write_mode_files(tmp_path, [MODES], make_view()) == []
    assert sorted(path.name for path in (tmp_path / "modes").iterdir()) == [
        "a_b.vtu",
        "a_b_01.glb",
        "a_b_02.glb",
        "poses.pvd",
    ]


def test_a_run_without_modes_leaves_no_folder(tmp_path: Path) -> None:
    assert write_mode_files(tmp_path, [], dataclasses.replace(make_view(), poses={})) == []
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["../../etc", "a b", "", "<script>", "x" * 300, "ü"])
def test_no_name_from_a_scene_leaves_the_folder(name: str) -> None:
    stem = file_stem(name)
    assert (
        stem
        and len(stem) <= 80
        and set(stem) <= set("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-")
    )

"""From scene text to machine: values, unit systems, axes, loads, orientation, the scenes that ship,
and the JSON schema.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import cases
from fixture_machines import stored_scene, write_scene
from headstock.app.actions.schemas import scene_schema
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.joints import JointEnd
from headstock.geometry.machine.machine import Machine, place_components
from headstock.geometry.parts import solids
from headstock.geometry.parts.components import Patch
from headstock.geometry.parts.solids import (
    Box,
    MeshFile,
    SuperelementFile,
)
from headstock.scene.analyses.contouring import ContouringRequest
from headstock.scene.analyses.modal import ModalRequest
from headstock.scene.analyses.path import PathRequest
from headstock.scene.analyses.static import StaticRequest
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError

MACHINES = Path(__file__).resolve().parents[3] / "machines"
STEEL = '[materials.steel]\nE = "210 GPa"\nnu = 0.3\nrho = "7850 kg/m^3"\n'

SI = stored_scene("loader_si")
MM_T_S = stored_scene("loader_mm_t_s")


def load(folder: Path, text: str, **options: Any) -> Machine:
    path = write_scene(folder, text)
    return load_scene(path, **options).machine


def numbers(machine: Machine) -> FloatArray:
    bar, joint, load_ = machine.components["bar"], machine.joints["base"], machine.loads["push"]
    patch = bar.interfaces["foot"].patches[0]
    assert isinstance(bar.solid, Box)
    assert joint.point is not None
    values = [
        *bar.solid.size,
        bar.material.youngs_modulus,
        bar.material.poisson_ratio,
        bar.material.density,
        bar.mass,
        bar.mesh.size,
    ]
    values += [
        *bar.placement.origin,
        *bar.placement.rotation.ravel(),
        *patch.center,
        *patch.size,
        *joint.point,
    ]
    values += [*joint.stiffness.ravel(), *joint.damping.ravel(), *load_.vector]
    return np.array(values, dtype=float)


def test_the_same_scene_in_mm_t_s_and_in_si_is_the_same_machine(tmp_path: Path) -> None:
    np.testing.assert_allclose(
        numbers(load(tmp_path, MM_T_S)), numbers(load(tmp_path, SI)), rtol=1e-12, atol=0.0
    )


def test_lengths_are_the_same_floats_in_every_unit(tmp_path: Path) -> None:
    assert (
        load(tmp_path, MM_T_S).components["bar"].solid == load(tmp_path, SI).components["bar"].solid
    )


@cases
def test_a_solid_is_what_the_scene_says(
    tmp_path: Path, text: str, kind: str, sizes: tuple[Any, ...]
) -> None:
    machine = load(
        tmp_path,
        f'free = true\n{STEEL}[components.part]\nsolid = {{ {text} }}\nmaterial = "steel"\n',
    )
    assert machine.components["part"].solid == getattr(solids, kind)(*sizes)


def test_files_beside_the_scene_become_solids(tmp_path: Path) -> None:
    (tmp_path / "part.inp").write_text("")
    (tmp_path / "part.h5").write_text("")
    text = f'free = true\n{STEEL}[components.part]\nsolid = {{ mesh = "part.inp", unit = "1 mm" }}\nmaterial = "steel"\n'
    text += '[components.part.interfaces]\nfoot = { face = "set:FOOT" }\n[components.black_box]\nsolid = { superelement = "part.h5" }\n'
    text += '[points]\np = { tool = "black_box.anything", work = "part.foot" }\n'
    machine = load(tmp_path, text)
    assert machine.components["part"].solid == MeshFile((tmp_path / "part.inp").resolve(), 1e-3)
    assert machine.components["black_box"].solid == SuperelementFile(
        (tmp_path / "part.h5").resolve()
    )
    assert machine.points["p"].tool == JointEnd("black_box", "anything")


@cases
def test_an_interface_s_patches_are_what_the_scene_says(
    tmp_path: Path, text: str, patches: tuple[Any, ...]
) -> None:
    solid = 'solid = { box = ["100 mm", "100 mm", "500 mm"] }'
    machine = load(
        tmp_path,
        f'free = true\n{STEEL}[components.p]\n{solid}\nmaterial = "steel"\ninterfaces.i = {{ {text} }}\n',
    )
    expected = tuple(Patch(*patch) for patch in patches)
    assert machine.components["p"].interfaces["i"].patches == expected


def test_rotations_are_applied_in_the_order_they_are_written(tmp_path: Path) -> None:
    turns = '[{ axis = "x", angle = "90 deg" }, { axis = "z", angle = "90 deg" }]'
    text = f'free = true\n{STEEL}[components.p]\nsolid = {{ box = ["1 m", "1 m", "1 m"] }}\nmaterial = "steel"\nrotate = {turns}\n'
    rotation = load(tmp_path, text).components["p"].placement.rotation
    # z to -y, then -y to x
    np.testing.assert_allclose(rotation @ [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], atol=1e-15)


def test_the_orientation_turns_the_machine_and_leaves_gravity(tmp_path: Path) -> None:
    text = (
        SI
        + '[effects]\ngravity = true\n[orientation]\nat = ["1 m", "0 m", "0 m"]\nrotate = { axis = "y", angle = "90 deg" }\n'
    )
    plain, turned = load(tmp_path, SI), load(tmp_path, text)
    rotation = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    expected = rotation @ plain.components["bar"].placement.origin + [1.0, 0.0, 0.0]
    np.testing.assert_allclose(turned.components["bar"].placement.origin, expected, atol=1e-15)
    np.testing.assert_allclose(
        turned.joints["base"].rotation, rotation @ plain.joints["base"].rotation, atol=1e-15
    )
    assert turned.gravity == (0.0, 0.0, -9.80665)


@cases
def test_effects_are_off_unless_named(
    tmp_path: Path, text: str, gravity: tuple[float, ...], effects: tuple[str, ...]
) -> None:
    path = write_scene(tmp_path, text + SI)
    scene = load_scene(path)
    assert scene.machine.gravity == gravity
    assert scene.effects == frozenset(effects)


def test_supports_and_loads_carry_their_patches(tmp_path: Path) -> None:
    text = SI + (
        '[supports.wall]\nface = "bar.y-"\nfix = ["y"]\n[supports.foot]\nat = "bar.foot"\nfix = ["z", "x"]\n'
        '[loads.oil]\nface = "bar.x+"\npressure = "1 bar"\n[loads.drag]\nat = "bar.foot"\ntraction = ["1 MPa", "0 Pa", "0 Pa"]\n'
        '[loads.weight]\ncomponent = "bar"\nbody = ["0 m/s^2", "0 m/s^2", "-9.81 m/s^2"]\n'
    )
    machine = load(tmp_path, text)
    foot = machine.components["bar"].interfaces["foot"].patches
    assert machine.supports["wall"].patches == (Patch("y-"),)
    assert machine.supports["foot"].patches == foot
    assert machine.supports["foot"].directions == ("z", "x")
    assert (machine.loads["oil"].kind, machine.loads["oil"].magnitude) == ("pressure", 1e5)
    assert (machine.loads["drag"].patches, machine.loads["drag"].vector) == (foot, (1e6, 0.0, 0.0))
    assert (machine.loads["weight"].kind, machine.loads["weight"].vector) == (
        "body",
        (0.0, 0.0, -9.81),
    )
    assert machine.loads["push"].vector == (1000.0, 0.0, 0.0, 0.0, 5.0, 0.0)


def test_the_axes_of_the_three_axis_machine_carry_what_lies_beyond_their_joints() -> None:
    machine = load_scene(MACHINES / "three_axis.toml").machine
    moves = {name: axis.moves for name, axis in machine.axes.items()}
    assert moves == {"X": ("x_slider",), "Y": ("y_slider", "z_slider"), "Z": ("z_slider",)}
    assert all(axis.limits == (-0.1, 0.1) for axis in machine.axes.values())


@cases
def test_the_three_axis_machine_has_the_paper_s_variants(
    variant: str, elastic: tuple[str, ...]
) -> None:
    scene = load_scene(MACHINES / "three_axis.toml", variant=variant or None)
    assert {
        name
        for name, component in scene.machine.components.items()
        if component.fidelity == "elastic"
    } == set(elastic)
    assert scene.warnings == ()
    assert scene.machine.joints["left_foot_bolts"].fixed == (
        (0, 1, 5) if variant == "BE" else (0, 1, 2, 3, 4, 5)
    )


@pytest.mark.parametrize("variant", ["R", "BE", "CE", "YE", "YCE"])
def test_what_is_elastic_in_a_variant_of_the_three_axis_machine_can_be_segmented_instead(
    variant: str,
) -> None:
    elastic, segmented = (
        load_scene(MACHINES / "three_axis.toml", variant=name)
        for name in (variant, f"segmented+{variant}")
    )
    assert set(segmented.machine.components) == set(elastic.machine.components) != set()
    for name, component in elastic.machine.components.items():
        expected = "segmented" if component.fidelity == "elastic" else component.fidelity
        assert segmented.machine.components[name].fidelity == expected


@pytest.mark.parametrize("variant", [None, "thicker", "calibrated"])
@pytest.mark.parametrize(
    "joint", ["left_foot_bolts", "right_foot_bolts", "left_head_bolts", "right_head_bolts"]
)
def test_bolted_faces_of_the_three_axis_machine_lie_on_each_other(
    joint: str, variant: str | None
) -> None:
    scene = load_scene(MACHINES / "three_axis.toml", variant=variant)
    machine = scene.machine
    frames = place_components(machine, scene.poses["reference"])
    places = []
    for end in machine.joints[joint].ends:
        assert end.component is not None
        assert end.interface is not None
        component = machine.components[end.component]
        patch = component.interfaces[end.interface].patches[0]
        assert isinstance(component.solid, Box)
        x, y, z = component.solid.size
        center = np.array(patch.center)
        axis = "xyz".index(patch.face[0])
        low, high = ((-x / 2, x / 2), (-y / 2, y / 2), (0.0, z))[axis]
        center[axis] = high if patch.face[1] == "+" else low
        places.append(frames[end.component].origin + frames[end.component].rotation @ center)
    assert len(places) == 2
    np.testing.assert_allclose(places[0], places[1], atol=1e-12)


@pytest.mark.parametrize("name", ["cantilever", "fixed_beam"])
def test_the_beam_scenes_load_without_warnings(name: str) -> None:
    scene = load_scene(MACHINES / f"{name}.toml")
    assert scene.warnings == ()
    assert scene.analyses[ModalRequest].count == 6
    assert StaticRequest in scene.analyses
    for variant in scene.variants:
        assert load_scene(MACHINES / f"{name}.toml", variant=variant).warnings == ()


def test_the_json_schema_names_every_section_and_is_json() -> None:
    schema = json.loads(json.dumps(scene_schema()))
    assert {"materials", "components", "joints", "axes", "analyses", "variants"} <= set(
        schema["properties"]
    )
    assert schema["additionalProperties"] is False


def test_a_cut_of_the_contour_lets_a_path_mill_nothing() -> None:
    """The effect has something to cut; with neither a contour nor a cut of the path it has not."""
    path = 'analyses.path={ from = { X = "-9 mm" }, to = { X = "9 mm" }, feeds = ["1 m/min"], time_constant = "50 ms" }'
    scene = load_scene(MACHINES / "three_axis.toml", variant="R+milling", overrides=(path,))
    assert PathRequest in scene.analyses and scene.analyses[PathRequest].cut is None
    assert ContouringRequest in scene.analyses and scene.analyses[ContouringRequest].cutting
    with pytest.raises(SceneError, match="nothing is milled"):
        load_scene(
            MACHINES / "three_axis.toml",
            variant="R+milling",
            overrides=(path, "analyses.contouring=false"),
        )

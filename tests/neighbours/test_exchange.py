"""What other programs say of our files: ``./headstock test -m neighbours tests/neighbours``."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from common import Shell, approx
from fixture_machines import stored_scene
from headstock.pipeline.storage.superelements import read_superelement
from headstock.reduction.superelement_checks import rigid_motions

pytestmark = [pytest.mark.neighbours, pytest.mark.filterwarnings("ignore")]
MILL = Path(__file__).parents[2] / "machines" / "mill.toml"
COARSE = "--variant coarse"
STEP = 1e-3


def reduce_head(shell: Shell, form: str) -> None:
    shell(
        f"export {MILL} head {COARSE} --to {form}", "--set", "components.head.reduction={modes = 8}"
    )


def test_pyyeti_finds_nothing_to_complain_about(shell: Shell) -> None:
    from pyyeti import cb
    from pyyeti.nastran import bulk, n2p, op4

    reduce_head(shell, "op4")
    reduce_head(shell, "h5")
    ours = read_superelement(Path("head.h5"))
    read = op4.load("head.op4", into="dct")
    stiffness, mass = read["kaax"][0], read["maax"][0]
    assert np.array_equal(stiffness, ours.stiffness) and np.array_equal(mass, ours.mass)
    grids = bulk.rdgrids("head_points.bdf")
    nodes = np.column_stack([np.ones(len(grids)), grids[:, 2:5]])
    uset = n2p.addgrid(None, grids[:, 0].astype(int), "b", 0, nodes[:, 1:], 0)
    boundary = np.arange(6 * len(grids))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = cb.cbcheck("checked.txt", mass, stiffness, boundary, boundary[:6], uset)
    text = Path("checked.txt").read_text()
    assert not any(word in text for word in ("CHECK!", "FAIL", "Warning"))
    # its own marks miss an interface 1 mm off: its rigid motions must be ours
    rigid = rigid_motions(ours, np.zeros(3))[boundary]
    assert np.asarray(found.rbg)[: len(boundary)] == approx(rigid, abs=1e-9)


def test_pynastran_and_pyyeti_read_the_same_matrices(shell: Shell) -> None:
    from pyNastran.bdf.bdf import read_bdf
    from pyNastran.op4.op4 import read_op4
    from pyyeti.nastran import bulk

    reduce_head(shell, "op4")
    reduce_head(shell, "dmig")
    reduce_head(shell, "h5")
    ours = read_superelement(Path("head.h5"))
    read = {name.upper(): matrix for name, matrix in read_op4("head.op4").items()}
    assert np.array_equal(np.asarray(read["KAAX"].data), ours.stiffness)
    largest = np.abs(ours.stiffness).max()
    listed = bulk.rddmig("head.bdf")["kaax"].to_numpy()
    assert listed == approx(ours.stiffness, abs=1e-9 * largest)
    model = read_bdf("head.bdf", punch=True, debug=None)
    matrix, *_ = model.dmig["KAAX"].get_matrix()
    assert np.asarray(matrix) == approx(ours.stiffness, abs=1e-9 * largest)


@pytest.mark.parametrize("version", [2, 3])
def test_fmpy_validates_and_moves_an_axis(shell: Shell, version: int) -> None:
    import fmpy
    from fmpy import validation

    words = f"--variant rigid --to fmu{version} --hz 300Hz --travel Z -o moving.fmu"
    shell(f"export {MILL} {words}")
    assert validation.validate_fmu("moving.fmu") == []
    time = np.arange(0.0, 0.2, STEP)
    kinds = [("time", float), ("position.Z", float), ("force.tcp.x", float)]
    signals = np.array(list(zip(time, -0.5 * time, 0.0 * time + 100.0, strict=True)), dtype=kinds)
    done = fmpy.simulate_fmu(
        "moving.fmu", stop_time=time[-1], step_size=STEP, output_interval=STEP, input=signals
    )
    moved = done["motion.tcp.x"]
    assert np.isfinite(moved).all() and 1e-7 < np.abs(moved).max() < 1e-4


@pytest.mark.parametrize("version", [2, 3])
def test_fmpy_validates_compiles_and_runs_the_mill(shell: Shell, version: int) -> None:
    import fmpy
    from fmpy import validation

    shell(f"export {MILL} {COARSE} --to fmu{version} -o mill.fmu", "--state-space", "400 Hz")
    shell(f"export {MILL} {COARSE} --to mat -o mill.mat", "--state-space", "400 Hz")
    assert validation.validate_fmu("mill.fmu") == []
    description: Any = fmpy.read_model_description("mill.fmu")
    names = [v.name for v in description.modelVariables if v.causality == "input"]
    time = np.arange(0.0, 0.1, STEP)
    force = np.sin(2.0 * np.pi * 70.0 * time)
    signals = np.array(
        list(zip(time, *([force] * len(names)), strict=True)),
        dtype=[("time", float), *((name, float) for name in names)],
    )
    done = fmpy.simulate_fmu(
        "mill.fmu", stop_time=time[-1], step_size=STEP, output_interval=STEP, input=signals
    )
    import control
    import scipy.io

    space = scipy.io.loadmat("mill.mat")
    held = control.c2d(control.ss(space["A"], space["B"], space["C"], space["D"]), STEP, "zoh")
    forces = np.tile(force, (len(names), 1))
    _, exact = control.forced_response(held, time, forces)
    motions = [v.name for v in description.modelVariables if v.causality == "output"]
    # after a step the input of that step is seen in D
    seen = np.array([done[name] for name in motions])[:, 1:]
    states = exact[:, 1:] - space["D"] @ forces[:, 1:] + space["D"] @ forces[:, :-1]
    assert seen == approx(states, abs=1e-9 * np.abs(states).max())


def test_python_control_closes_the_loop_of_an_own_controller_as_the_scene_does(
    shell: Shell,
) -> None:
    import control

    num, den = [2e3, 1e5, 1e6], [1e-4, 1.0, 0.0]
    law = f"controller = {{ num = {num}, den = {den} }}\nencoder = 'scale'"
    cascade = 'kv = "50 1/s"\nvelocity_gain = "2e4 N s/m"\nintegral_time = "20 ms"'
    shell.write(stored_scene("control"), (cascade, law))
    export = "export scene.toml --to npz --state-space 20kHz"
    for motors in ("free", "controlled"):
        shell(f"{export} --motors {motors} -o {motors}.npz")
    spaces = [np.load(f"{motors}.npz") for motors in ("free", "controlled")]
    free, scene = (
        control.ss(
            *(space[key] for key in "ABCD"),
            inputs=[f"{name} in" for name in space["inputs"]],  # equal names would be connected
            outputs=[*space["outputs"]],
        )
        for space in spaces
    )
    named = control.tf(num, den, inputs="error", outputs="X force in")
    difference = control.summing_junction(["X position in", "-X scale"], "error")
    wanted = ["tcp x", "X motor", "X scale"]
    loop = control.interconnect(
        [free, control.ss(named), difference], inputs=["X position in", "tcp x in"], outputs=wanted
    )
    omega = 2.0 * np.pi * np.geomspace(1.0, 400.0, 60)
    expected = loop(1j * omega)
    ours = scene(1j * omega)
    rows = [scene.output_labels.index(name) for name in wanted]
    columns = [scene.input_labels.index(name) for name in ("X position in", "tcp x in")]
    found = ours[np.ix_(rows, columns)]
    scale = np.abs(expected).max(axis=2, keepdims=True)
    assert (np.abs(found - expected) / scale).max() < 1e-6


def test_pygltflib_and_vtk_open_the_modes_of_a_run(shell: Shell) -> None:
    import pygltflib
    import pyvista
    from pygltflib import validator

    shell(f"run {MILL} {COARSE} --analysis modal -o out --no-figures")
    modes = sorted(Path("out/modes").glob("*.glb"))
    first = pygltflib.GLTF2().load(str(modes[0]))
    validator.validate(first)  # raises
    assert len(modes) > 3
    (animation,) = first.animations
    assert {channel.target.path for channel in animation.channels} == {"weights"}
    targets = [p.targets for mesh in first.meshes for p in mesh.primitives]
    assert targets and all(len(target) == 1 for target in targets)
    reader = pyvista.get_reader("out/modes/poses.pvd")
    grid = reader.read()[0]
    shapes = [name for name in grid.point_data if "shape [m/sqrt(kg)]" in name]
    assert len(grid.field_data["frequencies [Hz]"]) == len(shapes)
    assert len(modes) == len(reader.time_values) * len(shapes)
    assert all(np.isfinite(grid.point_data[name]).all() for name in shapes)

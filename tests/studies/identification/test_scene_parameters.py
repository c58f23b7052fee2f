"""Numbers of a scene's own [parameters] are fitted: everything that is calculated from them moves
along, and the values come back with which the data were computed.
"""

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

import headstock as hs
from common import Shell, approx
from fixture_machines import write_scene
from headstock.geometry.frames import FloatArray
from headstock.pipeline.storage.store import Store
from headstock.studies.identification.identification import prepare_problem
from headstock.studies.identification.problem import FitProblem, data_jacobian, evaluate
from headstock.studies.identification.target_files import load_targets
from headstock.validation.machines.identification_cases import SCENE, _write_frequencies

SHORT = (
    """[parameters]
wall = "40 mm"
pad_stiffness = "50 N/um"
stretch = 1.0
track = "= 2 * wall"
"""
    + SCENE.replace('box = ["40 mm", "100 mm", ', 'box = ["= wall", "= stretch * [100 mm]", ')
    .replace('lateral = "40 N/um", normal = "50 N/um"', 'lateral = "= 0.8 * pad_stiffness", normal = "= pad_stiffness"')
    .replace('"40 mm", "710 mm"', '"= track / 2", "710 mm"')
    .replace('"-40 mm", "710 mm"', '"= -track / 2", "710 mm"')
)  # fmt: skip
TRUTH = {"wall": "46 mm", "pad_stiffness": "71 N/um", "stretch": 1.13}
TARGETS = """
[fit]
starts = 2
[parameters.wall]
keys = ["parameters.wall"]
bounds = ["30 mm", "60 mm"]
[parameters.pads]
keys = ["parameters.pad_stiffness"]
bounds = ["20 N/um", "150 N/um"]
prior = "60 N/um"
prior_sigma = 3.0
[parameters.stretch]
shifts = ["parameters.stretch"]
scale = "linear"
bounds = [-0.3, 0.3]
"""


TRUE_KEYS = {f"parameters.{key}": value for key, value in TRUTH.items()}


def measure(machine: hs.Machine, pose: str) -> FloatArray:
    """Frequencies that a run finds [Hz]."""
    return hs.run(machine, analyses=["modal"]).modes[pose].frequencies_hz


def prepare(scene: Path, targets: str) -> FitProblem:
    path = write_scene(scene.parent, targets, name="targets")
    return prepare_problem(load_targets(path, scene), Store(scene.parent), MPI.COMM_SELF)


def write_case(name: str, scene: Path, *, variant: str | None, pose: str) -> str:
    """A case of the target file with the frequencies of the true values."""
    found = measure(hs.load(scene, variant=variant, set=TRUE_KEYS), pose)
    choice = f'variant = "{variant}"\n' if variant else ""
    frequencies = _write_frequencies(found[:6])
    return f'[cases.{name}]\n{choice}pose = "{pose}"\nfrequencies = {frequencies}\n'


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    return write_scene(tmp_path, SHORT, name="machine")


def identify(shell: Shell, scene: Path, targets: str) -> str:
    """What the command prints; its files are in ``out``."""
    shell.write(targets, name="targets")
    return shell(f"identify {scene.name} targets.toml -o out").out


@pytest.mark.trials
def test_parameters_of_the_scene_are_found_again(scene: Path, shell: Shell) -> None:
    cases = write_case("written", scene, variant=None, pose="middle")
    cases += write_case("stiff", scene, variant="stiff", pose="out")
    assert "wall" in identify(shell, scene, cases + TARGETS)
    found = hs.identify(scene, "targets.toml").values
    assert found == approx({"wall": 0.046, "pads": 71e6, "stretch": 0.13}, rel=1e-4)
    # pasted into the scene, the file gives the machine with which the data were computed
    calibrated = shell.text("out/calibrated.toml")
    scene.write_text(SHORT + calibrated)
    assert "components" not in calibrated
    fitted = measure(hs.load(scene, variant="calibrated"), "middle")
    assert fitted == approx(measure(hs.load(scene, set=TRUE_KEYS), "middle"), rel=1e-5)


@pytest.mark.parametrize(
    ("old", "new", "key", "message"),
    [
        ('"parameters.wall"', '"parameters.wal"', "parameters.wall.keys[0]", "parameters holds wall, pad_stiffness"),
        ('"30 mm", "60 mm"', '"30 N/um", "60 N/um"', "parameters.wall.bounds[0]", "is a stiffness but what it moves is a length"),
        ('"parameters.wall"', '"parameters.unused"', "parameters.wall.keys[0]", "material or stiffness of the scene is calculated from 'unused'"),
        ('"parameters.wall"', '"parameters.track"', "parameters.wall.keys[0]", 'is "= 2 * wall"'),
        ('"parameters.wall"', '"parameters.out"', "parameters.wall.keys[0]", "from parameters.out that no fit takes: poses.out.X cannot be fitted"),
        ('"30 mm", "60 mm"', '"0 mm", "60 mm"]\nscale = "linear"#', "parameters.wall.bounds[0]", "at its lower bound 0 mm the scene cannot be built"),
    ],
)  # fmt: skip
def test_what_cannot_be_fitted_is_told(
    scene: Path, tmp_path: Path, old: str, new: str, key: str, message: str
) -> None:
    more = ("stretch = 1.0", 'stretch = 1.0\nunused = "35 mm"\nout = "40 mm"')
    write_scene(tmp_path, SHORT, more, ('X = "150 mm"', 'X = "= 3 * out"'), name="machine")
    case = '[cases.written]\npose = "out"\nfrequencies = ["40 Hz", "50 Hz", "60 Hz"]\n'
    assert old in TARGETS
    targets = write_scene(tmp_path, case + TARGETS.replace(old, new, 1), name="targets")
    with pytest.raises(hs.SceneError) as caught:
        hs.identify(scene, targets)
    found = [problem for problem in caught.value.problems if message in problem.message]
    assert found[0].key == key, str(caught.value)
    assert found[0].file == str(targets)


BY_KEYS = """
[parameters.wall]
keys = ["components.column.solid.box[0]", "joints.guide_1.at[1]", "joints.guide_3.at[1]"]
shifts = [{ key = "joints.guide_2.at[1]", factor = -1 }, { key = "joints.guide_4.at[1]", factor = -1 }]
bounds = ["30 mm", "60 mm"]
[parameters.pads]
keys = [
  "joints.guide_*.stiffness.normal",
  { key = "joints.guide_*.stiffness.lateral", factor = 0.8 },
]
bounds = ["20 N/um", "150 N/um"]
[parameters.stretch]
shifts = [{ key = "components.column.solid.box[1]", factor = 0.1 }]
bounds = ["-0.3 m", "0.3 m"]
scale = "linear"
"""


def test_what_follows_has_the_derivatives_of_keys_that_are_fitted_one_by_one(
    scene: Path,
) -> None:
    case = '[cases.stiff]\nvariant = "screw"\nfrequencies = ["40 Hz", "50 Hz", "60 Hz", "70 Hz"]\n'
    found = []
    for text in (TARGETS, BY_KEYS):
        problem = prepare(scene, case + text)
        point = evaluate(problem, problem.coordinates([0.044, 57e6, 0.07]))
        found.append((point.residuals, data_jacobian(problem, point)))
    (residuals, jacobian), (wanted, slopes) = found
    assert residuals == approx(wanted, rel=1e-12)
    assert jacobian == approx(slopes, abs=1e-9 * abs(slopes).max())
    assert (abs(slopes).max(axis=0) > 1e-3 * abs(slopes).max()).all()


# the column meshed coarsely, its mesh following its wall
ELASTIC = SHORT.replace(
    "segments = { count = 4 }", 'segments = { count = 4 }\nmesh = { size = "= 2 * wall" }'
)
WALL = """
[parameters.wall]
keys = ["parameters.wall"]
bounds = ["30 mm", "120 mm"]
"""


@pytest.mark.fem
@pytest.mark.trials
def test_the_wall_of_an_elastic_part_is_found_again(scene: Path, shell: Shell) -> None:
    """Each value is another mesh, so that the fit ends near the truth and not at it."""
    scene.write_text(ELASTIC)
    truth = hs.load(scene, variant="fine", set={"parameters.wall": "43 mm"})
    frequencies = _write_frequencies(measure(truth, "middle")[:6])
    case = f'[cases.fine]\nvariant = "fine"\npose = "middle"\nfrequencies = {frequencies}\n'
    printed = identify(shell, scene, case + WALL)
    assert "column is meshed and reduced anew at every value of wall" in printed
    found = shell.json("out/identification.json")
    assert found["parameters"]["wall"]["value"] == approx(43.0, rel=2e-3)


@pytest.mark.fem
@pytest.mark.parametrize("wall", ["40 mm", pytest.param("100 mm", marks=pytest.mark.trials)])
def test_derivatives_of_a_part_that_is_meshed_anew_are_those_of_the_machine(
    scene: Path, wall: str
) -> None:
    """The column of 100 mm is square: its bending modes are any two of their plane."""
    scene.write_text(ELASTIC.replace('wall = "40 mm"', f'wall = "{wall}"'))
    frequencies = '["40 Hz", "50 Hz", "60 Hz", "70 Hz"]'
    case = f'[cases.fine]\nvariant = "fine"\nfrequencies = {frequencies}\n'
    problem = prepare(scene, case + WALL)
    (place,) = problem.coordinates([problem.parameters[0].start])
    point = evaluate(problem, np.array([place]))
    ahead, behind = (
        evaluate(problem, np.array([each]), point).residuals
        for each in (place + 0.02, place - 0.02)
    )
    wanted = (ahead - behind) / 0.04
    found = data_jacobian(problem, point)[:, 0]
    assert found == approx(wanted, abs=0.02 * abs(wanted).max())

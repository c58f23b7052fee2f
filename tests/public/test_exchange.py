"""Models leave for other programs by one command, and theirs become parts of a scene."""

import ctypes
import dataclasses
import math
import shutil
import subprocess
import zipfile
from pathlib import Path
from typing import Any, Literal, cast
from xml.etree import ElementTree

import numpy as np
import pytest
import scipy.interpolate
import scipy.io
import scipy.linalg
import scipy.signal

import headstock as hs
from common import Shell, approx, read_json
from fixture_machines import stored_scene

ROOT = Path(__file__).parents[2]
STEP, STEPS = 1e-3, 200
STEEL = """
[materials.steel]
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
"""
HEAD = f"""{STEEL}
[components.head]
material = "steel"
solid = {{ box = ["100 mm", "80 mm", "60 mm"] }}
mass = "40 kg"
fidelity = "rigid"
interfaces = {{ foot = {{ face = "z-" }}, tip = {{ face = "z+" }} }}
[joints.foot]
between = ["head.foot", "ground"]
kind = "spring"
stiffness = {{ x = "5 N/um", y = "6 N/um", z = "9 N/um", rx = "2e4 N m/rad", ry = "3e4 N m/rad", rz = "4e4 N m/rad" }}
damping = {{ x = "200 N s/m", rx = "3 N m s/rad" }}
[points.tcp]
tool = "head.tip"
work = "ground"
[effects]
damping = true
[analyses.modal]
count = 6
"""
BEAM = f"""{STEEL}
[components.beam]
solid = {{ box = ["30 mm", "20 mm", "300 mm"] }}
material = "steel"
fidelity = "polynomial"
interfaces = {{ foot = {{ face = "z-" }}, tip = {{ face = "z+" }} }}
[joints.foot]
between = ["beam.foot", "ground"]
kind = "rigid"
[points.tip]
tool = "beam.tip"
work = "ground"
[analyses.modal]
count = 6
"""


class Library:
    """The compiled library of an FMU, driven as a C program would."""

    def __init__(self, fmu: Path, folder: Path) -> None:
        with zipfile.ZipFile(fmu) as archive:
            archive.extractall(folder)
        self.description = ElementTree.parse(folder / "modelDescription.xml").getroot()
        self.version = int(self.description.attrib["fmiVersion"][0])
        (library,) = folder.glob("binaries/*/headstock.so")
        self.calls = ctypes.CDLL(str(library))
        token = self.description.attrib["guid" if self.version == 2 else "instantiationToken"]
        self.machine = self.instantiate(token.encode())

    def instantiate(self, token: bytes) -> int | None:
        none, no = ctypes.c_void_p(), ctypes.c_int(0)
        if self.version == 2:
            create = self.calls.fmi2Instantiate
            words: tuple[Any, ...] = (b"it", ctypes.c_int(1), token, b"", none, no, no)
        else:
            create = self.calls.fmi3InstantiateCoSimulation
            flags = (ctypes.c_bool(False),) * 4
            words = (b"it", token, b"", *flags, none, ctypes.c_size_t(0), none, none, none)
        create.restype = ctypes.c_void_p
        return create(*words)

    def exchange(self, name: str, references: list[int], values: list[float]) -> list[float]:
        """Get or set numbers."""
        count = len(references)
        numbers = (ctypes.c_double * count)(*values)
        call = getattr(self.calls, f"fmi{self.version}{name}")
        words: list[Any] = [ctypes.c_void_p(self.machine), (ctypes.c_uint * count)(*references)]
        words += [ctypes.c_size_t(count), numbers]
        assert call(*words, *([ctypes.c_size_t(count)] if self.version == 3 else [])) == 0
        return list(numbers)

    def step(self, now: float, size: float) -> int:
        words: list[Any] = [ctypes.c_void_p(self.machine), ctypes.c_double(now)]
        words.append(ctypes.c_double(size))
        if self.version == 2:
            return int(self.calls.fmi2DoStep(*words, ctypes.c_int(1)))
        flags = [ctypes.byref(ctypes.c_bool()) for _ in range(3)]
        last = ctypes.byref(ctypes.c_double())
        return int(self.calls.fmi3DoStep(*words, ctypes.c_bool(True), *flags, last))

    def variables(self, causality: str) -> dict[str, int]:
        found = self.description.findall(".//*[@valueReference][@name]")
        return {
            one.attrib["name"]: int(one.attrib["valueReference"])
            for one in found
            if one.attrib["causality"] == causality
        }


@pytest.mark.parametrize("form", ["fmu2", "fmu3"])
def test_an_fmu_moves_as_the_discrete_state_space(shell: Shell, tmp_path: Path, form: str) -> None:
    scene = shell.write(HEAD)
    shell(f"export {scene} --to npz --state-space 2kHz -o space.npz")
    printed = shell.prints(f"export {scene} --to {form} --state-space 2kHz -o head.fmu")
    assert "0.18 deg per Hz" in printed
    space = np.load("space.npz")
    whole = np.zeros((len(space["A"]) + 3,) * 2)
    whole[:-3] = np.hstack([space["A"], space["B"]])
    power = scipy.linalg.expm(whole * STEP)[:-3]
    fmu = Library(Path("head.fmu"), tmp_path / "fmu")
    inputs, outputs = fmu.variables("input"), fmu.variables("output")
    assert list(inputs) == [f"force.tcp.{axis}" for axis in "xyz"]
    assert list(outputs) == [f"motion.tcp.{axis}" for axis in "xyz"]
    state, forces = np.zeros(len(space["A"])), np.random.default_rng(0).standard_normal((STEPS, 3))
    seen, exact = [], []
    for number, force in enumerate(forces):
        fmu.exchange(("SetReal", "SetFloat64")[fmu.version - 2], list(inputs.values()), list(force))
        assert fmu.step(number * STEP, STEP) == 0
        get = ("GetReal", "GetFloat64")[fmu.version - 2]
        seen.append(fmu.exchange(get, list(outputs.values()), [0.0] * 3))
        state = power @ np.concatenate([state, force])
        exact.append(space["C"] @ state + space["D"] @ force)
    assert np.array(seen) == approx(np.array(exact), abs=1e-9 * np.abs(exact).max())
    assert fmu.step(STEPS * STEP, 0.4 * STEP) != 0  # no multiple of its step
    assert not fmu.instantiate(b"another machine")


def test_the_c_program_of_the_document_drives_an_fmu(shell: Shell, tmp_path: Path) -> None:
    text = (ROOT / "docs" / "exchange.md").read_text()
    Path("driver.c").write_text(text.split("```c\n")[1].split("```")[0])
    scene = shell.write(HEAD)
    shell(f"export {scene} --to fmu3 --hz 2kHz -o head.fmu")
    fmu = Library(Path("head.fmu"), tmp_path / "fmu")
    names = {
        "INPUT": fmu.variables("input")["force.tcp.x"],
        "OUTPUT": fmu.variables("output")["motion.tcp.x"],
    }
    flags = [f"-D{name}={number}" for name, number in names.items()]
    subprocess.run(
        ["cc", "-Wall", "-Werror", *flags, "driver.c", "-o", "driver", "-ldl"], check=True
    )
    (library,) = (tmp_path / "fmu").glob("binaries/*/headstock.so")
    token = fmu.description.attrib["instantiationToken"]
    words = ["./driver", str(library), token, str(STEP)]
    done = subprocess.run(words, check=True, capture_output=True, text=True)
    space = hs.state_space(scene, hz="2 kHz", inputs=[("tcp", "x")], step=STEP)
    moved = scipy.signal.dlsim(
        (space.A, space.B, space.C[:1], space.D[:1], STEP), np.ones((STEPS + 1, 1))
    )[1]
    assert np.array(done.stdout.split(), float) == approx(moved[1:, 0], rel=1e-6)


def respond(space: hs.MachineStateSpace, hz: Any) -> Any:
    """Frequency response ``(n, p, k)``, by hand."""
    step = space.step or 0.0
    points = np.exp(2j * np.pi * hz * step) if step else 2j * np.pi * hz
    return np.array(
        [
            space.C @ np.linalg.solve(s * np.eye(len(space.A)) - space.A, space.B) + space.D
            for s in points
        ]
    )


def test_python_has_the_state_space_that_scipy_takes(shell: Shell) -> None:
    scene = shell.write(HEAD)
    shell(f"export {scene} --to npz --state-space 2kHz -o space.npz")
    space, file = hs.state_space(scene, hz="2 kHz"), np.load("space.npz")
    for name in ("A", "B", "C", "D", "inputs", "output_units", "pose"):
        assert np.array_equal(getattr(space, name), file[name])
    assert (space.step, space.input_units[0], space.pose) == (None, "N", "reference")
    chosen = hs.state_space(scene, hz=2000.0, inputs=["tcp"], outputs=[("tcp", "z")], step=STEP)
    assert (chosen.outputs, chosen.step) == (("tcp z",), STEP)
    system = scipy.signal.StateSpace(space.A, space.B, space.C[2:], space.D[2:])
    exact = scipy.signal.cont2discrete((system.A, system.B, system.C, system.D), STEP)
    _, given = scipy.signal.dimpulse((chosen.A, chosen.B, chosen.C, chosen.D, STEP), n=50)
    _, wanted = scipy.signal.dimpulse(exact, n=50)
    assert np.array(given) == approx(np.array(wanted), abs=1e-9 * np.abs(wanted).max())


def test_a_balanced_state_space_is_as_close_as_it_says(shell: Shell) -> None:
    scene = shell.write(HEAD, ("damping = true", 'damping = { modal = "2 %" }'))
    hz = np.linspace(0.0, 1000.0, 4001)
    text = shell.prints(f"export {scene} --state-space 2kHz --to npz --balanced 30% -o small.npz")
    whole = hs.state_space(scene, hz=2000.0)
    small = hs.state_space(scene, hz=2000.0, balanced="30 %")
    assert len(small.A) < len(whole.A) and 0.0 < small.bound <= 0.3
    assert f"balanced: error at most {100.0 * small.bound:.2g} %" in text
    assert np.array_equal(small.A, np.load("small.npz")["A"])
    assert np.linalg.eigvals(small.A).real.max() < 0.0 and np.array_equal(small.D, whole.D)
    error = np.abs(respond(small, hz) - respond(whole, hz)).max(axis=0)
    assert error.max() > 0.0 and (error <= small.bounds).all()


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"hz": 0.0}, "hs.state_space: hz"),
        ({"hz": None}, 'write hz, such as "500 Hz"'),
        ({"inputs": ["tpc"]}, r"hs.state_space: inputs\[0\]\s+unknown point 'tpc'"),
        ({"inputs": ["tcp"], "hz": None}, 'write hz, such as "500 Hz"'),
        ({"pose": "far"}, "unknown pose 'far'"),
        ({"step": "9 ms"}, "9 ms is too long for a mode at"),
    ],
)
def test_arguments_of_a_state_space_are_checked(
    shell: Shell, changed: dict[str, Any], message: str
) -> None:
    with pytest.raises(hs.SceneError, match=message):
        hs.state_space(shell.write(HEAD), **({"hz": 500.0} | changed))


@pytest.mark.parametrize(
    ("form", "solid"),
    [
        ("op4", 'superelement = "beam.op4", points = "beam_points.bdf"'),
        ("dmig", 'superelement = "beam.bdf"'),
        ("abaqus", 'superelement = "beam_STIF1.mtx", points = "beam_points.bdf"'),
        ("calculix", 'superelement = "beam.sti", points = "beam_points.bdf"'),
        ("mtx", 'superelement = "beam_K.mtx", points = "beam_points.bdf"'),
    ],
)
def test_matrices_of_other_programs_are_a_part(shell: Shell, form: str, solid: str) -> None:
    scene = shell.write(BEAM)
    shell(f"run {scene} --json own.json -o own --no-figures")
    shell(f"export {scene} beam --to {form}")
    taken = shell.write(
        BEAM,
        ('solid = { box = ["30 mm", "20 mm", "300 mm"] }', f"solid = {{ {solid} }}"),
        ('material = "steel"\nfidelity = "polynomial"\n', ""),
        ('interfaces = { foot = { face = "z-" }, tip = { face = "z+" } }\n', ""),
        ("beam.foot", "beam.node_1"),
        ("beam.tip", "beam.node_2"),
        name="taken",
    )
    shell(f"run {taken} --json taken.json -o taken --no-figures")
    given, found = (
        read_json(Path(name))["modal"][0]["frequencies_hz"] for name in ("own.json", "taken.json")
    )
    assert found == approx(given, rel=1e-7 if form == "dmig" else 1e-9)


@pytest.fixture(scope="module")
def matrices(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The beam as files of other programs."""
    folder = tmp_path_factory.mktemp("matrices")
    (folder / "scene.toml").write_text(BEAM)
    for form, name in (("op4", "beam.op4"), ("mtx", "beam.mtx"), ("h5", "beam.h5")):
        hs.export(folder / "scene.toml", form, component="beam", output=folder / name)
    return folder


POINTS = 'points = "beam_points.bdf"'


@pytest.mark.parametrize(
    ("solid", "foot", "cut", "key", "message"),
    [
        (
            f'"beam.op4", {POINTS}',
            "node_99",
            "",
            "joints.foot.between[0]",
            "interfaces of beam: node_1",
        ),
        ('"beam.h5"', "node_1", "", "joints.foot.between[0]", "interfaces of beam: foot, tip"),
        ('"beam.op4"', "node_1", "", "solid.superelement", 'write points = "beam_points.bdf"'),
        (f'"beam.op4", {POINTS}', "node_1", "beam.op4", "solid.superelement", "beam.op4"),
        (f'"beam.op4", {POINTS}', "node_1", "beam_points.bdf", "solid.points", "beam_points.bdf"),
        (f'"beam_K.mtx", {POINTS}', "node_1", "beam_M.mtx", "solid.superelement", "beam_M.mtx"),
        (f'"junk.mtx", {POINTS}', "node_1", "", "solid.superelement", "junk.mtx"),
    ],
)
def test_what_is_wrong_with_matrices_is_said_by_check_and_run(
    shell: Shell, matrices: Path, solid: str, foot: str, cut: str, key: str, message: str
) -> None:
    """With file, line and key of the scene; ``run`` says the same and leaves nothing behind."""
    for file in matrices.iterdir():
        shutil.copy(file, file.name)
    Path("junk.mtx").write_text("junk\n")
    if cut:
        Path(cut).write_bytes(Path(cut).read_bytes()[:-100])
    scene = shell.write(
        BEAM,
        ('{ box = ["30 mm", "20 mm", "300 mm"] }', f"{{ superelement = {solid} }}"),
        ('material = "steel"\nfidelity = "polynomial"\n', ""),
        ('interfaces = { foot = { face = "z-" }, tip = { face = "z+" } }\n', ""),
        ("beam.foot", f"beam.{foot}"),
        ("beam.tip", "beam.tip" if ".h5" in solid else "beam.node_2"),
        name="taken",
    )
    for words in (f"check {scene}", f"run {scene} -o out --no-figures"):
        refused = shell.refuses(words)
        assert "taken.toml:" in refused and key in refused and message in refused


def test_sensors_stand_on_the_nodes_of_a_foreign_part(shell: Shell) -> None:
    """Its tip as a sensor moves as the point there; beside a node there is nothing to read."""
    shell.write(BEAM)
    shell("export scene.toml beam --to op4")
    more = (
        '[analyses.static]\nat = ["tip", "s"]\n[sensors.s]\ncomponent = "beam"\n'
        'at = ["0 mm", "0 mm", "300 mm"]\n'
    )
    shell.change(
        (
            'solid = { box = ["30 mm", "20 mm", "300 mm"] }',
            'solid = { superelement = "beam.op4", points = "beam_points.bdf" }',
        ),
        ('material = "steel"\nfidelity = "polynomial"\n', ""),
        ('interfaces = { foot = { face = "z-" }, tip = { face = "z+" } }\n', ""),
        ("beam.foot", "beam.node_1"),
        ("beam.tip", "beam.node_2"),
        add=more,
    )
    shell("run scene.toml -o out --no-figures")
    static = shell.json("out/summary.json")["static"]
    found, expected = (np.array(static[at]["compliance_um_per_kN"]) for at in ("s", "tip"))
    assert found == approx(expected, rel=1e-9, abs=1e-9 * expected.max())
    shell.change(('"300 mm"]\n', '"290 mm"]\n'))
    assert '"0 mm", "0 mm", "300 mm"' in shell.refuses("run scene.toml -o out --no-figures")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--to fmu3", "fmu3 is a state space with modes up to a frequency; write hz"),
        ("head --to fmu3 --hz 500Hz", "fmu3 is of the whole machine; leave out the component"),
        ("--to op4", "op4 is of one component; name it"),
        ("head --to op4 --hz 500Hz", "op4 takes no hz, which goes with fmu3, fmu2, mat, npz"),
        ("head --to op4 --pose a", "op4 takes no pose"),
        ("--to fmu", "format 'fmu' is unknown; of a component: h5, op4"),
        ("head --to op4 --step 1ms", "op4 takes no step, which goes with fmu3, fmu2, mat, npz"),
        ("--hz 500Hz --step 9ms", "9 ms is too long for a mode at"),
        ("--hz 500Hz --balanced 1m", '--balanced "1m" is a length, not a ratio'),
        ("--hz 500Hz --balanced 0%", "--balanced 0% must be above zero"),
        ("--hz 500Hz --balanced 100%", "--balanced is 1; write a share of 1"),
        ("--hz 500Hz --travel X --error 150%", "--error is 1.5; write a share of 1"),
        ("--to uff -o head.txt", "files of uff end in .uff, .unv, .uf"),
        ("--mesh head.stl", "mesh files end in .msh"),
        ("head --mesh head.msh --to msh", "go without each other, --to and -o"),
        ("--to fmu3 --state-space 500Hz --step 0s", "--step 0s must be above zero"),
    ],
)
def test_forms_that_do_not_go_together_are_refused(shell: Shell, words: str, message: str) -> None:
    assert message in shell.refuses(f"export {shell.write(HEAD)} {words}")


def test_points_go_with_matrices_alone(shell: Shell) -> None:
    scene = shell.write(HEAD, ('"60 mm"] }', '"60 mm"], points = "x.bdf" }'))
    assert "go with matrices of other programs" in shell.refuses(f"check {scene}")


EXPORTS = """
[exports.plant]
format = "mat"
hz = "2 kHz"
[exports.tip]
format = "simscape"
component = "beam"
[exports.tip_mesh]
format = "xdmf"
component = "beam"
file = "beam.xdmf"
"""


def test_a_run_writes_the_exports_of_its_scene(shell: Shell) -> None:
    scene = shell.write(BEAM + EXPORTS)
    shell(f"run {scene} -o results --no-figures")
    shell(f"run {scene} -o results --no-figures")  # over files of its own
    names = {path.name for path in Path("results").iterdir()}
    assert {"plant.mat", "tip.mat", "tip.m", "beam.xdmf"} <= names
    shell(f"export {scene} --to mat --hz 2kHz -o again.mat --no-host")
    plants = [scipy.io.loadmat(name) for name in ("results/plant.mat", "again.mat")]
    assert np.array_equal(plants[0]["A"], plants[1]["A"])


def test_an_export_that_cannot_be_written_costs_nothing_else(shell: Shell) -> None:
    """The export of segments below an interface that averages is exact: dofs that are tied follow."""
    side = '{ face = "x+", rect = { center = ["0 mm", "250 mm"], size = ["10 mm", "100 mm"] } }'
    scene = shell.write(
        BEAM + EXPORTS,
        ('"polynomial"', '"segmented"'),
        ('tip = { face = "z+" }', f"tip = {side}"),
        ('hz = "2 kHz"', 'hz = "2 kHz"\nstep = "9 ms"'),
    )
    shell(f"run {scene} -o results", code=1)
    (failure,) = shell.json("results/summary.json")["failures"]
    assert failure.startswith("scene.toml: exports.plant: ")
    assert "9 ms is too long for a mode" in failure
    assert "scene.toml: exports.plant: " in shell.text("results/report.html")
    assert {"tip.mat", "beam.xdmf", "tables"} <= shell.files("results")
    body = read_simscape("results/tip.mat")
    (foot,) = (k for k, name in enumerate(body["interfaces"].ravel()) if "foot" in str(name))
    free = np.delete(np.arange(len(body["K"])), np.arange(6 * foot, 6 * foot + 6))
    matrices = (body[letter][np.ix_(free, free)] for letter in "KM")
    found = np.sqrt(scipy.linalg.eigvalsh(*matrices)[:6]) / (2.0 * np.pi)
    modes = shell.json("results/summary.json")["modal"][0]["frequencies_hz"]
    assert found == approx(modes[:6], rel=1e-9)


@pytest.mark.parametrize(
    ("line", "key", "message"),
    [
        ('format = "fmu"', "exports.x", "format 'fmu' is unknown"),
        ('format = "op4"\ncomponent = "beam"\nhz = "1 kHz"', "exports.x.hz", "op4 takes no hz"),
        ('format = "uff"\nhz = "1 kHz"', "exports.x.hz", "uff takes no hz"),
        ('format = "mat"\nhz = "1 kHz"\ntravel = ["Q"]', "exports.x.travel[0]", "unknown axis 'Q'"),
        ('format = "op4"\ncomponent = "bean"', "exports.x.component", "unknown component 'bean'"),
        ('format = "mat"\nhz = "1 kHz"\npose = "far"', "exports.x.pose", "far"),
        ('format = "mat"\nhz = "1 kHz"\nfile = "../x.mat"', "exports.x.file", "without folders"),
        ('format = "mat"\nhz = "0 Hz"', "exports.x.hz", "0 Hz"),
        ('format = "xdmf"\nfile = "x.msh"', "exports.x", "end in .xdmf"),
        (
            'format = "uff"\n[exports.y]\nformat = "uff"\nfile = "x.uff"',
            "exports.x.file",
            "another",
        ),
    ],
)
def test_wrong_exports_are_named_with_their_key(
    shell: Shell, line: str, key: str, message: str
) -> None:
    refused = shell.refuses(f"check {shell.write(BEAM + '[exports.x]' + chr(10) + line)}")
    assert key in refused and message in refused


def test_a_wrong_format_is_reported_where_it_was_set(shell: Shell) -> None:
    words = "--set exports.plant.format=fmux"
    assert "--set exports.plant.format" in shell.refuses(
        f"check {shell.write(BEAM + EXPORTS)} {words}"
    )


def read_simscape(name: str) -> dict[str, Any]:
    """What a reader that knows nothing of Headstock finds."""
    return dict(scipy.io.loadmat(name))


def test_a_simscape_body_has_the_documented_shapes_mass_and_frequencies(shell: Shell) -> None:
    scene = shell.write(BEAM)
    shell(f"export {scene} beam --to simscape")
    shell(f"export {scene} beam --to h5")
    body = read_simscape("beam.mat")
    stiffness, mass, origins = body["K"], body["M"], body["origins"]
    count, size = len(origins), len(stiffness)
    assert count == 2 and origins.shape == (2, 3) and body["orientations"].shape == (2, 4)
    assert body["C"].shape == stiffness.shape == mass.shape and size > 6 * count
    assert np.linalg.norm(body["orientations"], axis=1) == approx(1.0, abs=1e-15)
    assert np.array_equal(stiffness, stiffness.T) and np.array_equal(mass, mass.T)
    rigid = np.zeros((size, 6))
    for node, place in enumerate(origins):
        x, y, z = place
        rigid[6 * node : 6 * node + 6] = np.eye(6)
        rigid[6 * node : 6 * node + 3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    assert np.abs(stiffness @ rigid).max() <= 1e-9 * np.abs(stiffness).max()
    moved = rigid.T @ mass @ rigid
    weight = 7850.0 * 0.03 * 0.02 * 0.3
    assert moved[:3, :3] == approx(weight * np.eye(3), abs=1e-9 * weight)
    assert [moved[1, 5], moved[2, 3], moved[0, 4]] == approx([0, 0, 0.15 * weight], abs=1e-9)
    spin = weight * np.array([0.02**2 / 12 + 0.3**2 / 3, 0.03**2 / 12 + 0.3**2 / 3, 0.0013 / 12])
    assert moved.diagonal()[3:] == approx(spin, rel=1e-9)
    import h5py

    with h5py.File("beam.h5") as file:
        pair = [np.asarray(file[name]) for name in ("stiffness", "mass")]
    given, found = (scipy.linalg.eigvalsh(*one)[6:16] for one in (pair, (stiffness, mass)))
    assert np.sqrt(found) == approx(np.sqrt(given), rel=1e-12)
    assert "body.orientations" in Path("beam.m").read_text()


def test_python_exports_and_takes_matrices(shell: Shell) -> None:
    scene = shell.write(BEAM)
    written = hs.export(scene, "simscape", component="beam", output="beam.mat")
    assert written.startswith("beam.mat, beam.m: beam")
    body = read_simscape("beam.mat")
    taken = hs.Superelement(body["K"], body["M"], points=body["origins"], file="taken.h5")
    machine = hs.Machine(
        components={"beam": hs.Component(solid=taken)},
        joints={"foot": hs.Joint(between=["beam.node_1", "ground"], kind="rigid")},
        points={"tip": hs.Point(tool="beam.node_2", work="ground")},
        analyses={"modal": {"count": 6}},
    )
    given, found = (hs.run(one).modes["reference"].frequencies_hz for one in (scene, machine))
    assert found == approx(given, rel=1e-9)
    wrong: Any = {"points": body["origins"], "file": "wrong.h5"}
    with pytest.raises(hs.SceneError, match="symmetric"):
        hs.Superelement(np.triu(body["K"]), body["M"], **wrong)
    with pytest.raises(hs.SceneError, match="rows for"):
        hs.Superelement(body["K"], body["M"], dofs=[(1, "x")], **wrong)
    with pytest.raises(hs.SceneError, match="leave out the component"):
        hs.export(scene, "mat", hz=500.0, component="beam")
    with pytest.raises(hs.HeadstockError, match="their unit is mm"):
        hs.Superelement(body["K"], body["M"], points=1e3 * body["origins"], file="wrong.h5")
    assert not Path("wrong.h5").exists()


SLIDE = f"""{STEEL}
[components.bed]
material = "steel"
solid = {{ box = ["900 mm", "300 mm", "100 mm"] }}
mass = "150 kg"
fidelity = "rigid"
interfaces = {{ foot = {{ face = "z-" }}, top = {{ face = "z+" }} }}
[components.slide]
material = "steel"
solid = {{ box = ["200 mm", "200 mm", "120 mm"] }}
at = ["0 mm", "0 mm", "120 mm"]
fidelity = "rigid"
interfaces = {{ bottom = {{ face = "z-" }}, tip = {{ face = "z+" }} }}
[joints.foot]
between = ["bed.foot", "ground"]
kind = "mount"
stiffness = {{ vertical = "40 N/um", horizontal = "30 N/um" }}
places = [["400 mm", "120 mm", "0 mm"], ["-400 mm", "120 mm", "0 mm"], ["0 mm", "-120 mm", "0 mm"]]
[joints.guide]
between = ["slide.bottom", "bed.top"]
kind = "linear_guide"
axis = "x"
normal = "z"
stiffness = {{ lateral = "100 N/um", normal = "150 N/um" }}
damping = {{ lateral = "2e3 N s/m" }}
loss_factor = 0.02
places = [["80 mm", "80 mm", "110 mm"], ["-80 mm", "80 mm", "110 mm"],
    ["80 mm", "-80 mm", "110 mm"], ["-80 mm", "-80 mm", "110 mm"]]
[joints.screw]
between = ["slide.bottom", "bed.top"]
kind = "ball_screw"
axis = "x"
at = ["0 mm", "0 mm", "110 mm"]
stiffness = {{ axial = "60 N/um" }}
[axes]
X = {{ joints = ["guide", "screw"], direction = "x", limits = ["-250 mm", "250 mm"] }}
[points.tcp]
tool = "slide.tip"
work = "ground"
[poses]
left = {{ X = "-100 mm" }}
[effects]
damping = {{ modal = "1 %" }}
[analyses.modal]
count = 6
"""


@pytest.fixture(scope="module")
def sliding(tmp_path_factory: pytest.TempPathFactory) -> hs.VaryingStateSpace:
    scene = tmp_path_factory.mktemp("slide") / "slide.toml"
    scene.write_text(SLIDE)
    return hs.varying_state_space(scene, "X", hz="400 Hz", step=STEP)


def test_one_basis_covers_the_travel_to_the_error_it_states(
    sliding: hs.VaryingStateSpace, shell: Shell
) -> None:
    assert sliding.frozen_pose_error <= sliding.target == 0.01 and sliding.held_out >= 2
    assert np.array_equal(sliding.at(X="-100 mm").A, sliding.at(X=-0.1).A)
    hz = np.linspace(5.0, 400.0, 100)
    continuous = dataclasses.replace(sliding, step=None)
    for place in (-0.25, -0.1, 0.03, 0.2501):
        if place > 0.25:
            with pytest.raises(hs.SceneError, match="outside the limits of axis X"):
                continuous.at(X=place)
            continue
        text = f'left = {{ X = "{1e3 * place} mm" }}'
        exact = hs.state_space(shell.write(SLIDE, ('left = { X = "-100 mm" }', text)), hz="4 kHz")
        wanted = respond(exact, hz)
        error = np.linalg.norm(respond(continuous.at(X=place), hz) - wanted, axis=(1, 2))
        assert (error / np.linalg.norm(wanted, axis=(1, 2))).max() < 0.01


@pytest.mark.parametrize(
    ("position", "message"),
    [
        ("-100", "is a plain number, not a length"),
        ("3 deg", "is an angle"),
        ("300 mm", "outside the limits of axis X"),
        (None, "VaryingStateSpace.at: X"),
        (True, "VaryingStateSpace.at: X"),
        (float("nan"), "VaryingStateSpace.at: X"),
    ],
)
def test_what_is_no_position_is_refused(
    sliding: hs.VaryingStateSpace, position: Any, message: str
) -> None:
    with pytest.raises(hs.SceneError, match=message):
        sliding.at(X=position)


@pytest.fixture(scope="module")
def travelling(tmp_path_factory: pytest.TempPathFactory) -> hs.VaryingStateSpace:
    """A table that turns on a slide on rails, its motors free."""
    scene = tmp_path_factory.mktemp("travel") / "travelling.toml"
    scene.write_text(stored_scene("travelling"))
    return hs.varying_state_space(scene, ["X", "C"], hz="150 Hz", motors="free")


def test_free_motors_along_rails_and_a_rotary_axis_are_those_of_each_pose(
    travelling: hs.VaryingStateSpace, shell: Shell
) -> None:
    """A screw that turns by itself, and a motor that turns a table through a gear."""
    assert 0.0 < travelling.frozen_pose_error <= 0.01 and travelling.held_out >= 2
    scene, hz = shell.write(stored_scene("travelling")), np.linspace(4.0, 150.0, 60)
    positions = {"middle": {}, "left": {"X": "-130 mm", "C": "50 deg"}}
    positions["right"] = {"X": "171 mm", "C": "-83 deg"}
    for pose, where in positions.items():
        exact = hs.state_space(scene, hz="1.2 kHz", pose=pose, motors="free")
        space = travelling.at(**where)
        for names in ("inputs", "outputs", "input_units", "output_units"):
            assert getattr(space, names) == getattr(exact, names)
        assert space.output_units == ("m", "m", "m", "m", "rad", "m", "rad")
        wanted = respond(exact, hz)
        error = np.linalg.norm(respond(space, hz) - wanted, axis=(1, 2))
        assert (error / np.linalg.norm(wanted, axis=(1, 2))).max() <= travelling.frozen_pose_error


DRIVE = """[drives.X]
lead = "10 mm"
inertia = "2e-4 kg m^2"
kv = "30 1/s"
velocity_gain = "5e3 N s/m"
integral_time = "20 ms"
[effects]
drive_control = true
"""


@pytest.mark.parametrize(("form", "motors"), [("fmu2", "free"), ("fmu3", "locked")])
def test_an_fmu_of_moving_axes_follows_their_positions(
    sliding: hs.VaryingStateSpace,
    shell: Shell,
    tmp_path: Path,
    form: str,
    motors: Literal["free", "locked"],
) -> None:
    scene = shell.write(SLIDE, ("[effects]\n", DRIVE))
    if motors == "free":
        sliding = hs.varying_state_space(scene, "X", hz="400 Hz", step=STEP, motors=motors)
    words = f"--to {form} --hz 400Hz --travel X --motors {motors} -o slide.fmu"
    printed = shell.prints(f"export {scene} {words}")
    assert f"frozen-pose error {100.0 * sliding.frozen_pose_error:.2g} % in" in printed
    fmu = Library(Path("slide.fmu"), tmp_path / "fmu")
    inputs, outputs = fmu.variables("input"), list(fmu.variables("output").values())
    assert list(inputs)[-1] == "position.X" and len(inputs) == len(sliding.inputs) + 1
    assert ("drive.X.motor" in fmu.variables("output")) == (motors == "free")
    count = len(sliding.inputs)
    calls = [f"{verb}{('Real', 'Float64')[fmu.version - 2]}" for verb in ("Set", "Get")]
    assert fmu.exchange(calls[1], [inputs["position.X"]], [9.0]) == [-0.1]
    # at rest each step is exact; along the travel it is the rational one, and nearly exact
    moving = 0.3 * np.sin(np.linspace(0.0, 1.0, 100))
    places = np.concatenate([np.full(150, -0.1), -0.1 + moving])
    forces = np.random.default_rng(5).standard_normal((len(places), count))
    state = follow = np.zeros(len(sliding.at().A))
    seen, exact, stepped = [], [], []
    first, space, poles = None, sliding.at(), rational_poles(6)
    continuous = dataclasses.replace(sliding, step=None)
    for number, (place, force) in enumerate(zip(places, forces, strict=True)):
        fmu.exchange(calls[0], list(inputs.values()), [*force, place])
        assert fmu.step(number * STEP, STEP) == 0
        seen.append(fmu.exchange(calls[1], outputs, [0.0] * len(outputs)))
        if place != first:
            first, space = place, continuous.at(X=place)
            whole = np.zeros((len(state) + count,) * 2)
            whole[: len(state)] = np.hstack([space.A, space.B])
            power = scipy.linalg.expm(whole * STEP)[: len(state)]
        follow = state if number <= 151 else follow
        state = power @ np.concatenate([state, force])
        exact.append(space.C @ state)
        terms = [
            np.linalg.solve(
                STEP * space.A - pole * np.eye(len(state)),
                residue * (follow + STEP * space.B @ force / pole),
            )
            for pole, residue in poles
        ]
        follow = np.sum(terms, axis=0).real
        stepped.append(space.C @ (state if number <= 150 else follow))
    largest = np.abs(exact).max()
    roundoff = 1e-8 if motors == "free" else 1e-9  # a free slide sums it up
    assert np.array(seen) == approx(np.array(stepped), abs=roundoff * largest)
    assert np.array(seen) == approx(np.array(exact), abs=2e-4 * largest)
    fmu.exchange(calls[0], [inputs["position.X"]], [0.4])
    assert fmu.step(len(places) * STEP, STEP) != 0  # beyond the travel


def rational_poles(count: int) -> list[tuple[complex, complex]]:
    """Poles of a Padé approximation of the exponential with vanishing limit, and residues."""
    series = [1.0 / math.factorial(k) for k in range(2 * count)]
    above, below = scipy.interpolate.pade(series, count)
    return [(pole, above(pole) / below.deriv()(pole)) for pole in below.roots]


def test_an_fmu_follows_a_slow_move_as_a_run_of_its_path(shell: Shell, tmp_path: Path) -> None:
    outputs = 'outputs = [["tcp", "x"], ["tcp", "y"], ["tcp", "z"]]\n'
    path = (
        'from = { X = "-60 mm" }\nto = { X = "60 mm" }\nfeeds = ["6 m/min"]\ntime_constant = "20 ms"\n'
        'sampling = "4 kHz"\nestimate = false\n'
    )
    forces = 'inputs = [["slide.tip", "x"], ["slide.tip", "ry"]]\nup_to = "400 Hz"\n'
    scene = shell.write(f"{SLIDE}[analyses.path]\n{path}{outputs}[analyses.frf]\n{forces}{outputs}")
    (curves,) = (run.curves for run in cast(Any, hs.run(scene, analyses=["path"]).answers[0]).runs)
    step, size = 0.25e-3, len(curves.positions)
    words = '--travel X --error 0.5% --step "0.25 ms" -o slide.fmu'
    shell(f"export {scene} --to fmu3 --hz 400Hz {words}")
    fmu = Library(Path("slide.fmu"), tmp_path / "fmu")
    inputs, read = (list(fmu.variables(kind).values()) for kind in ("input", "output"))
    # what accelerating the slide does at its centre of mass, 60 mm below its tip
    force, moved = -0.2 * 0.2 * 0.12 * 7850.0 * curves.accelerations, np.zeros((size, 3))
    places = curves.positions - 0.06
    for number in range(size - 1):
        middle = 0.5 * (places[number] + places[number + 1])
        given = [force[number], -0.06 * force[number], middle]
        fmu.exchange("SetFloat64", inputs, given)
        assert fmu.step(number * step, step) == 0
        fmu.exchange("SetFloat64", inputs[2:], [places[number + 1]])
        moved[number + 1] = fmu.exchange("GetFloat64", read, [0.0] * 3)
    exact = curves.deviation.total
    largest = np.abs(exact).max(axis=0)
    assert (np.abs(moved - exact).max(axis=0) < 1e-3 * largest).all()
    assert np.abs(curves.frozen - exact).max(axis=0)[2] > 0.5 * largest[2]  # the pose counts


def test_files_of_moving_axes_hold_rows_and_matrices(shell: Shell) -> None:
    shell(f"export {shell.write(SLIDE)} --to npz --hz 400Hz --travel X -o slide.npz")
    shell(f"export {shell.write(SLIDE)} --to mat --hz 400Hz --travel X -o slide.mat")
    file, mat = np.load("slide.npz"), scipy.io.loadmat("slide.mat")
    assert file["A"].shape == mat["A"].shape and len(file["A"]) == len(file["poses"])
    assert 0.0 < file["frozen_pose_error"] <= 0.01
    size = len(file["constant_stiffness"])
    stiffness = file["constant_stiffness"].copy()
    for joint in range(1, 6):
        if f"joint_{joint}_rows" in file:
            rows = file[f"joint_{joint}_rows"][0]
            stiffness += rows.T @ file[f"joint_{joint}_stiffness"][0] @ rows
    assert -file["A"][0][size:, :size] * file["rate"] == approx(stiffness, rel=1e-9)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--travel Y", "travel[0] there is no axis 'Y'; axes: X"),
        ("--travel X --balanced 1%", "leave out balanced or travel"),
        ("--error 1%", "error goes with travel"),
        ("--travel X --step 2ms", "2 ms is too long for a mode at 400 Hz"),
        ("--travel X --motors free", "write drive_control = true"),
    ],
)
def test_wrong_travels_are_refused(shell: Shell, words: str, message: str) -> None:
    assert message in shell.refuses(f"export {shell.write(SLIDE)} --to npz --hz 400Hz {words}")


@pytest.mark.parametrize(
    ("change", "key", "message"),
    [
        (('normal = "150 N/um"', 'normal = "rigid"'), "joints.guide", "give what is rigid there"),
        ((', limits = ["-250 mm", "250 mm"]', ""), "axes.X", "write `limits`"),
        (
            ("[effects]", "[effects]\ngravity = true\ngravity_stiffening = true"),
            "exports.x.travel",
            "leave out travel",
        ),
        (("[effects]", "[effects]"), "exports.x.step", "2 ms is too long for a mode at 400 Hz"),
    ],
)
def test_what_cannot_travel_is_named_before_anything_is_computed(
    shell: Shell, change: tuple[str, str], key: str, message: str
) -> None:
    step = 'step = "2 ms"' if "step" in key else ""
    export = f'[exports.x]\nformat = "npz"\nhz = "400 Hz"\ntravel = ["X"]\n{step}\n'
    scene = shell.write(SLIDE + export, change)
    for words in ("check", "plan"):
        refused = shell.refuses(f"{words} {scene}")
        assert f"{scene}:" in refused and key in refused and message in refused

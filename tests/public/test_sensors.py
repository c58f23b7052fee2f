"""Sensors and point masses anywhere on a part: rows of the recovery basis, no degrees of freedom."""

import re
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from numpy.typing import NDArray

import headstock as hs
from built_uff import points_15, text_58, units
from cases import cases
from common import Shell, approx, run_once
from fixture_machines import stored_scene, write_scene

ROOT = Path(__file__).resolve().parents[2]
SCENE = stored_scene("sensors")
INPUTS, OUTPUTS = (
    next(line for line in SCENE.splitlines() if line.startswith(key))
    for key in ("inputs", "outputs")
)
QUIET = (INPUTS, 'inputs = [["tcp", "x"]]')  # no force at a sensor
FULL = ('"9 kHz"', '"80 kHz"')
BARE = (
    (SCENE[: SCENE.index("[sensors.top]")] + SCENE[SCENE.index("[effects]") :])
    .replace(*QUIET)
    .replace(OUTPUTS, 'outputs = ["tcp", "corner"]')
)


def receptance(results: hs.Results, output: str, force: str) -> NDArray[np.complex128]:
    """Of channels such as ``"tcp x"``, at every line."""
    curves = results.frf["reference"].curves
    row = [" ".join(channel) for channel in curves.outputs].index(output)
    column = [" ".join(channel) for channel in curves.inputs].index(force)
    return np.asarray(curves.receptance[:, row, column])


def rows_of(results: hs.Results, sensor: str) -> list[str]:
    return [dof for name, dof in results.frf["reference"].curves.outputs if name == sensor]


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> hs.Results:
    return hs.open(run_once(tmp_path_factory.mktemp("sensors"), SCENE))


def frequencies(results: hs.Results) -> NDArray[np.float64]:
    return results.modes["reference"].frequencies_hz


@pytest.mark.parametrize("direction", ["x", "y", "z"])
@pytest.mark.parametrize(("sensor", "point"), [("top", "tcp"), ("corner_of_head", "corner")])
def test_a_sensor_on_rigid_areas_is_exact(
    results: hs.Results, sensor: str, point: str, direction: str
) -> None:
    expected = receptance(results, f"{point} {direction}", "tcp x")
    largest = abs(receptance(results, f"{point} x", "tcp x")).max()
    found = receptance(results, f"{sensor} {direction}", "tcp x")
    assert found == approx(expected, rel=1e-9, abs=1e-9 * largest)


def test_a_sensor_on_a_segmented_body_moves_with_its_section(results: hs.Results) -> None:
    # a vector takes the first letter that is left
    assert rows_of(results, "end") == ["x", "y"]
    expected = receptance(results, "column.top x", "tcp x")
    assert receptance(results, "end x", "tcp x") == approx(expected, rel=1e-9)


def test_what_was_not_measured_is_left_out(results: hs.Results) -> None:
    assert rows_of(results, "side") == ["x", "z"]


def test_forces_at_a_sensor_are_reciprocal(results: hs.Results) -> None:
    expected = receptance(results, "tcp x", "side x")
    assert receptance(results, "side x", "tcp x") == approx(expected, rel=1e-9)


def test_modes_have_the_motion_of_sensors(results: hs.Results) -> None:
    modes = results.modes["reference"]
    assert modes.sensors == ("top", "side", "corner_of_head", "end")
    assert modes.sensor_shapes is not None
    assert modes.sensor_shapes.shape == (5, 4, 3)


@pytest.mark.parametrize("fidelity", ["elastic", "polynomial"])
def test_a_force_at_a_sensor_is_as_exact_as_one_at_an_interface(
    tmp_path: Path, fidelity: str
) -> None:
    kind = ('fidelity = "elastic"', f'fidelity = "{fidelity}"')
    runs = [
        hs.run(write_scene(tmp_path, SCENE, kind, *more, name=name))
        for name, more in (("few", ()), ("full", (FULL,)))
    ]
    found, expected = (receptance(one, "side x", "side x") for one in runs)
    errors = abs(found / expected - 1.0)
    assert errors[0] < 1e-9  # at rest
    assert np.median(errors) < 2e-4
    assert abs(found - expected).max() < 1e-3 * abs(expected).max()
    curves = runs[0].frf["reference"].curves
    output, force = curves.outputs.index(("side", "x")), curves.inputs.index(("side", "x"))
    bounds = curves.error_share["reduction"][1:, output, force]
    assert np.median(abs(found - expected)[1:] / bounds) < 1.1


def test_sensors_change_no_frequency_and_add_no_dofs(tmp_path: Path) -> None:
    measured = hs.run(write_scene(tmp_path, SCENE, QUIET))
    plain = hs.run(write_scene(tmp_path, BARE, name="bare"))
    assert frequencies(measured) == approx(frequencies(plain), rel=1e-10)
    assert measured.modes["reference"].shapes.shape == plain.modes["reference"].shapes.shape


def test_what_is_not_in_the_error_of_a_sensor_is_named(tmp_path: Path) -> None:
    kept = ('directions = ["x", "z"]', 'directions = ["x", "z"]\nresidual_modes = true')
    lacks = [
        hs.run(write_scene(tmp_path, SCENE, QUIET, *more, name=name))
        .frf["reference"]
        .error_left_out
        for name, more in (("plain", ()), ("kept", (kept,)))
    ]
    plain, better = ([text for text in texts if "directly" in text] for texts in lacks)
    assert plain == [
        "modes left out that move top, side directly; residual_modes = true keeps most"
    ]
    assert better == ["modes left out that move top directly; residual_modes = true keeps most"]


def test_a_sensor_that_moves_reduces_nothing_again(shell: Shell) -> None:
    shell.write(SCENE, QUIET)
    shell("run scene.toml -o first --no-figures")
    shell.write(SCENE, QUIET, ('"10 mm", "70 mm"', '"12 mm", "80 mm"'), ("count = 5", "count = 4"))
    shell("run scene.toml -o second --no-figures")
    rows = shell.rows("second/tables/stages.csv")
    assert [row["from the store"] for row in rows if row["stage"] == "reduce"] == ["True"]


LOBES = """
[analyses.static]
at = ["tcp", "top", "corner", "corner_of_head"]
[analyses.lobes]
speeds = ["6000 rpm", "12000 rpm", 6]
mill = { diameter = "10 mm", teeth = 2 }
radial_depth = "5 mm"
material = "al7075-t6"
directions = ["x"]
up_to = "700 Hz"
at = "tcp"
"""


def test_stiffness_and_lobes_are_asked_for_at_a_sensor(shell: Shell) -> None:
    """On rigid areas they are those of points there; of rotations a sensor knows nothing."""
    shell.write(SCENE[: SCENE.index("[analyses.frf]")] + LOBES)
    shell("run scene.toml -o point --no-figures")
    shell.change(('at = "tcp"', 'at = "top"'))
    shell("run scene.toml -o sensor --no-figures")
    summary = shell.json("sensor/summary.json")
    for sensor, point in (("top", "tcp"), ("corner_of_head", "corner")):
        found, expected = summary["static"][sensor], summary["static"][point]
        assert found["compliance_um_per_kN"] == [
            approx(row, rel=1e-7, abs=1e-6) for row in expected["compliance_um_per_kN"]
        ]
        assert found["compliance_6x6"][3] == [None] * 6 and not found["free_motions"]
    lobes = [shell.json(f"{run}/summary.json")["lobes"] for run in ("point", "sensor")]
    depths = [re.findall(r"[-+.\de]{6,}", str(one)) for one in lobes]
    assert len(depths[0]) > 3
    assert [float(one) for one in depths[1]] == approx([float(one) for one in depths[0]], rel=1e-4)
    shell.change(('at = "top"', 'at = "side"'))
    assert "y was not" in shell.refuses("check scene.toml")


def test_point_masses_weigh_as_bodies_do(tmp_path: Path) -> None:
    """At a rigid interface a point mass is exactly what a body joined there is."""
    at = 'component = "beam"\nat = ["0 mm", "0 mm", "200 mm"]\nmass = "2 kg"\n'
    placed = hs.run(write_scene(tmp_path, BARE + f"[masses.more]\n{at}"))
    body = (
        '[components.more]\nsolid = { point_mass = "2 kg" }\nat = ["0 mm", "0 mm", "500 mm"]\n'
        '[joints.glue]\nkind = "rigid"\nbetween = ["beam.top", "more.center"]\n'
    )
    joined = hs.run(write_scene(tmp_path, BARE + body))
    sensed = hs.run(write_scene(tmp_path, BARE + f"[sensors.more]\n{at}"))
    assert frequencies(placed) == approx(frequencies(joined), rel=1e-9)
    assert frequencies(sensed) == approx(frequencies(joined), rel=1e-9)


def test_a_mass_away_from_interfaces_needs_no_more_modes(tmp_path: Path) -> None:
    mass = '[masses.more]\ncomponent = "beam"\nat = ["30 mm", "0 mm", "100 mm"]\nmass = "2 kg"\n'
    few = hs.run(write_scene(tmp_path, BARE + mass))
    many = hs.run(write_scene(tmp_path, BARE + mass, FULL))
    assert frequencies(few) == approx(frequencies(many), rel=1e-3)


def test_a_table_is_many_sensors(tmp_path: Path) -> None:
    """Positions of several parts in one file, in axes of the machine."""
    (tmp_path / "points.csv").write_text(
        "sensor,part,x [mm],y [mm],z [m],direction,mass [g]\n"
        "1,beam,0,0,0.5,xz,5\n7,head,30,40,0.54,y,5\nB-2,column,0,0,0.3,0 1 1,5\n"
    )
    grid = '[sensors.grid]\nfile = "points.csv"\nframe = "machine"\n'
    many = ('outputs = ["tcp"', 'outputs = ["grid", ["grid.7", "y"], "tcp"')
    results = hs.run(write_scene(tmp_path, BARE + grid, many))
    measured = {place: rows_of(results, place) for place in ("grid.1", "grid.7", "grid.B-2")}
    assert measured == {"grid.1": ["x", "z"], "grid.7": ["y"], "grid.B-2": ["x"]}
    expected = receptance(results, "tcp x", "tcp x")
    assert receptance(results, "grid.1 x", "tcp x") == approx(expected, rel=1e-9)


def test_the_points_of_a_test_are_sensors(tmp_path: Path) -> None:
    """Those of a universal file, with the directions that were measured, whatever their signs."""
    pytest.importorskip("pyuff")
    places = points_15(
        (12, 0, 0, 1, 0.03, 0, 0.4), (3, 0, 0, 1, 0, 0.02, 0.45), (7, 0, 0, 1, 0, 0, 0.5)
    )
    # motion of 12 along x under a force at 3 against z; nothing at 7
    (tmp_path / "test.uff").write_bytes(units(1, 1.0, 1.0) + places + text_58())
    grid = '[sensors.grid]\nfile = "test.uff"\ncomponent = "beam"\nframe = "machine"\n'
    sensors = hs.load(write_scene(tmp_path, BARE + grid)).scene.machine.sensors
    assert sensors["grid.12"].position == approx((0.03, 0.0, 0.1))
    measured = {name: "".join(sensor.directions) for name, sensor in sensors.items()}
    assert measured == {"grid.12": "x", "grid.3": "z", "grid.7": "xyz"}
    assert sensors["grid.3"].directions["z"] == (0.0, 0.0, 1.0)


def test_point_masses_come_from_a_table_too(tmp_path: Path) -> None:
    (tmp_path / "weights.csv").write_text("part,x [mm],y [mm],z [mm],mass [kg]\nbeam,0,0,200,2\n")
    table = hs.run(write_scene(tmp_path, BARE + '[masses.weights]\nfile = "weights.csv"\n'))
    single = hs.run(
        write_scene(
            tmp_path,
            BARE
            + '[masses.one]\ncomponent = "beam"\nat = ["0 mm", "0 mm", "200 mm"]\nmass = "2 kg"\n',
        )
    )
    assert frequencies(table) == approx(frequencies(single), rel=1e-12)


def test_transients_and_state_spaces_have_sensors(shell: Shell) -> None:
    shell.write(
        SCENE,
        (
            "[effects]",
            '[analyses.transient]\noutputs = [["side", "x"]]\nduration = "20 ms"\nup_to = "700 Hz"\n'
            '[analyses.transient.loads.hammer]\nshape = "half_sine"\nat = ["side", "x"]\n'
            'size = "100 N"\ntime = "2 ms"\n[effects]',
        ),
    )
    shell("run scene.toml -o out --no-figures")
    head = shell.rows("out/tables/transient_reference.csv")[0]
    assert any(key.startswith("side x") for key in head)
    shell('export scene.toml --state-space "700 Hz" -o model.mat')
    content = scipy.io.loadmat(shell.folder / "model.mat")
    assert "side x" in {name.item() for name in np.ravel(content["outputs"])}


@cases
def test_refused_sensors(
    shell: Shell, section: str, entry: str, files: dict[str, str], message: str
) -> None:
    for name, text in files.items():
        (shell.folder / name).write_text(text)
    shell.write(BARE + f"[{section}]\n{entry}\n")
    error = shell.refuses("check scene.toml")
    assert message in error
    assert re.search(rf"scene.toml:\d+: {section}", error)


def test_a_direction_that_was_not_measured_is_refused(shell: Shell) -> None:
    shell.write(SCENE, ('["side", "x"]]', '["side", "y"]]'))
    error = shell.refuses("check scene.toml")
    assert 'sensor "side" measured x and z only; y was not: write one of x, z' in error


def test_a_sensor_beside_its_mesh_says_where_it_should_be(shell: Shell) -> None:
    """Only a mesh knows where a part from a file is."""
    shell.write(BARE)
    shell("export scene.toml beam --mesh beam.msh")
    shell.write(
        BARE + '[sensors.s7]\ncomponent = "beam"\nat = ["42.3 mm", "0 mm", "100 mm"]\n',
        (
            'solid = { box = ["60 mm", "40 mm", "200 mm"] }\nmaterial = "steel"\nfidelity = "elastic"\n'
            'mesh = { size = "20 mm", cells = "hex" }',
            'solid = { mesh = "beam.msh", unit = "1 m" }\nmaterial = "steel"\nfidelity = "elastic"',
        ),
        (
            'interfaces = { foot = { face = "z-" }, top = { face = "z+" } }\n[components.head]',
            'interfaces = { foot = { face = "set:foot" }, top = { face = "set:top" } }\n[components.head]',
        ),
    )
    error = shell.refuses("run scene.toml -o out --no-figures")
    assert 'lies 12.3 mm outside "beam"; nearest place of its surface: at = ["30 mm", ' in error
    assert "scene.toml:" in error


def test_identification_takes_sensors(shell: Shell) -> None:
    """A stiffness is found again from the shape and a compliance at sensors."""
    soft = (
        'between = ["column.foot", "ground"]\nkind = "rigid"',
        'between = ["column.foot", "ground"]\nkind = "spring"\nstiffness = { x = "20 N/um", y = "30 N/um", z = "90 N/um", '
        'rx = "1 MN m/rad", ry = "1 MN m/rad", rz = "1 MN m/rad" }',
    )
    scene = shell.write(SCENE, soft)
    truth = hs.run(scene)
    modes = truth.modes["reference"]
    assert modes.sensor_shapes is not None
    moved = modes.sensor_shapes[1, 1]
    static = receptance(truth, "side x", "side x")[0].real
    shell.write(
        f"""
[cases.measured]
[[cases.measured.modes]]
frequency = "{modes.frequencies_hz[0]:.12g} Hz"
[[cases.measured.modes]]
frequency = "{modes.frequencies_hz[1]:.12g} Hz"
vectors = {{ side = [{moved[0]:.12g}, "-", {moved[2]:.12g}] }}
[[cases.measured.compliances]]
point = "side"
motion = "x"
force = "x"
value = "{1e9 * static:.12g} um/kN"
[parameters.foot]
keys = ["joints.floor.stiffness.x"]
bounds = ["5 N/um", "60 N/um"]
""",
        name="targets",
    )
    shell("identify scene.toml targets.toml -o fit")
    found = shell.json("fit/identification.json")["parameters"]
    assert found["foot"]["value"] == approx(20.0, rel=1e-6)
    assert found["foot"]["data_share"] > 0.9


def test_check_and_show_list_sensors(shell: Shell) -> None:
    shell.write(
        SCENE
        + '[masses.weight]\ncomponent = "head"\nat = ["0 mm", "0 mm", "40 mm"]\nmass = "50 g"\n'
    )
    assert "4 sensors, 1 point mass" in shell.prints("check scene.toml")
    shown = shell.prints("show scene.toml --json shown.json -o machine.png")
    assert "Sensors and point masses" in shown
    # the head is turned by 90 degrees about z
    (corner, weight) = (
        shell.json("shown.json")["sensors"][n] for n in ("corner_of_head", "weight")
    )
    assert corner["at_m"] == approx([0.03, 0.04, 0.54])
    assert weight == {
        "component": "head",
        "measures": {},
        "mass_kg": 0.05,
        "at_m": approx([0.0, 0.0, 0.54]),
    }


def test_machines_in_python_have_sensors() -> None:
    sensor = hs.Sensor(component="head", at=["40 mm", "0 mm", "10 mm"], directions=["y"])
    machine = hs.Machine(
        components={
            "head": {
                "solid": {"box": ["80 mm", "80 mm", "40 mm"]},
                "mass": "2 kg",
                "free": True,
                "fidelity": "rigid",
                "material": "steel",
            }
        },
        materials={"steel": hs.Material(E="210 GPa", nu=0.3, rho="7850 kg/m^3")},
        sensors={"s": sensor},
        analyses={"modal": {"count": 6}},
    )
    assert hs.run(machine).modes["reference"].sensors == ("s",)


@pytest.mark.parametrize("model", ["frozen", "pose_dependent"])
def test_along_a_path_a_sensor_moves_as_a_point_there(shell: Shell, model: str) -> None:
    text = stored_scene("path_runs").replace(
        "[analyses.path]",
        '[points.far]\ntool = "slider.nose"\nwork = "ground"\noffset = ["50 mm", "20 mm", "-40 mm"]\n'
        '[sensors.near]\ncomponent = "slider"\nat = ["50 mm", "20 mm", "260 mm"]\n'
        f'[analyses.path]\noutputs = ["far", "near"]\npose_model = "{model}"',
    )
    shell.write(text, ("on_request = true", ""))
    shell("run scene.toml -o out --no-figures")
    outputs = shell.json("out/summary.json")["path"]["feeds"][1]["outputs"]
    sizes = {tuple(one["dof"]): one["accelerating"]["peak_um"] for one in outputs}
    for direction in "xyz":
        assert sizes["near", direction] == approx(sizes["far", direction], rel=1e-6, abs=1e-6)


def test_lumped_mechanisms_have_sensors_on_their_legs_and_tools() -> None:
    sensors = {
        "leg": {"component": "beam_2", "at": [0.06, 0.0, 0.9]},
        "tool": {"component": "spindle", "at": [0.065, 0.0, 0.48]},
    }
    outputs = ["tcp", "far", "tool", "leg"]
    keys: dict[str, object] = {
        "sensors": sensors,
        "points.far": {"tool": "spindle.tip", "work": "ground", "offset": [0.065, 0.0, 0.0]},
        "analyses": {
            "modal": {"poses": ["config_1"]},
            "frf": {"inputs": [["tcp", "x"], ["tool", "y"]], "outputs": outputs, "up_to": 20.0}
            | {"points": 5, "adaptive": False, "poses": ["config_1"]},
        },
    }
    results = hs.run(hs.load(ROOT / "machines" / "tripteor.toml", set=keys))
    curves = results.frf["config_1"].curves
    moved = dict(zip(curves.outputs, curves.receptance.transpose(1, 0, 2), strict=True))
    for direction in "xyz":
        assert moved["tool", direction] == approx(moved["far", direction], rel=1e-9, abs=1e-18)
    assert abs(moved["leg", "x"]).max() > 0.0
    assert moved["tool", "y"][:, 0] == approx(moved["tcp", "x"][:, 1], rel=1e-9, abs=1e-18)
    shapes = results.modes["config_1"].sensor_shapes
    assert shapes is not None and shapes.shape[1:] == (2, 3)


def test_an_included_file_brings_its_table(shell: Shell) -> None:
    (shell.folder / "probe").mkdir()
    (shell.folder / "probe" / "points.csv").write_text("x [mm],y [mm],z [mm]\n30,0,100\n")
    (shell.folder / "probe" / "grid.toml").write_text(
        '[sensors.grid]\nfile = "points.csv"\ncomponent = "beam"\n'
    )
    shell.write('include = "probe/grid.toml"\n' + BARE)
    assert "1 sensor" in shell.prints("check scene.toml")


def test_a_sensor_beside_a_rigid_part_from_a_file_is_refused(shell: Shell) -> None:
    step = (ROOT / "tests" / "data" / "support.step").read_bytes()
    (shell.folder / "part.step").write_bytes(step)
    shell.write(
        '[components.part]\nsolid = { step = "part.step" }\nfidelity = "rigid"\nmass = "3 kg"\nfree = true\n'
        'material = "steel"\n[materials.steel]\nE = "210 GPa"\nnu = 0.3\nrho = "7850 kg/m^3"\n'
        '[sensors.far]\ncomponent = "part"\nat = ["9 m", "0 m", "0 m"]\n[analyses.modal]\n'
    )
    error = shell.refuses("run scene.toml -o out --no-figures")
    assert re.search(r'scene.toml:\d+: sensors.far .*outside "part"; nearest place', error)

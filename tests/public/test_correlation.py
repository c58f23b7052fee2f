"""A measured machine beside its model: what agrees, what is missing, which channel is wrong."""

import dataclasses
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import headstock as hs
from built_uff import points_15, shape_55, text_58, units
from common import Shell, approx
from fixture_machines import stored_scene
from headstock.geometry.frames import FloatArray

pytest.importorskip("pyuff")

SCENE = stored_scene("comparison")
HEIGHTS, CORNERS = (0.0, 0.125, 0.25, 0.375, 0.5), ((0.02, 0.03), (-0.02, -0.03))
PLACES = [(x, y, z) for z in HEIGHTS for x, y in CORNERS]
NOISE = 0.01
COLUMN = 0.1  # height of its foot [m]


@dataclasses.dataclass(frozen=True)
class Measured:
    """Frequencies ``(m,)`` [Hz] and shapes ``(m, p, 3)`` of the synthetic test."""

    hz: FloatArray
    shapes: FloatArray


def solve(folder: Path, text: str) -> Measured:
    """Modes of a machine at the sensors of the test."""
    rows = [
        f'p{number} = {{ component = "column", at = ["{x} m", "{y} m", "{z} m"] }}'
        for number, (x, y, z) in enumerate(PLACES, 1)
    ]
    path = folder / "machine.toml"
    path.write_text(
        text.replace("[components.column]", "\n".join(["[sensors]", *rows, "[components.column]"]))
    )
    modes = hs.run(hs.load(path, variant="E")).modal[0]
    assert modes.sensor_shapes is not None
    return Measured(modes.frequencies_hz, modes.sensor_shapes)


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Measured:
    """Modes of the machine at sensors of its scene, with noise."""
    exact = solve(tmp_path_factory.mktemp("test"), SCENE)
    random = np.random.default_rng(7)
    noise = NOISE * np.abs(exact.shapes).max(axis=(1, 2), keepdims=True)
    return Measured(exact.hz, exact.shapes + noise * random.standard_normal(exact.shapes.shape))


def write_test(
    folder: Path,
    measured: Measured,
    *,
    factor: float = 1.02,
    leave_out: tuple[int, ...] = (),
    spoil: Callable[[FloatArray], object] = lambda shapes: None,
    name: str = "test.uff",
) -> Path:
    """A test file of points in metres and real modes.

    Args:
        factor: Of the frequencies.
        leave_out: Modes that were not measured.
        spoil: Changes the shapes in place.
    """
    shapes = measured.shapes.copy()
    spoil(shapes)
    points = [(number, 0, 0, 11, x, y, z + COLUMN) for number, (x, y, z) in enumerate(PLACES, 1)]
    modes = [
        shape_55(
            factor * hz, {number: tuple(row) for number, row in enumerate(shape, 1)}, damping=0.01
        )
        for index, (hz, shape) in enumerate(zip(measured.hz, shapes, strict=True))
        if index not in leave_out
    ]
    path = folder / name
    path.write_bytes(b"".join([units(1, 1.0, 1.0), points_15(*points), *modes]))
    return path


def test_a_machine_is_found_in_its_own_modes_with_noise(shell: Shell, measured: Measured) -> None:
    shell.write(SCENE)
    write_test(shell.folder, measured)
    shown = shell.prints("correlate scene.toml test.uff --variant E -o out")
    assert "9 of 9 measured modes are met within 5 %; largest deviation -2.0 %" in shown
    found = shell.json("out/correlate.json")
    assert [row["mac"] > 0.99 for row in found["modes"]] == [True] * 9
    assert [row["number"] for row in found["modes"]] == list(range(1, 10))
    assert [row["deviation"] for row in found["modes"]] == approx([1 / 1.02 - 1] * 9, abs=1e-3)
    assert found["faults"] == []
    assert {"correlate.html", "pairs.csv", "channels.csv", "mac.png"} <= shell.files("out")


def test_missing_modes_are_named_on_both_sides(shell: Shell, measured: Measured) -> None:
    shell.write(SCENE)

    def forget(shapes: FloatArray) -> None:
        shapes[4] = np.random.default_rng(3).standard_normal(shapes[4].shape)

    write_test(shell.folder, measured, leave_out=(3,), spoil=forget)
    found = hs.correlate("scene.toml", "test.uff", variant="E")
    assert found.verdict[0].startswith("7 of 8 measured modes are met within 5 %")
    assert found.verdict[1] == f"missing in the model: {1.02 * measured.hz[4]:.4g} Hz"
    assert found.verdict[2].startswith("computed, but not measured: 242.2 Hz")
    shell("correlate scene.toml test.uff --variant E -o out")
    rows = shell.rows("out/pairs.csv")
    remarks = [(bool(row["mode"]), row["remark"]) for row in rows if row["remark"]]
    assert sorted(remarks)[0] == (False, "missing in the model")
    assert (True, "not measured") in remarks
    assert not any(";" in row["mode"] or ":" in row["mode"] for row in rows)


def test_a_turned_sensor_is_named_and_left_out_of_a_fit(shell: Shell, measured: Measured) -> None:
    shell.write(SCENE)

    def turn(shapes: FloatArray) -> None:
        shapes[:, 9, :2] *= -1.0  # the last point, by half a turn about z

    write_test(shell.folder, measured, spoil=turn)
    shown = shell.prints("correlate scene.toml test.uff --variant E -o out")
    assert "9 of 9 measured modes are met within 5 %" in shown
    assert "paired without point 10, which hides the pairs" in shown
    assert "sensor 10: x and y look reversed" in shown
    assert "MAC of 9 modes rises from 0.3" in shown
    assert len(shell.json("out/correlate.json")["faults"]) == 1
    (case,) = tomllib.loads(shell.text("out/targets.toml"))["cases"].values()
    assert {tuple(mode["vectors"]["p10"][:2]) for mode in case["modes"]} == {("-", "-")}
    worst = shell.rows("out/channels.csv")[:2]
    assert {(row["point"], row["direction"]) for row in worst} == {("10", "x"), ("10", "y")}
    assert [float(row["eCoMAC"]) > 0.5 for row in worst] == [True, True]


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("correlate scene.toml none.uff", "none.uff"),
        ("correlate scene.toml scene.toml", "test data end in .uff"),
        (
            "correlate scene.toml points.uff",
            "points.uff:1: holds no modes and no frequency responses",
        ),
        ("correlate scene.toml test.uff --pose upp", "poses.upp"),
        ("correlate scene.toml test.uff --variant Z", "unknown variant"),
        ("correlate scene.toml test.uff --within much", "'much' is no share"),
    ],
)
def test_what_cannot_be_compared_is_refused_with_its_place(
    shell: Shell, measured: Measured, command: str, message: str
) -> None:
    shell.write(SCENE)
    path = write_test(shell.folder, measured)
    start = path.read_bytes().index(b"    -1\n    55")
    (shell.folder / "points.uff").write_bytes(path.read_bytes()[:start])
    assert message in shell.refuses(command)
    assert not (shell.folder / "results").exists()


DAMPING = 0.01
LINES: FloatArray = np.arange(60.0, 460.0, 1.0, dtype=np.float64)


def respond(measured: Measured, force: tuple[int, int], motion: tuple[int, int]) -> FloatArray:
    """Displacement over force ``(l,)`` [m/N] between point and direction, from 0."""
    omega, natural = 2.0 * np.pi * LINES[:, None], 2.0 * np.pi * measured.hz
    products = measured.shapes[:, *motion] * measured.shapes[:, *force]
    parts = products / (natural**2 - omega**2 + 2j * DAMPING * natural * omega)
    return np.asarray(parts.sum(axis=1))


def test_responses_are_fitted_and_compared_over_all_lines(shell: Shell, measured: Measured) -> None:
    fit = '[fits.E]\nopen = []\nmoves = [{ "joints.mount.stiffness.vertical" = "201 N/um" }]\n'
    shell.write(f"{SCENE}\n{fit}")
    softer = Measured(0.99 * measured.hz, measured.shapes)
    random = np.random.default_rng(2)
    sets = []
    for point, direction in [(p, d) for p in range(2, 10) for d in range(2)] + [(4, 2), (9, 2)]:
        for force in ((8, 0), (8, 1), (8, 2)):
            values = respond(softer, force, (point, direction))
            size = 1e-3 * np.abs(values).max()
            values = values + size * (
                random.standard_normal(400) + 1j * random.standard_normal(400)
            )
            motion = (point + 1, direction + 1)
            sets.append(
                text_58(values, hz=LINES, kinds=(8, 13), motion=motion, force=(9, force[1] + 1))
            )
    head = write_test(shell.folder, measured).read_bytes()
    path = shell.folder / "responses.uff"
    path.write_bytes(head[: head.index(b"    -1\n    55")] + b"".join(sets))
    shown = shell.prints("correlate scene.toml responses.uff --variant E -o out")
    assert "5 of 5 measured modes are met within 5 %" in shown
    assert "responses computed with measured damping ratios: the scene has none" in shown
    assert "± of computed responses is not known (rigid model of block; the mesh of column" in shown
    assert "; what the fit of the scene leaves open)" in shown
    found = shell.json("out/correlate.json")
    assert [row["deviation"] for row in found["modes"]] == approx([1 / 0.99 - 1] * 5, abs=1e-3)
    assert min(row["mac"] for row in found["modes"]) > 0.98
    assert [row["measured_damping"] for row in found["modes"]] == approx([DAMPING] * 5, rel=0.05)
    best = max(float(row["FRAC"]) for row in shell.rows("out/responses.csv"))
    assert 0.3 < best < 0.98  # one per cent of frequency is as wide as the peaks
    assert {"fdac.png", "responses.png"} <= shell.files("out")


def test_the_target_file_of_a_test_is_fitted_as_it_stands(shell: Shell) -> None:
    softer = SCENE.replace('"60 N/um", tilt', '"45 N/um", tilt').replace('"200 N/um"', '"260 N/um"')
    write_test(shell.folder, solve(shell.folder, softer), factor=1.0)
    # as written the scene has no place for the sensors of its variant
    box = """[variants.tall]
"components.column.solid.box" = ["40 mm", "60 mm", "500 mm"]
"""
    shell.write(SCENE, ('"500 mm"]', '"300 mm"]'))
    shell.change(add=box)
    shell("correlate scene.toml test.uff --variant E+tall -o .")
    shell("identify scene.toml targets.toml -o fit")
    found = shell.json("fit/identification.json")["parameters"]
    assert found["mount_vertical"]["value"] == approx(260.0, rel=0.02)
    assert found["mount_horizontal"]["value"] == approx(45.0, rel=0.02)
    assert found["mount_tilt"]["low_95"] < 4.0 < found["mount_tilt"]["high_95"]


def test_modes_of_a_modified_machine_keep_their_names_when_they_exchange(
    shell: Shell, measured: Measured
) -> None:
    shell.write(SCENE)
    write_test(shell.folder, measured, name="before.uff")
    shell("correlate scene.toml before.uff --variant E -o .")
    names = [
        mode["name"]
        for mode in tomllib.loads(shell.text("targets.toml"))["cases"]["before"]["modes"]
    ]
    after = Measured(measured.hz.copy(), measured.shapes.copy())
    after.shapes[[0, 1]] = after.shapes[[1, 0]]
    write_test(shell.folder, after, name="after.uff")
    shown = shell.prints("correlate scene.toml after.uff --variant E -o out --like targets.toml")
    assert f"{names[0]} and {names[1]} have exchanged their order since before" in shown
    case = tomllib.loads(shell.text("out/targets.toml"))["cases"]["after"]
    assert case["like"] == "before"
    assert [mode["name"] for mode in case["modes"]] == [names[1], names[0], *names[2:]]

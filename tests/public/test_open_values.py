"""Open values: listed by ``check``, refused by what computes, used and named with ``--accept-defaults``."""

from pathlib import Path

import pytest

import headstock as hs
from common import Shell
from fixture_machines import machine, write_scene

SCENE = machine("""
machine = "bar"
components.bar.fidelity = "rigid"
components.bar.material = { open = "steel", reason = "the file names none" }
components.head.solid = { box = ["40 mm", "40 mm", "= side"] }
components.head.at = ["0 mm", "0 mm", "200 mm"]
components.head.material = { open = "steel", reason = "the file names none" }
components.head.fidelity = "rigid"
components.head.interfaces = { foot = { face = "z-" } }
joints.clamp.kind = "bolted"
joints.clamp.stiffness.open = { normal = "40 N/um", shear = "20 N/um", tilt = "9 kN m/rad", torsion = "9 kN m/rad" }
joints.clamp.stiffness.reason = "a guess"
joints.glue = { between = ["head.foot", "bar.tip"], kind = "rigid" }
parameters.side = { open = "= 2 * [20 mm]", reason = "not drawn" }
variants.stiff = { "joints.clamp.stiffness.normal" = "80 N/um" }
variants.answers = { "joints.clamp.stiffness" = { normal = "50 N/um", shear = "25 N/um", tilt = "9 kN m/rad", torsion = "9 kN m/rad" } }
studies.tilt = { watch = ["frequency"], vary = { "joints.clamp.stiffness.tilt" = ["9 kN m/rad", "12 kN m/rad"] } }
analyses.modal = { count = 3 }
""")
SET_SIDE = "--set 'parameters.side=\"40 mm\"'"
MATERIALS = "--set components.bar.material=steel --set components.head.material=steel"


@pytest.fixture
def scene(shell: Shell) -> Path:
    return shell.write(SCENE)


def test_check_lists_questions_equal_ones_once(shell: Shell, scene: Path) -> None:
    printed = shell.prints("check scene.toml --json check.json")
    assert "ok" in printed and "4 values open" in printed
    listed = {question["keys"][0]: question for question in shell.json("check.json")["open"]}
    assert list(listed) == ["components.bar.material", "joints.clamp.stiffness", "parameters.side"]
    material = listed["components.bar.material"]
    assert material["keys"] == ["components.bar.material", "components.head.material"]
    assert (material["default"], material["reason"]) == ("steel", "the file names none")
    line = int(material["place"].rpartition(":")[2])
    assert "the file names none" in scene.read_text().splitlines()[line - 1]
    assert any(text.startswith("open: components.bar.material, ") for text in hs.check(scene))


@pytest.mark.parametrize(
    "command",
    [
        *("run scene.toml", "study scene.toml tilt", "effects scene.toml"),
        *("compare scene.toml", "export scene.toml bar", "converge scene.toml"),
    ],
)
def test_what_computes_asks_for_answers(shell: Shell, scene: Path, command: str) -> None:
    message = shell.refuses(command)
    assert "4 values are open" in message and "--accept-defaults" in message
    assert "is open, as components.head.material: the file names none" in message
    assert sorted(path.name for path in shell.folder.iterdir()) == ["scene.toml"]


def test_a_run_with_defaults_names_them(shell: Shell, scene: Path) -> None:
    printed = shell.prints("run scene.toml --accept-defaults --no-figures -o out")
    side = 'parameters.side = "= 2 * [20 mm]": not drawn'
    assert side in printed
    accepted = shell.json("out/summary.json")["provenance"]["accepted_defaults"]
    assert len(accepted) == 3 and side in accepted
    assert "Not decided, computed with their defaults" in shell.text("out/report.html")
    machine = hs.load(scene, accept_defaults=True)
    results = hs.run(machine)
    assert results.provenance is not None and results.provenance.accepted_defaults == tuple(
        accepted
    )
    opened = hs.open(shell.folder / "out").provenance
    assert opened is not None and opened.accepted_defaults == tuple(accepted)
    written = machine.save(shell.folder / "saved.toml")
    assert "not drawn" in written.read_text()


def test_answers_leave_nothing_open(shell: Shell, scene: Path) -> None:
    shell(f"run scene.toml --variant answers {SET_SIDE} {MATERIALS} --no-figures -o out")
    assert "accepted_defaults" not in shell.json("out/summary.json")["provenance"]
    with pytest.raises(hs.SceneError, match="1 value is open"):
        hs.load(
            scene,
            variant="answers",
            set={"components.bar.material": "steel", "components.head.material": "steel"},
        )


def test_variants_and_studies_reach_into_open_values(shell: Shell, scene: Path) -> None:
    loaded = hs.load(scene, variant="stiff", accept_defaults=True)
    assert loaded.scene.machine.joints["clamp"].stiffness[2, 2] == 80e6
    table = hs.study(hs.load(scene, accept_defaults=True), "tilt")
    first, second = (
        next(number.value for key, number in numbers.items() if str(key).startswith("frequency"))
        for numbers in table.numbers
    )
    assert 0.0 < first < second


def test_included_files_keep_their_open_values(tmp_path: Path) -> None:
    write_scene(tmp_path, SCENE.partition("[analyses")[0].partition("[variants")[0], name="part")
    text = 'include = { file = "part.toml", prefix = "a_" }\n[analyses.modal]\ncount = 3\n'
    scene = write_scene(tmp_path, text)
    with pytest.raises(hs.SceneError) as error:
        hs.load(scene)
    keys = [problem.key for problem in error.value.problems]
    assert "components.a_bar.material" in keys
    assert any("part.toml" in problem.place for problem in error.value.problems)
    parts = hs.load(scene, accept_defaults=True).scene.machine.components
    assert parts["a_bar"].material.name == "a_steel"

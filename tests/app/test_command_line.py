"""The command line answers quickly, tells what is wrong, and ends with the exit code it
promises.
"""

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from common import Shell, approx, loaded_by, run_process
from headstock.app.actions.checking import choose_fidelity
from headstock.app.terminal import guard
from headstock.geometry.errors import HeadstockError
from headstock.pipeline.storage.provenance import SceneChoice
from headstock.scene.reading.findings import SceneError

HEAVY = ("dolfinx", "petsc4py", "slepc4py", "gmsh", "meshio", "pyvista", "matplotlib")
COLUMN = Path(__file__).parents[2] / "machines" / "step_column.step"
PROGRAM = f'"{sys.executable}" -P -m headstock.app.command_line'
RUN = "run scene.toml -o out --no-figures"
SPRINGS = ('x = "10 N/um", ', 'y = "10 N/um", ', 'z = "40 N/um", ')


def run_in_shell(command: str) -> subprocess.CompletedProcess[str]:
    variables = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    return run_process(["bash", "-c", command], env=variables, timeout=120)


def loaded_by_commands(*lines: str) -> set[str]:
    """Packages that commands have loaded in a process of their own; they have to end well."""
    calls = "".join(f"assert main({line.split()!r}) == 0\n" for line in lines)
    return loaded_by(f"from headstock.app.command_line import main\n{calls}")


def test_help_imports_nothing_that_computes_and_lists_what_works(block: Shell) -> None:
    loaded = loaded_by_commands("--help")
    assert "typer" in loaded
    assert not loaded & {*HEAVY, "numpy", "scipy", "pydantic", "mpi4py"}
    commands = "check plan run study compare identify validate report doctor schema catalogue test"
    listed = block("--help").out
    assert [name for name in commands.split() if f"\n  {name} " not in listed] == []


@pytest.mark.parametrize("name", ["", "run", "show", "sweep"])
def test_help_shows_brackets_as_they_are(name: str, block: Shell) -> None:
    text = block(f"{name} --help").out
    assert "\\" not in text and ("[required]" in text) == bool(name)


def test_no_heavy_library_is_imported_by_check_plan_or_a_run_without_elastic_components(
    block: Shell,
) -> None:
    assert not loaded_by_commands("check scene.toml", "plan scene.toml", RUN) & {*HEAVY}


def test_run_writes_results_summary_and_report_and_prints_stages(block: Shell) -> None:
    printed = block("run scene.toml -o out --json copy.json").out
    assert block.files("out") == {
        ".headstock-files", "figures", "modes", "report.html", "results.h5", "summary.json", "tables",
    }  # fmt: skip
    summary = block.json("out/summary.json")
    assert block.json("copy.json") == summary
    stages = ["rigid", "couple", "static", "modal", "write"]
    assert [row["stage"] for row in summary["stages"]] == stages
    assert summary["status"] == "done"
    assert summary["static"]["tcp"]["compliance_um_per_kN"][2][2] == approx(25.0, rel=1e-9)
    assert len(summary["modal"][0]["frequencies_hz"]) == 6
    assert all(f"  {stage} " in printed for stage in stages)
    assert "µm/kN" in printed
    assert max(len(line.rstrip()) for line in printed.splitlines()) <= 100  # as without a terminal


def test_the_second_run_of_an_unchanged_scene_takes_all_from_the_store_and_needs_no_heavy_library(
    block: Shell,
) -> None:
    block.change(('fidelity = "rigid"', 'mesh = { size = "50 mm" }'))
    block(RUN)
    assert not loaded_by_commands("run scene.toml -o out") & {*HEAVY}
    stages = block.json("out/summary.json")["stages"]
    assert [row["cached"] for row in stages if row["stage"] in {"mesh", "reduce"}] == [True, True]


def test_a_free_slide_is_named_before_anything_is_computed_and_the_loads_that_do_no_work_on_it_have_their_answer(
    block: Shell,
) -> None:
    free = "nothing holds X translation of block"
    block.change((SPRINGS[0], ""))
    assert free in block.prints("check scene.toml")
    printed = block.prints(RUN)
    assert printed.index(free) < printed.index("rigid block")
    assert printed.count("warning:") == printed.count("nothing holds") == 1
    summary = block.json("out/summary.json")
    assert summary["status"] == "done"
    point = summary["static"]["tcp"]
    assert point["free_motions"] == ["X translation of block"]
    matrix = point["compliance_um_per_kN"]
    assert [row[0] for row in matrix] == matrix[0] == [None] * 3
    assert matrix[2][2] == approx(25.0)
    assert summary["modal"][0]["rigid_count"] == 1
    (warning,) = summary["warnings"]
    assert free in warning


def test_a_machine_that_no_force_leaves_in_place_ends_with_1_names_what_is_free_and_still_shows_its_modes(
    block: Shell,
) -> None:
    block.change(*((spring, "") for spring in SPRINGS))
    printed = block.prints(RUN, code=1)
    assert "pose reference: 3 rigid motion(s)" in printed
    assert "X translation of block" in printed
    summary = block.json("out/summary.json")
    assert summary["status"] == "failed"
    assert summary["modal"][0]["rigid_count"] == 3


@pytest.mark.parametrize("options", ["", "--analysis modal"])
def test_plan_says_what_run_then_does(options: str, block: Shell) -> None:
    block(f"plan scene.toml {options} --json plan.json")
    block(f"{RUN} {options} --json run.json")
    planned, ran = (
        [[row[key] for key in ("stage", "component", "pose", "reason")] for row in rows]
        for rows in (block.json("plan.json"), block.json("run.json")["stages"])
    )
    assert planned == ran


@pytest.mark.parametrize("command", ["check", "plan", "run"])
def test_a_bad_scene_ends_with_2_and_all_problems_and_touches_nothing(
    block: Shell, command: str
) -> None:
    block.change(("nu = 0.3", "nu = 0.6"), ('material = "steel"', 'material = "steal"'))
    before = sorted(block.folder.rglob("*"))
    message = block(f"{command} scene.toml", code=2).err
    assert "scene.toml:4" in message
    assert "steal" in message
    assert "Traceback" not in message
    assert sorted(block.folder.rglob("*")) == before


def test_a_segmented_scene_runs_and_one_that_cannot_be_segmented_ends_with_2_and_the_reason(
    block: Shell,
) -> None:
    line = f"{RUN} --set components.block.fidelity=segmented"
    block(line)
    found = block.json("out/summary.json")["components"]["block"]
    assert found["fidelity"] == "segmented" and found["full_dofs"] == 60
    shutil.copy(COLUMN, block.folder / "block.step")
    hollow = '{column = {size = ["100 mm", "100 mm", "100 mm"], wall = "5 mm", cap = "5 mm"}}'
    for solid, reason in (
        ('{step = "block.step"}', "it is read from a file"),
        (hollow, "its section changes along it"),
    ):
        solid = f"components.block.solid={solid}"
        said = block.refuses(f"{line} --json other.json --set", solid)
        assert reason in said and 'write "elastic" or "rigid"' in said
        assert "other.json" not in block.files()


@pytest.mark.parametrize("fidelity", ["rigid", "segmented"])
def test_a_run_at_a_fidelity_equals_the_scene_that_has_it_written(
    fidelity: str, block: Shell
) -> None:
    block.change(('"rigid"', '"elastic"'))
    block(f"run scene.toml --no-figures --fidelity {fidelity}")
    found = block.json(f"results/scene-{fidelity}/summary.json")
    block.change(('"elastic"', f'"{fidelity}"'))
    block(RUN)
    written = block.json("out/summary.json")
    assert found["components"]["block"]["fidelity"] == fidelity
    assert found["modal"] == written["modal"] and found["static"] == written["static"]
    assert f"components.block.fidelity={fidelity}" in json.dumps(found["provenance"])


POST = """
[components.post]
solid = { step = "post.step" }
material = "steel"
interfaces = { foot = { face = "z-" } }
[joints.bolts]
between = ["ground", "post.foot"]
kind = "rigid"
"""


def test_a_part_that_cannot_have_the_fidelity_keeps_its_own_and_is_named(block: Shell) -> None:
    shutil.copy(COLUMN, block.folder / "post.step")
    path = block.change(('"rigid"', '"elastic"'), add=POST)
    made, remarks = choose_fidelity(SceneChoice(path), "segmented")
    assert made.overrides == ("components.block.fidelity=segmented",)
    (remark,) = remarks
    assert remark.startswith('components.post keeps fidelity = "elastic": ')
    rigid = SceneChoice(path, overrides=("components.block.fidelity=rigid",))
    with pytest.raises(SceneError, match="read from a file"):
        choose_fidelity(rigid, "segmented")


def test_a_fidelity_without_a_part_that_deforms_ends_with_2_and_the_remedy(block: Shell) -> None:
    said = block.refuses(f"{RUN} --fidelity segmented")
    assert "--fidelity segmented changes nothing" in said and 'fidelity = "elastic"' in said
    assert "out" not in block.files()


def test_check_writes_the_problems_as_json(block: Shell) -> None:
    block("check scene.toml --json good.json")
    assert block.json("good.json")["ok"] is True
    block.change(("nu = 0.3", "nu = 0.6"))
    block("check scene.toml --json bad.json", code=2)
    content = block.json("bad.json")
    assert content["ok"] is False
    assert content["problems"][0]["key"] == "materials.steel.nu"


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("run scene.toml --accuracy 50%", "lies between 0.01 % and 20 %"),
        ("run scene.toml --ranks 3", "start through ./headstock"),
        ("run scene.toml --analysis transient", "it has: static, modal"),
        ("validate nonsense", "nonsense"),
        ("report scene.toml-nothing", "nothing"),
        ("run scene.toml --json /nonexistent/x.json", "there is no folder /nonexistent"),
        ("run scene.toml --nonsense", "No such option"),
        ("test -k store", "./headstock test"),
    ],
)
def test_bad_options_end_with_2_and_say_why(block: Shell, line: str, message: str) -> None:
    assert message in block(line, code=2).err


@pytest.mark.parametrize(
    ("line", "place"),
    [
        ("run scene.toml -o scene.toml/out", "scene.toml"),
        ("export scene.toml block -o scene.toml/x.h5", "scene.toml/x.h5 cannot be written"),
        ("export scene.toml block -o /proc/x.h5", "/proc/x.h5 cannot be written"),
    ],
)
def test_what_cannot_be_written_ends_with_1_before_anything_is_computed(
    block: Shell, line: str, place: str
) -> None:
    printed = block(line, code=1)
    assert "OutputError: " in printed.err and place in printed.err
    assert "rigid" not in printed.out


def fail_with(fault: BaseException, cause: Exception | None = None) -> int:
    raise fault from cause


def test_named_errors_end_with_1_and_show_a_traceback_only_for_debugging(
    capsys: pytest.CaptureFixture[str],
) -> None:
    fault = HeadstockError("the residual is 1e-3; make the mesh finer")
    assert guard.run_guarded(lambda: fail_with(fault), debug=False) == 1
    message = capsys.readouterr().err
    assert "HeadstockError: the residual is 1e-3" in message
    assert "Traceback" not in message
    assert guard.run_guarded(lambda: fail_with(fault), debug=True) == 1
    assert "Traceback" in capsys.readouterr().err


MEMORY = "OutOfMemoryError: the command needed more memory than there is; write a larger mesh size or keep fewer modes\n"


@pytest.mark.parametrize(
    ("lack", "said"),
    [
        (MemoryError(), MEMORY),
        (ImportError("/usr/lib/cpp.so: failed to map segment from shared object"), MEMORY),
        (OSError(errno.ENOMEM, os.strerror(errno.ENOMEM)), MEMORY),
        (RuntimeError("std::bad_alloc"), MEMORY),
        (None, "internal error: KeyError"),
    ],
    ids=["python", "library", "system", "c++", "another fault"],
)
def test_a_lack_of_memory_is_called_one_whoever_says_so_and_another_fault_a_fault(
    capsys: pytest.CaptureFixture[str], lack: Exception | None, said: str
) -> None:
    assert guard.run_guarded(lambda: fail_with(KeyError("x"), lack), debug=False) == 1
    message = capsys.readouterr().err
    assert message == said if lack else said in message
    assert "Traceback" not in message


ALLOWS = "this shell allows {} GiB of address space (ulimit -v): allow at least 0.75 GiB"
NEEDS = "needed more memory than there is; this shell allows 0.752 GiB (ulimit -v): allow more, or write a larger mesh size"


@pytest.mark.parametrize(
    ("megabytes", "said"),
    [(150, ALLOWS.format("0.146")), (500, ALLOWS.format("0.488")), (770, NEEDS)],
)
def test_a_run_without_memory_is_named_with_the_limit_of_the_shell(
    block: Shell, megabytes: int, said: str
) -> None:
    block.change(('fidelity = "rigid"', 'mesh = { size = "5 mm", cells = "hex" }'))
    # without memory a library may wait for ever: the test ends long before that of all tests would
    done = run_in_shell(f"ulimit -v {megabytes << 10}; timeout -k 5 120 {PROGRAM} {RUN}")
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("OutOfMemoryError: ")
    assert said in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("line", ["check", "plan", "run --no-figures -o [/]"])
def test_brackets_in_names_are_no_markup(line: str, block: Shell) -> None:
    name = "[/red] a [bold]block[/nonsense]"
    block.change(("A block on springs", name)).rename("[x].toml")
    # a long path breaks the line
    assert name in block.prints(f"{line} [x].toml")


@pytest.mark.parametrize(
    ("words", "redirection", "code", "said"),
    [
        ("schema", "| true", 0, ""),
        ("--help", ">&-", 0, ""),
        ("--help", "2>&-", 0, ""),
        ("schema", ">/dev/full", 1, "OutputError: what is printed cannot be written: No space left on device"),
    ],
)  # fmt: skip
def test_output_that_nobody_takes_is_no_fault_of_the_program(
    words: str, redirection: str, code: int, said: str
) -> None:
    command = f'{{ {PROGRAM} {words}; echo "code $?" >&3; }} {redirection}'
    done = run_in_shell(f"exec 3>&2; {command}")
    assert f"code {code}" in done.stderr
    assert done.stderr.replace(f"code {code}", "").strip() == said


def test_a_run_whose_reader_leaves_ends_with_its_results(block: Shell) -> None:
    done = run_in_shell(f'{PROGRAM} {RUN} | head -1; echo "code ${{PIPESTATUS[0]}}"')
    assert done.stdout.splitlines()[-1] == "code 0", done.stderr
    assert block.json("out/summary.json")["status"] == "done"


def test_a_terminal_without_arrows_and_signs_is_told_all_the_same(block: Shell) -> None:
    done = run_in_shell(f"PYTHONIOENCODING=ascii {PROGRAM} {RUN}")
    assert done.returncode == 0, done.stderr
    assert done.stdout.isascii()
    assert "um/kN" in done.stdout


def test_an_interrupt_ends_with_130() -> None:
    def interrupt() -> int:
        signal.raise_signal(signal.SIGINT)
        return 0

    # a script that runs the tests in its background has them ignore interrupts
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        assert guard.run_guarded(interrupt, debug=False) == 130
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("home", ["unset HOME", "export HOME=; figures=--no-figures"])
def test_without_home_the_libraries_get_the_one_of_the_account(block: Shell, home: str) -> None:
    done = run_in_shell(f"{home}; {PROGRAM} run scene.toml -o out $figures")
    assert (done.returncode, done.stderr) == (0, ""), done.stderr

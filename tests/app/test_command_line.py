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

from common import approx, call, run_process
from headstock.app.actions.checking import choose_fidelity
from headstock.app.command_line import main
from headstock.app.terminal import guard
from headstock.geometry.errors import HeadstockError
from headstock.pipeline.storage.provenance import SceneChoice
from headstock.scene.reading.findings import SceneError

HEAVY = ("dolfinx", "petsc4py", "slepc4py", "gmsh", "meshio", "pyvista", "matplotlib")


def test_help_imports_nothing_that_computes_and_lists_what_works() -> None:
    listing = [
        sys.executable,
        "-P",
        "-X",
        "importtime",
        "-m",
        "headstock.app.command_line",
        "--help",
    ]
    result = run_process(listing, timeout=120)
    assert result.returncode == 0
    imported = {
        line.rpartition("|")[2].strip().partition(".")[0] for line in result.stderr.splitlines()
    }
    assert "typer" in imported
    assert not imported & {*HEAVY, "numpy", "scipy", "pydantic", "mpi4py"}
    for command in (
        "check",
        "plan",
        "run",
        "study",
        "compare",
        "identify",
        "validate",
        "report",
        "doctor",
        "schema",
        "catalogue",
        "test",
    ):
        assert f"\n  {command} " in result.stdout


@pytest.mark.parametrize("name", [(), ("run",), ("show",), ("sweep",)])
def test_help_shows_brackets_as_they_are(
    name: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    text = call(capsys, [*name, "--help"]).out
    assert "\\" not in text and ("[required]" in text) == bool(name)


def test_no_heavy_library_is_imported_by_check_plan_or_a_run_without_elastic_components(
    scene_file: Path, tmp_path: Path
) -> None:
    code = (
        "import sys; from headstock.app.command_line import main\n"
        f"assert main(['check', {str(scene_file)!r}]) == 0\n"
        f"assert main(['plan', {str(scene_file)!r}]) == 0\n"
        f"assert main(['run', {str(scene_file)!r}, '-o', {str(tmp_path / 'out')!r}, '--no-figures']) == 0\n"
        f"found = [name for name in {HEAVY!r} if name in sys.modules]\n"
        "assert not found, found\n"
    )
    result = run_process([sys.executable, "-P", "-c", code], timeout=120)
    assert result.returncode == 0, result.stderr


def test_run_writes_results_summary_and_report_and_prints_stages(
    scene_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, copy = tmp_path / "out", tmp_path / "copy.json"
    assert main(["run", str(scene_file), "-o", str(out), "--json", str(copy)]) == 0
    assert sorted(path.name for path in out.iterdir()) == [
        ".headstock-files", "figures", "modes", "report.html", "results.h5", "summary.json", "tables",
    ]  # fmt: skip
    summary = json.loads((out / "summary.json").read_text())
    assert json.loads(copy.read_text()) == summary
    assert [row["stage"] for row in summary["stages"]] == [
        "rigid",
        "couple",
        "static",
        "modal",
        "write",
    ]
    assert summary["status"] == "done"
    assert summary["static"]["tcp"]["compliance_um_per_kN"][2][2] == approx(25.0, rel=1e-9)
    assert len(summary["modal"][0]["frequencies_hz"]) == 6
    printed = capsys.readouterr().out
    assert all(
        f"  {stage} " in printed for stage in ("rigid", "couple", "static", "modal", "write")
    )
    assert "µm/kN" in printed
    tables = [line for line in printed.splitlines() if str(tmp_path) not in line]
    assert max(len(line.rstrip()) for line in tables) <= 100  # as without a terminal


def test_the_second_run_of_an_unchanged_scene_takes_all_from_the_store_and_needs_no_heavy_library(
    scene_file: Path, tmp_path: Path
) -> None:
    scene_file.write_text(
        scene_file.read_text().replace('fidelity = "rigid"', 'mesh = { size = "50 mm" }')
    )
    assert main(["run", str(scene_file), "-o", str(tmp_path / "out"), "--no-figures"]) == 0
    code = (
        "import sys; from headstock.app.command_line import main\n"
        f"assert main(['run', {str(scene_file)!r}, '-o', {str(tmp_path / 'out')!r}]) == 0\n"
        f"found = [name for name in {HEAVY!r} if name in sys.modules]\n"
        "assert not found, found\n"
    )
    result = run_process([sys.executable, "-P", "-c", code], timeout=120)
    assert result.returncode == 0, result.stderr
    stages = json.loads((tmp_path / "out" / "summary.json").read_text())["stages"]
    assert [row["cached"] for row in stages if row["stage"] in {"mesh", "reduce"}] == [True, True]


def test_a_free_slide_is_named_before_anything_is_computed_and_the_loads_that_do_no_work_on_it_have_their_answer(
    scene_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene_file.write_text(scene_file.read_text().replace('x = "10 N/um", ', ""))
    assert main(["check", str(scene_file)]) == 0
    assert "nothing holds X translation of block" in " ".join(capsys.readouterr().out.split())
    assert main(["run", str(scene_file), "-o", str(tmp_path / "out"), "--no-figures"]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert printed.index("nothing holds X translation of block") < printed.index("rigid block")
    assert printed.count("warning:") == printed.count("nothing holds") == 1
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["status"] == "done"
    point = summary["static"]["tcp"]
    assert point["free_motions"] == ["X translation of block"]
    assert (
        [row[0] for row in point["compliance_um_per_kN"]]
        == point["compliance_um_per_kN"][0]
        == [None] * 3
    )
    assert point["compliance_um_per_kN"][2][2] == approx(25.0)
    assert summary["modal"][0]["rigid_count"] == 1
    assert (
        len(summary["warnings"]) == 1
        and "nothing holds X translation of block" in summary["warnings"][0]
    )


def test_a_machine_that_no_force_leaves_in_place_ends_with_1_names_what_is_free_and_still_shows_its_modes(
    scene_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene_file.write_text(
        scene_file.read_text()
        .replace('x = "10 N/um", ', "")
        .replace('y = "10 N/um", ', "")
        .replace('z = "40 N/um", ', "")
    )
    assert main(["run", str(scene_file), "-o", str(tmp_path / "out"), "--no-figures"]) == 1
    printed = " ".join(capsys.readouterr().out.split())
    assert "pose reference: 3 rigid motion(s)" in printed
    assert "X translation of block" in printed
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["status"] == "failed"
    assert summary["modal"][0]["rigid_count"] == 3


@pytest.mark.parametrize("options", [[], ["--analysis", "modal"]])
def test_plan_says_what_run_then_does(options: list[str], scene_file: Path, tmp_path: Path) -> None:
    planned, ran = tmp_path / "plan.json", tmp_path / "run.json"
    assert main(["plan", str(scene_file), *options, "--json", str(planned)]) == 0
    files = ["-o", str(tmp_path / "out"), "--no-figures", "--json", str(ran)]
    assert main(["run", str(scene_file), *options, *files]) == 0
    keys = ("stage", "component", "pose", "reason")
    rows = [
        [{key: row[key] for key in keys} for row in content]
        for content in (json.loads(planned.read_text()), json.loads(ran.read_text())["stages"])
    ]
    assert rows[0] == rows[1]


@pytest.mark.parametrize("command", ["check", "plan", "run"])
def test_a_bad_scene_ends_with_2_and_all_problems_and_touches_nothing(
    scene_file: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    command: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    scene_file.write_text(
        scene_file.read_text()
        .replace("nu = 0.3", "nu = 0.6")
        .replace('material = "steel"', 'material = "steal"')
    )
    before = sorted(tmp_path.rglob("*"))
    message = call(capsys, [command, str(scene_file)], 2).err
    assert f"{scene_file}:4" in message
    assert "steal" in message
    assert "Traceback" not in message
    assert sorted(tmp_path.rglob("*")) == before


def test_a_segmented_scene_runs_and_one_that_cannot_be_segmented_ends_with_2_and_the_reason(
    scene_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    segmented, summary = "components.block.fidelity=segmented", tmp_path / "summary.json"
    arguments = [
        "run",
        str(scene_file),
        "-o",
        str(tmp_path / "out"),
        "--no-figures",
        "--set",
        segmented,
    ]
    assert main([*arguments, "--json", str(summary)]) == 0
    found = json.loads(summary.read_text())["components"]["block"]
    assert found["fidelity"] == "segmented" and found["full_dofs"] == 60
    shutil.copy(
        Path(__file__).parents[2] / "machines" / "step_column.step", tmp_path / "block.step"
    )
    summary.unlink()
    for solid, reason in (
        ('{step = "block.step"}', "it is read from a file"),
        (
            '{column = {size = ["100 mm", "100 mm", "100 mm"], wall = "5 mm", cap = "5 mm"}}',
            "its section changes along it",
        ),
    ):
        assert (
            main([*arguments, "--set", f"components.block.solid={solid}", "--json", str(summary)])
            == 2
        )
        reported = capsys.readouterr().err
        assert reason in reported and 'write "elastic" or "rigid"' in reported
        assert not summary.exists()


@pytest.mark.parametrize("fidelity", ["rigid", "segmented"])
def test_a_run_at_a_fidelity_equals_the_scene_that_has_it_written(
    fidelity: str, scene_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    text = scene_file.read_text()
    scene_file.write_text(text.replace('"rigid"', '"elastic"'))
    assert main(["run", str(scene_file), "--no-figures", "--fidelity", fidelity]) == 0
    found = json.loads((tmp_path / "results" / f"block-{fidelity}" / "summary.json").read_text())
    scene_file.write_text(text.replace('"rigid"', f'"{fidelity}"'))
    assert main(["run", str(scene_file), "--no-figures", "-o", "written"]) == 0
    written = json.loads((tmp_path / "written" / "summary.json").read_text())
    assert found["components"]["block"]["fidelity"] == fidelity
    assert found["modal"] == written["modal"] and found["static"] == written["static"]
    assert f"components.block.fidelity={fidelity}" in json.dumps(found["provenance"])


def test_a_part_that_cannot_have_the_fidelity_keeps_its_own_and_is_named(
    scene_file: Path, tmp_path: Path
) -> None:
    shutil.copy(Path(__file__).parents[2] / "machines" / "step_column.step", tmp_path / "post.step")
    post = (
        "[components.post]\n"
        'solid = { step = "post.step" }\n'
        'material = "steel"\n'
        'interfaces = { foot = { face = "z-" } }\n'
        '[joints.bolts]\nbetween = ["ground", "post.foot"]\nkind = "rigid"\n'
    )
    scene_file.write_text(scene_file.read_text().replace('"rigid"', '"elastic"') + post)
    made, remarks = choose_fidelity(SceneChoice(scene_file), "segmented")
    assert made.overrides == ("components.block.fidelity=segmented",)
    (remark,) = remarks
    assert remark.startswith('components.post keeps fidelity = "elastic": ')
    with pytest.raises(SceneError, match="read from a file"):
        choose_fidelity(
            SceneChoice(scene_file, overrides=("components.block.fidelity=rigid",)), "segmented"
        )


def test_a_fidelity_without_a_part_that_deforms_ends_with_2_and_the_remedy(
    scene_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["run", str(scene_file), "--fidelity", "segmented", "-o", str(out)]) == 2
    reported = " ".join(capsys.readouterr().err.split())
    assert "--fidelity segmented changes nothing" in reported and 'fidelity = "elastic"' in reported
    assert not out.exists()


def test_check_writes_the_problems_as_json(scene_file: Path, tmp_path: Path) -> None:
    assert main(["check", str(scene_file), "--json", str(tmp_path / "good.json")]) == 0
    assert json.loads((tmp_path / "good.json").read_text())["ok"] is True
    scene_file.write_text(scene_file.read_text().replace("nu = 0.3", "nu = 0.6"))
    assert main(["check", str(scene_file), "--json", str(tmp_path / "bad.json")]) == 2
    content = json.loads((tmp_path / "bad.json").read_text())
    assert content["ok"] is False
    assert content["problems"][0]["key"] == "materials.steel.nu"


def test_an_unwritable_output_folder_ends_with_1_before_anything_is_computed(
    scene_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    captured = call(capsys, ["run", str(scene_file), "-o", str(tmp_path / "file" / "out")], 1)
    assert "OutputError" in captured.err
    assert "rigid" not in captured.out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "{scene}", "--accuracy", "50%"], "lies between 0.01 % and 20 %"),
        (["run", "{scene}", "--ranks", "3"], "start through ./headstock"),
        (["run", "{scene}", "--analysis", "transient"], "it has: static, modal"),
        (["validate", "nonsense"], "nonsense"),
        (["report", "{scene}-nothing"], "nothing"),
        (["run", "{scene}", "--json", "/nonexistent/x.json"], "there is no folder /nonexistent"),
        (["run", "{scene}", "--nonsense"], "No such option"),
        (["test", "-k", "store"], "./headstock test"),
    ],
)
def test_bad_options_end_with_2_and_say_why(
    scene_file: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    assert main([argument.format(scene=scene_file) for argument in arguments]) == 2
    assert message in capsys.readouterr().err


def test_named_errors_end_with_1_and_show_a_traceback_only_for_debugging(
    capsys: pytest.CaptureFixture[str],
) -> None:
    def fail() -> int:
        raise HeadstockError("the residual is 1e-3; make the mesh finer")

    assert guard.run_guarded(fail, debug=False) == 1
    message = capsys.readouterr().err
    assert "HeadstockError: the residual is 1e-3" in message
    assert "Traceback" not in message
    assert guard.run_guarded(fail, debug=True) == 1
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.parametrize(
    "lack",
    [
        MemoryError(),
        ImportError("/usr/lib/cpp.so: failed to map segment from shared object"),
        OSError(errno.ENOMEM, os.strerror(errno.ENOMEM)),
        RuntimeError("std::bad_alloc"),
    ],
    ids=["python", "library", "system", "c++"],
)
def test_a_lack_of_memory_is_called_one_whoever_says_so(
    capsys: pytest.CaptureFixture[str], lack: Exception
) -> None:
    def fail() -> int:
        try:
            raise lack
        except Exception as error:
            raise KeyError("something else") from error

    assert guard.run_guarded(fail, debug=False) == 1
    message = capsys.readouterr().err
    assert message == (
        "OutOfMemoryError: the command needed more memory than there is; write a larger mesh size or keep fewer modes\n"
    )


@pytest.mark.parametrize(
    ("megabytes", "said"),
    [
        (150, "this shell allows 0.146 GiB of address space (ulimit -v): allow at least 0.75 GiB"),
        (500, "this shell allows 0.488 GiB of address space (ulimit -v): allow at least 0.75 GiB"),
        (
            770,
            "needed more memory than there is; this shell allows 0.752 GiB (ulimit -v): allow more, or write a larger mesh size",
        ),
    ],
)
def test_a_run_without_memory_is_named_with_the_limit_of_the_shell(
    scene_file: Path, tmp_path: Path, megabytes: int, said: str
) -> None:
    scene_file.write_text(
        scene_file.read_text().replace(
            'fidelity = "rigid"', 'mesh = { size = "5 mm", cells = "hex" }'
        )
    )
    # without memory a library may wait for ever: the test ends long before that of all tests would
    limits = f'ulimit -v {megabytes << 10}; HEADSTOCK_STORE="{tmp_path}/store" timeout -k 5 120'
    program = f'{limits} "{sys.executable}" -P -m headstock.app.command_line'
    done = run_in_shell(f'{program} run "{scene_file}" -o "{tmp_path}/out"')
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("OutOfMemoryError: ")
    assert said in done.stderr
    assert "Traceback" not in done.stderr


def test_a_fault_of_the_program_is_called_one(capsys: pytest.CaptureFixture[str]) -> None:
    def fail() -> int:
        raise KeyError("x")

    assert guard.run_guarded(fail, debug=False) == 1
    message = capsys.readouterr().err
    assert "internal error: KeyError" in message
    assert "Traceback" not in message


@pytest.mark.parametrize("command", ["check", "plan", "run"])
def test_brackets_in_names_are_no_markup(
    command: str, scene_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "[x].toml"
    path.write_text(
        scene_file.read_text().replace("A block on springs", "[/red] a [bold]block[/nonsense]")
    )
    more = {"run": ["-o", str(tmp_path / "[/]"), "--no-figures"]}
    assert main([command, str(path), *more.get(command, [])]) == 0
    # a long path breaks the line
    assert "[/red] a [bold]block[/nonsense]" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("words", "redirection", "code", "said"),
    [
        ("schema", "| true", 0, ""),
        ("--help", ">&-", 0, ""),
        ("--help", "2>&-", 0, ""),
        (
            "schema",
            ">/dev/full",
            1,
            "OutputError: what is printed cannot be written: No space left on device",
        ),
    ],
)
def test_output_that_nobody_takes_is_no_fault_of_the_program(
    words: str, redirection: str, code: int, said: str
) -> None:
    command = f'{{ "{sys.executable}" -P -m headstock.app.command_line {words}; echo "code $?" >&3; }} {redirection}'
    variables = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    done = run_process(["bash", "-c", f"exec 3>&2; {command}"], env=variables)
    assert f"code {code}" in done.stderr
    assert done.stderr.replace(f"code {code}", "").strip() == said


def run_in_shell(command: str) -> subprocess.CompletedProcess[str]:
    variables = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    return run_process(["bash", "-c", command], env=variables)


def test_a_run_whose_reader_leaves_ends_with_its_results(scene_file: Path, tmp_path: Path) -> None:
    program = f'"{sys.executable}" -P -m headstock.app.command_line'
    done = run_in_shell(
        f'{program} run "{scene_file}" -o "{tmp_path}/out" --no-figures | head -1; echo "code ${{PIPESTATUS[0]}}"'
    )
    assert done.stdout.splitlines()[-1] == "code 0", done.stderr
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["status"] == "done"


def test_a_terminal_without_arrows_and_signs_is_told_all_the_same(
    scene_file: Path, tmp_path: Path
) -> None:
    program = f'PYTHONIOENCODING=ascii "{sys.executable}" -P -m headstock.app.command_line'
    done = run_in_shell(f'{program} run "{scene_file}" -o "{tmp_path}/out" --no-figures')
    assert done.returncode == 0, done.stderr
    assert done.stdout.isascii()
    assert "um/kN" in done.stdout


@pytest.mark.parametrize("folder", ["block.toml", "/proc"])
def test_an_export_that_cannot_be_written_is_named(
    folder: str, scene_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = scene_file.parent / folder / "x.h5"
    assert main(["export", str(scene_file), "block", "-o", str(path)]) == 1
    assert f"OutputError: {path} cannot be written" in capsys.readouterr().err


def test_an_interrupt_ends_with_130() -> None:
    def fail() -> int:
        signal.raise_signal(signal.SIGINT)
        return 0

    # a script that runs the tests in its background has them ignore interrupts
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        assert guard.run_guarded(fail, debug=False) == 130
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize(("home", "figures"), [({}, []), ({"HOME": ""}, ["--no-figures"])])
def test_without_home_the_libraries_get_the_one_of_the_account(
    scene_file: Path, tmp_path: Path, home: dict[str, str], figures: list[str]
) -> None:
    environment = {name: value for name, value in os.environ.items() if name != "HOME"}
    code = "import sys; from headstock.app.command_line import main; sys.exit(main(sys.argv[1:]))"
    command = [
        sys.executable,
        "-P",
        "-c",
        code,
        "run",
        str(scene_file),
        "-o",
        str(tmp_path / "out"),
    ]
    done = run_process([*command, *figures], env=environment | home)
    assert (done.returncode, done.stderr) == (0, ""), done.stderr

"""The same numbers as before: runs commands in a base commit and in the work tree side by side and
compares all they write.

    ./headstock exec python3 benchmarks/same_numbers.py                     minutes, quiet
    ./headstock exec python3 benchmarks/same_numbers.py --set full          scenes as written, too
    ./headstock exec python3 benchmarks/same_numbers.py --only cantilever   a pattern; repeatable
    ./headstock exec python3 benchmarks/same_numbers.py --base COMMIT --keep DIR --expect FILE

Each case begins with an empty store in a folder of its own, once per tree, with one BLAS thread;
both trees use their own scenes. Numbers may differ by 1e-10 of the largest of their array, texts
not at all; benchmarks/output_trees.py says what is compared and what is left out. Without --base
the base is HEAD where the work tree has changes, else where the branch left main, else the commit
before.

DIR keeps outputs; what the base commit wrote is used again for cases that are written the same.
FILE (TOML) lists differences that were judged: [[expected]] with `place`, a pattern such as
"step_column/*.html: page*", and `why`; they are printed apart. Exit code 1 where anything else
differs or a case fails, and 3 where only the base lacks a command that the work tree has.
"""

import argparse
import hashlib
import json
import math
import os
import re
import resource
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
from output_trees import Difference, differences, read_tree

PROJECT = Path(__file__).resolve().parents[1]
SCENE_FILES = Path(__file__).with_suffix(".toml")
LIMIT_SECONDS = 3600
LINES_SHOWN = 8
LACKS = ("No such command", "No such option")


@dataclass(frozen=True)
class Case:
    """Commands that share a folder and a store, empty at first.

    Attributes:
        name: What ``--only`` calls it.
        steps: Arguments of ``./headstock``, one command after the other; ``machines/`` holds the
            shipped scenes.
        code: Exit code of the last step, 0 of those before.
        full: Part of the full set only.
        masked: Patterns of files that hold times in words or pictures, and are not compared.
    """

    name: str
    steps: tuple[str, ...]
    code: int = 0
    full: bool = False
    masked: tuple[str, ...] = ()


# coarse meshes of the shipped scenes, where theirs take long
CANTILEVER = """--set 'components.column.mesh.size="50 mm"' --set 'components.column.reduction.modes_to="3 kHz"'"""
HINGE = """--set 'joints.clamp={between=["ground","column.foot"],kind="revolute",axis="y"}'"""
BEAM = """--set 'components.beam.mesh.size="60 mm"' --set 'components.beam.reduction.modes_to="3 kHz"'"""
GUIDEWAY = """--set 'components.bed.reduction.modes_to="2 kHz"'"""
MACHINE = " ".join(
    f"""--set 'components.{name}.mesh.size="60 mm"' --set 'components.{name}.reduction.modes_to="1 kHz"'"""
    for name in ("column_left", "column_right", "y_base")
)
STEP = """--set 'components.column.mesh.size="120 mm"'"""
FRF = """--set 'analyses.frf={inputs=["tcp"],up_to="300 Hz",points=51}'"""
CONTROL = """--set effects.drive_control=true --set effects.screw_inertia=true --set 'analyses.control={up_to="300 Hz"}'"""
PLANE = """--set 'sweeps.plane.axes={X=["-350 mm","350 mm",5],Y=["-400 mm","400 mm",4],Z=["200 mm","200 mm",1]}'"""
BLOCK = """--analysis contouring --set 'analyses.contouring.side="8 mm"' --set 'analyses.contouring.lead="4 mm"'"""
WORKSPACE = """--set 'sweeps.small={variant="segmented+R",axes={X=["-100 mm","100 mm",3],Y=["-100 mm","100 mm",2]}}'"""
COST = """--set 'studies.few={reference_run={"components.column.mesh.size"="40 mm"},watch=["modal.frequencies_hz[0:3]"],families={tet={label="tets",\
vary={"components.column.mesh.size"=["100 mm","50 mm"]}}}}'"""
CUT = """--set effects.cutting_force=true --set 'analyses.path.cut={mill={diameter="10 mm",teeth=2},spindle="6000 rpm",\
axial_depth="1 mm",radial_depth="1 mm",material="al7075-t6"}' --set 'analyses.path.feeds=["3000 mm/min"]'"""

CASES = (
    Case(
        "texts",
        (
            "--version",
            "schema",
            "schema targets --json targets.json",
            "schema --markdown",
            "completion bash",
            "--help",
        ),
    ),
    Case(
        "help",
        tuple(
            f"{name} --help"
            for name in ("run", "check", "plan", "study", "sweep", "effects", "compare", "export")
        ),
    ),
    Case(
        "check",
        tuple(
            f"check machines/{name}.toml --json {name}.json"
            for name in ("cantilever", "three_axis", "tripteor")
        ),
    ),
    Case(
        "bad_key",
        ("check machines/cantilever.toml --set components.column.fidelty=1 --json check.json",),
        code=2,
    ),
    Case("bad_file", ("run machines/nowhere.toml",), code=2),
    Case(
        "bad_value",
        ("""run machines/cantilever.toml --set 'materials.steel.E="210 mm"'""",),
        code=2,
    ),
    Case("bad_table", ("run everything.toml --set joints.screw=false --set axes.X=false",), code=2),
    Case(
        "plan",
        tuple(
            f"plan machines/{name}.toml --json {name}.json"
            for name in ("three_axis", "step_column", "guideway")
        ),
    ),
    Case(
        "cantilever",
        (
            f"run machines/cantilever.toml {CANTILEVER} --volume --json run.json",
            f"run machines/cantilever.toml {CANTILEVER} -o again --no-host --no-figures",
            "report again",
        ),
    ),
    Case("fixed_beam", (f"run machines/fixed_beam.toml {BEAM} --variant offset --volume",)),
    Case(
        "hexes",
        (
            f"""run machines/cantilever.toml {CANTILEVER} --set 'components.column.mesh.cells="hex"'""",
        ),
    ),
    Case(
        "linear",
        (
            f"run machines/cantilever.toml {CANTILEVER} --set 'components.column.mesh={{order = 1, allow_locking = true}}'",
        ),
    ),
    Case("free", (f"run machines/cantilever.toml {CANTILEVER} {HINGE}",)),
    Case("accuracy", ("run machines/cantilever.toml --accuracy 5%",)),
    Case("ranks", (f"run machines/cantilever.toml {CANTILEVER} --ranks 2",)),
    Case("guideway", (f"run machines/guideway.toml {GUIDEWAY} --volume",)),
    Case(
        "three_axis",
        (
            f"run machines/three_axis.toml {MACHINE} {FRF}",
            f"run machines/three_axis.toml {MACHINE} --variant rails -o rails",
        ),
    ),
    Case("segmented", (f"run machines/three_axis.toml --variant segmented+YCE {FRF}",)),
    Case(
        "control",
        (f"run machines/three_axis.toml --variant segmented+R {FRF} {CONTROL} --json run.json",),
    ),
    Case("path", ("run machines/three_axis.toml --variant segmented+BE --analysis path",)),
    Case(
        "controlled_path",
        (
            f"run machines/three_axis.toml --variant segmented+R --analysis path {CONTROL} --set effects.friction=true -o friction",
            f"run machines/three_axis.toml --variant segmented+R --analysis path {CONTROL} {CUT} -o cut",
        ),
    ),
    Case(
        "mill",
        (
            "run machines/mill.toml --variant rigid --analysis static --analysis modal --analysis path",
        ),
    ),
    Case("step_column", (f"run machines/step_column.toml {STEP}",)),
    Case("tripteor", ("run machines/tripteor.toml --analysis static --analysis modal",)),
    Case("map", (f"run machines/tripteor.toml --analysis map {PLANE}",)),
    Case(
        "contouring",
        (
            f"run machines/tripteor.toml {BLOCK}",
            f"run machines/tripteor.toml {BLOCK} --set effects.regeneration=true -o waves",
        ),
    ),
    Case(
        "nonlinear",
        (f"""run machines/tripteor.toml {BLOCK} --set 'analyses.contouring.model="nonlinear"'""",),
        full=True,
    ),
    Case(
        "legs",
        (
            "run machines/tripteor.toml --variant elastic_legs+segmented --analysis static --analysis modal",
        ),
    ),
    Case(
        "stiffening",
        ("run machines/tripteor.toml --analysis modal --set effects.gravity_stiffening=true",),
    ),
    Case(
        "everything",
        (
            "run everything.toml --volume",
            "sweep everything.toml grid -o grid",
            "sweep everything.toml along -o along",
            "sweep everything.toml some -o some",
        ),
    ),
    Case("study", ("study everything.toml screws --json study.json",)),
    Case(
        "cost",
        (f"study machines/cantilever.toml few {COST} -o cost",),
        masked=("1.out.txt", "cost/cost.png"),
    ),
    Case("compare", ("compare everything.toml --json compare.json",)),
    Case(
        "fidelity", ("compare machines/three_axis.toml --variants YCE --fidelity rigid,segmented",)
    ),
    Case(
        "compare_machine",
        ("compare machines/three_axis.toml --variants segmented+R,segmented+BE,segmented+CE",),
    ),
    Case("sweep", (f"sweep machines/three_axis.toml small {WORKSPACE} --json sweep.json",)),
    Case(
        "effects",
        (
            f"effects machines/three_axis.toml --variant segmented+R {FRF} --analysis frf --json effects.json",
        ),
        masked=("1.out.txt",),
    ),
    Case(
        "whole_effects",
        ("effects machines/three_axis.toml --variant segmented+controlled --json effects.json",),
        full=True,
        masked=("1.out.txt",),
    ),
    Case(
        "identify",
        (
            "identify machines/three_axis.toml machines/three_axis_targets.toml --starts 1 --json fit.json",
        ),
    ),
    Case(
        "measured",
        (
            "run machines/garteur.toml --variant dlr -o garteur",
            "run machines/barc.toml --variant test -o barc",
        ),
    ),
    Case(
        "identify_legs",
        ("identify machines/tripteor.toml machines/tripteor_targets.toml",),
        full=True,
    ),
    Case(
        "export",
        (
            f"export machines/cantilever.toml column {CANTILEVER} -o machines/column.h5",
            """run machines/cantilever.toml --set 'components.column.solid={superelement="column.h5"}' -o again""",
            """export machines/three_axis.toml --variant segmented+R --state-space "300 Hz" -o machine.mat""",
            f"""export machines/three_axis.toml --variant segmented+R {CONTROL} --state-space "300 Hz" -o controlled.mat""",
        ),
    ),
    Case(
        "show",
        (
            "show machines/step_column.step --json faces.json --all",
            "show everything.toml -o everything.png",
        ),
    ),
    Case(
        "new", ("new first", "check first/first.toml", "new part --part machines/step_column.step")
    ),
    Case("validate", ("validate kono-cantilever-theory torsion-constant --json rows.json",)),
    Case(
        "validate_more",
        (
            "validate all-modes two-mass-drive mechanism-derivatives tripteor-lumped --json rows.json",
        ),
    ),
    *(
        Case(f"whole_{name}", (f"run machines/{name}.toml --volume",), full=True)
        for name in (
            "cantilever",
            "fixed_beam",
            "guideway",
            "three_axis",
            "step_column",
            "tripteor",
            "mill",
        )
    ),
    Case("whole_legs", ("run machines/tripteor.toml --variant elastic_legs",), full=True),
    Case("whole_calibrated", ("run machines/three_axis.toml --variant calibrated+YCE",), full=True),
    Case("whole_compare", ("compare machines/three_axis.toml",), full=True),
    Case("whole_sweep", ("sweep machines/three_axis.toml workspace",), full=True),
    Case("whole_study", ("study machines/cantilever.toml h",), full=True),
    *(
        Case(f"validate_{group}", (f"validate {group} --json rows.json",), full=True)
        for group in (
            "beams",
            "benchmarks",
            "reduction",
            "drives",
            "time_response",
            "frequency_response",
            "tripteor_verification",
        )
    ),
)


@dataclass(frozen=True)
class Side:
    """One of the two trees.

    Attributes:
        tree: Checkout whose ``./headstock`` is called.
        place: Folder its cases are run in.
        reuse: What a case must have been written with for its outputs to be used again; None
            computes always.
    """

    tree: Path
    place: Path
    reuse: str | None = None


@dataclass(frozen=True)
class Outcome:
    """How a case went on one side.

    Attributes:
        folder: What was written.
        seconds: Wall-clock time.
        failure: What went wrong, empty when nothing did.
        lacks: Whether the tree does not know a command or an option.
    """

    folder: Path
    seconds: float
    failure: str = ""
    lacks: bool = False


def run_case(case: Case, side: Side) -> Outcome:
    """All steps of a case in an empty folder with an empty store; output of the terminal goes to
    files beside the results.
    """
    folder, record = side.place / case.name, side.place / f"{case.name}.json"
    mark = hashlib.sha256(f"{case} {side.reuse} {SCENE_FILES.read_bytes()!r}".encode()).hexdigest()
    if side.reuse is not None and record.is_file():
        kept = json.loads(record.read_text())
        if kept["mark"] == mark:
            return Outcome(folder, kept["seconds"], kept["failure"], kept["lacks"])
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    shutil.copytree(side.tree / "machines", folder / "machines")
    (folder / "everything.toml").write_text(_name_keys(SCENE_FILES.read_text(), side.tree))
    brought = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    start, outcome = time.perf_counter(), Outcome(folder, 0.0)
    with tempfile.TemporaryDirectory(prefix="headstock-store-") as store:
        for number, step in enumerate(case.steps, start=1):
            expected = case.code if number == len(case.steps) else 0
            code, errors = _run_step(
                _name_keys(step, side.tree), side.tree, folder, number=number, store=store
            )
            if code != expected:
                lacks = any(text in errors for text in LACKS)
                last = (errors.strip().splitlines() or ["nothing on stderr"])[-1]
                outcome = replace(
                    outcome, failure=f"exit code {code} of `{step[:60]}`: {last[:120]}", lacks=lacks
                )
                break
    for path, content in brought.items():
        if path.is_file() and path.read_bytes() == content:
            path.unlink()
    outcome = replace(outcome, seconds=time.perf_counter() - start)
    record.write_text(
        json.dumps(
            {
                "mark": mark,
                "seconds": outcome.seconds,
                "failure": outcome.failure,
                "lacks": outcome.lacks,
            }
        )
    )
    return outcome


def _name_keys(text: str, tree: Path) -> str:
    """Return a command or a scene with the keys that a tree knows: a frequency response ended at
    `to` before it ended at `up_to`.
    """
    if "up_to:" in (tree / "scene" / "analyses" / "frf.py").read_text():
        return text
    return re.sub(r'up_to( ?= ?"\d+ Hz"(?:,|\n)points)', r"to\1", text)


def _run_step(step: str, tree: Path, folder: Path, *, number: int, store: str) -> tuple[int, str]:
    """Exit code and standard error of one command."""
    settings = {
        "HEADSTOCK_THREADS": "1",
        "HEADSTOCK_STORE": store,
        "OPENBLAS_CORETYPE": os.environ.get("OPENBLAS_CORETYPE") or "Haswell",
        "COLUMNS": "200",
        "PYTHONHASHSEED": "random",
    }
    # the launcher puts its own tree into PYTHONPATH: that of this process must not be seen behind
    # that of the base
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in ("PYTHONPATH", "HEADSTOCK_COMMAND", "PETSC_OPTIONS")
    }
    with (
        (folder / f"{number}.out.txt").open("w") as out,
        (folder / f"{number}.err.txt").open("w") as err,
    ):
        try:
            code = subprocess.run(
                [tree / "headstock", *shlex.split(step)],
                cwd=folder,
                env=environment | settings,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                timeout=LIMIT_SECONDS,
                check=False,
            ).returncode
        except subprocess.TimeoutExpired:
            code = -1
    return code, (folder / f"{number}.err.txt").read_text(errors="replace")


@dataclass(frozen=True)
class Verdict:
    """What one case showed.

    Attributes:
        line: The line that is printed.
        details: Differences, worst first, and those that were expected with their reasons.
        same: Whether nothing unexpected differs.
        lacks: Whether the base does not know the command.
    """

    line: str
    details: tuple[str, ...]
    same: bool
    lacks: bool = False


def judge(
    case: Case, base: Outcome, now: Outcome, *, sides: tuple[Side, Side], expected: dict[str, str]
) -> Verdict:
    """Compare what both sides wrote."""
    seconds = f"{base.seconds:6.1f} s {now.seconds:6.1f} s"
    if base.lacks and not now.failure:
        return Verdict(
            f"{case.name:18s} new      {seconds}  the base lacks this: {base.failure}",
            (),
            same=True,
            lacks=True,
        )
    if base.failure or now.failure:
        details = (f"base: {base.failure or 'done'}", f"now:  {now.failure or 'done'}")
        return Verdict(f"{case.name:18s} FAILS    {seconds}", details, same=False)
    trees = [
        read_tree(outcome.folder, {str(outcome.folder): "FOLDER", str(side.tree): "TREE"})
        for outcome, side in zip((base, now), sides, strict=True)
    ]
    found = differences(*trees)
    found = [
        one
        for one in found
        if not any(fnmatchcase(one.place, f"{pattern}*") for pattern in case.masked)
    ]
    open_ones = [difference for difference in found if _reason(case, difference, expected) is None]
    judged = [difference for difference in found if difference not in open_ones]
    of_numbers = [one for one in open_ones if one.share < math.inf]
    others = [one for one in open_ones if one.share == math.inf]
    lines = [
        f"{one.place}: {one.base} -> {one.now}  ({one.share:.1e} of the scale)"
        for one in of_numbers[:LINES_SHOWN]
    ]
    lines += [f"{one.place}: {one.base} -> {one.now}" for one in others[:LINES_SHOWN]]
    lines += [f"... and {len(open_ones) - len(lines)} more"] if len(open_ones) > len(lines) else []
    lines += [
        f"expected: {one.place} ({_reason(case, one, expected)})" for one in judged[:LINES_SHOWN]
    ]
    word = "DIFFERS" if open_ones else "equal"
    numbers = sum(
        leaf.size
        for leaf in trees[1].values()
        if not isinstance(leaf, str) and leaf.dtype != np.uint8
    )
    counts = f"{numbers} numbers, {sum(isinstance(leaf, str) for leaf in trees[1].values())} texts"
    places = f", {len(open_ones)} places differ" if open_ones else ""
    return Verdict(
        f"{case.name:18s} {word:8s} {seconds}  {counts}{places}", tuple(lines), same=not open_ones
    )


def _reason(case: Case, difference: Difference, expected: dict[str, str]) -> str | None:
    place = f"{case.name}/{difference.place}"
    return next((why for pattern, why in expected.items() if fnmatchcase(place, pattern)), None)


def _git(*words: str) -> str:
    return subprocess.run(
        ["git", "-C", PROJECT, *words], check=True, capture_output=True, text=True
    ).stdout.strip()


def _default_base() -> str:
    head = _git("rev-parse", "HEAD")
    if _git("status", "--porcelain", "--untracked-files=no"):
        return head
    for branch in ("main", "origin/main"):
        if _git("branch", "--all", "--list", branch, f"remotes/{branch}"):
            fork = _git("merge-base", "HEAD", branch)
            if fork != head:
                return fork
    return _git("rev-parse", "HEAD~1")


def check_out(commit: str, place: Path) -> Path:
    """A clone of its own at a commit, which shares this one's objects."""
    tree = place / f"tree-{commit[:12]}"
    if not (tree / "headstock").is_file():
        shutil.rmtree(tree, ignore_errors=True)
        subprocess.run(
            ["git", "clone", "--quiet", "--shared", "--no-checkout", PROJECT, tree], check=True
        )
        subprocess.run(["git", "-C", tree, "checkout", "--quiet", "--detach", commit], check=True)
    return tree


@contextmanager
def _work_folder(keep: str | None) -> Iterator[Path]:
    if keep is None:
        with tempfile.TemporaryDirectory(prefix="headstock-same-") as folder:
            yield Path(folder)
    else:
        Path(keep).mkdir(parents=True, exist_ok=True)
        yield Path(keep).resolve()


def _processor_seconds() -> float:
    usage = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(part.ru_utime + part.ru_stime for part in usage)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description="Run commands in a base commit and in the work tree and compare what they write."
    )
    parser.add_argument(
        "--set", choices=("short", "full"), default="short", help="which cases [short]"
    )
    parser.add_argument(
        "--only",
        action="append",
        metavar="CASE",
        help="this case, or pattern, of any set; repeatable",
    )
    parser.add_argument("--base", metavar="COMMIT", help="what the work tree is compared with")
    parser.add_argument(
        "--keep", metavar="DIR", help="keep outputs here, and use those of the base again"
    )
    parser.add_argument("--expect", metavar="FILE", help="differences that were judged (TOML)")
    parser.add_argument("--list", action="store_true", help="print the cases and end")
    return parser.parse_args()


def main() -> int:
    """Run the cases and print one line each; the exit code."""
    arguments = _arguments()
    chosen = [case for case in CASES if not case.full or arguments.set == "full"]
    if arguments.only:
        chosen = [
            case
            for case in CASES
            if any(fnmatchcase(case.name, pattern) for pattern in arguments.only)
        ]
    if arguments.list or not chosen:
        print(
            "\n".join(
                f"{case.name:18s} {'full' if case.full else 'short':6s} {'; '.join(case.steps)}"
                for case in CASES
            )
        )
        return 0 if arguments.list else 2
    commit = (
        _git("rev-parse", "--verify", f"{arguments.base}^{{commit}}")
        if arguments.base
        else _default_base()
    )
    expected: dict[str, str] = {}
    if arguments.expect:
        expected = {
            entry["place"]: entry["why"]
            for entry in tomllib.loads(Path(arguments.expect).read_text())["expected"]
        }
    print(
        f"base {commit[:12]}, now the work tree; one thread, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}",
        flush=True,
    )
    verdicts = []
    start = time.perf_counter()
    with _work_folder(arguments.keep) as place, ThreadPoolExecutor(2) as pool:
        sides = (
            Side(check_out(commit, place), place / "base", commit if arguments.keep else None),
            Side(PROJECT, place / "now"),
        )
        for case in chosen:
            base, now = pool.map(lambda side, case=case: run_case(case, side), sides)
            verdicts.append(judge(case, base, now, sides=sides, expected=expected))
            print(
                verdicts[-1].line,
                *(f"    {line}" for line in verdicts[-1].details),
                sep="\n",
                flush=True,
            )
    wrong, lacking = (
        sum(not verdict.same for verdict in verdicts),
        sum(verdict.lacks for verdict in verdicts),
    )
    print(
        f"{len(verdicts) - wrong - lacking} of {len(verdicts)} cases equal, {wrong} differ or fail, {lacking} new; "
        f"{time.perf_counter() - start:.0f} s, {_processor_seconds():.0f} s of processor"
    )
    return 1 if wrong else 3 if lacking else 0


if __name__ == "__main__":
    sys.exit(main())

"""Measure what the next digit of accuracy costs: cost studies of four machines and six STEP parts,
and the page that lists them.

    ./headstock exec python3 benchmarks/next_digit.py [--only WORD] [--repeats N] [--folder DIR] [--page]

Default of REPEATS: 3, of DIR: `results/next_digit`. Finished points and runs are kept there, so that a
stopped call goes on where it was; the page, `next_digit.md` in this folder, is written with --page
from what is finished. Each study draws `cost.png` into its folder.
"""

import argparse
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from step_scenes import write_scene

PROJECT = Path(__file__).resolve().parents[1]
PAGE = PROJECT / "benchmarks" / "next_digit.md"
PICTURES = PROJECT / "docs" / "images"
SHOWN = ("cantilever", "three_axis")  # by pages of the documents
REFERENCE_RUN = "reference_run"
BOUNDS = (0.1, 0.03, 0.01, 0.003, 0.001)
GOAL = 2.0  # times the cheapest that is good enough
DYNAMICS = (
    'studies.cost.watch=["frf.reference.drive_points[2].chatter_limit_N_per_um", '
    '"frf.reference.drive_points[2].minimum_dynamic_stiffness_N_per_um", '
    '"path.feeds[1].outputs[0].accelerating.peak_um"]',
    'studies.cost.set={"analyses.frf" = { inputs = ["tcp"], up_to = "300 Hz", poses = ["reference"] }, '
    '"analyses.modal" = false, "analyses.static" = false, "analyses.path.on_request" = false}',
)
# nine even steps up to 300 Hz, the first of them 0 Hz
LINES = (
    'studies.cost.watch=["frf.reference.drive_points[0].lines_um_per_kN[1:9]", '
    '"frf.reference.drive_points[1].lines_um_per_kN[1:9]", '
    '"frf.reference.drive_points[2].lines_um_per_kN[1:9]"]',
    'studies.cost.set={"analyses.frf" = { inputs = ["tcp"], up_to = "300 Hz", poses = ["reference"] }, '
    '"analyses.modal" = false, "analyses.static" = false}',
)
HEAD = """# What the next digit costs

    ./headstock exec python3 benchmarks/next_digit.py --page

writes this page. Each [cost study](../docs/studies.md#what-accuracy-costs) computes a scene with many settings, each from an empty store.
It compares every watched number with its last, far finer run; the largest relative difference is the error. Seconds are processor
time of the whole run, from scene to files.
"""


@dataclass(frozen=True)
class Case:
    """A cost study.

    Attributes:
        name: Of its folder and its drawing.
        title: On the page.
        scene: File, from the root of the project; empty for a part of `step_scenes.py`.
        settings: ``key=value`` of the scene that are other than in the file.
        timed: The automatic choice is timed by ranks and threads.
        variant: Of the scene, for that.
        note: Remark on its numbers.
    """

    name: str
    title: str
    scene: str
    settings: tuple[str, ...] = ()
    timed: bool = True
    variant: str = ""
    note: str = ""


def _own_part(name: str, title: str) -> Case:
    """A part that is built here, and its scene."""
    return Case(f"step_{name}", f"{title}: four frequencies and three compliances", "", timed=False)


CASES = (
    Case("cantilever", "Cantilever: six frequencies", "machines/cantilever.toml"),
    Case(
        "fixed_beam",
        "Fixed beam: six frequencies and the deflection under a small patch",
        "machines/fixed_beam.toml",
    ),
    Case(
        "three_axis",
        "Three-axis machine: five frequencies and three compliances",
        "machines/three_axis.toml",
    ),
    Case(
        "three_axis_dynamics",
        "Three-axis machine: limit depth of cut, dynamic stiffness and deviation from a path",
        "machines/three_axis.toml",
        DYNAMICS,
        timed=False,
    ),
    Case(
        "three_axis_lines",
        "Three-axis machine: 24 lines of the frequency response at the tool",
        "machines/three_axis.toml",
        LINES,
        timed=False,
        note="near an antiresonance a line changes by several percent where frequencies change by some hundredths of a percent; "
        "searches follow peaks and static levels, not single lines",
    ),
    Case(
        "tripteor",
        "Legs of the Tripteor: six frequencies",
        "machines/tripteor.toml",
        variant="elastic_legs",
    ),
    Case(
        "step_column",
        "Column from STEP: six frequencies and three compliances",
        "machines/step_column.toml",
    ),
    Case(
        "step_bracket",
        "Bracket from STEP: four frequencies and three compliances",
        "tests/data/support.toml",
    ),
    _own_part("angle", "Angle with a gusset"),
    _own_part("housing", "Housing with ribs and bearing seats"),
    _own_part("elbow", "Cast quarter bend of a pipe"),
    _own_part("bolt_plate", "Plate with 96 bores"),
)
# threads and ranks of one run of the automatic choice for 1 %
TEAMS = ((1, 1), (1, 2), (2, 1))


def main() -> int:
    """Compute what is not finished, and write the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", default="", help="in the name of a study")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--folder", type=Path, default=PROJECT / "results" / "next_digit")
    parser.add_argument("--page", action="store_true", help="write it")
    options = parser.parse_args()
    for case in CASES:
        if options.only in case.name:
            _study(case, options.folder, options.repeats)
            _time_teams(case, options.folder)
    if options.page:
        _write_page(options.folder)
    return 0


def _study(case: Case, folder: Path, repeats: int) -> None:
    """Compute the points of a study that are not finished."""
    given = [f"--set={setting}" for setting in case.settings]
    scene = case.scene or str(write_scene(case.name.removeprefix("step_"), folder / "parts"))
    words = [scene, "cost", "--repeats", str(repeats), "-o", str(folder / case.name)]
    variables = {**os.environ, "HEADSTOCK_THREADS": "1"}
    _note_machine(folder)
    subprocess.run(
        [str(PROJECT / "headstock"), "study", *words, *given],
        cwd=PROJECT,
        env=variables,
        check=False,  # points that failed are on the page
    )


def _time_teams(case: Case, folder: Path) -> None:
    """Seconds by the clock of the automatic choice for 1 % by ranks and threads."""
    file = folder / case.name / "teams.json"
    found: dict[str, float] = json.loads(file.read_text()) if file.exists() else {}
    for ranks, threads in TEAMS:
        name = f"{ranks} x {threads}"
        if name in found or not case.timed:
            continue
        with tempfile.TemporaryDirectory(prefix="headstock-digit-") as place:
            variables = {
                **os.environ,
                "HEADSTOCK_STORE": f"{place}/store",
                "HEADSTOCK_THREADS": str(threads),
            }
            words = [case.scene, "--accuracy", "1%", "--no-figures", "-o", f"{place}/out"]
            words += ["--variant", case.variant] if case.variant else []
            begin = time.perf_counter()
            done = subprocess.run(
                [str(PROJECT / "headstock"), "run", *words, "--ranks", str(ranks)],
                cwd=PROJECT,
                env=variables,
                capture_output=True,
                check=False,
            )
            if done.returncode == 0:
                found[name] = round(time.perf_counter() - begin, 2)
        file.write_text(json.dumps(found) + "\n")


def _note_machine(folder: Path) -> None:
    """What the seconds were measured on, with every study that was begun."""
    folder.mkdir(parents=True, exist_ok=True)
    models = [
        line.split(":")[1].strip()
        for line in Path("/proc/cpuinfo").read_text().splitlines()
        if line.startswith("model name")
    ]
    cores = len(os.sched_getaffinity(0))
    machine = f"{cores} core{'s' * (cores > 1)} of {models[0] if models else platform.machine()}"
    with (folder / "machines.jsonl").open("a", encoding="utf-8") as file:
        file.write(json.dumps({"machine": machine, "load": os.getloadavg()[0]}) + "\n")


def _describe_machines(folder: Path) -> str:
    """Machines of all calls, and how busy they were before."""
    lines = (folder / "machines.jsonl").read_text().splitlines()
    loads: dict[str, list[float]] = {}
    for entry in map(json.loads, lines):
        loads.setdefault(entry["machine"], []).append(entry["load"])
    return "; ".join(
        f"{machine}, load {min(found):.1f} to {max(found):.1f} before each study"
        for machine, found in loads.items()
    )


def _write_page(folder: Path) -> None:
    """Write the page of all studies that are finished, and copy the pictures that documents show."""
    studies = {
        case: json.loads(file.read_text())
        for case in CASES
        if (file := folder / case.name / "study.json").exists()
    }
    repeats = sorted({study["repeats"] for study in studies.values()})
    text = [HEAD, f"Machine: {_describe_machines(folder)}; one BLAS thread, one rank;"]
    spread = " to ".join(str(count) for count in dict.fromkeys((repeats[0], repeats[-1])))
    text += [f"medians of {spread} runs.", ""]
    missing = [f"`{case.name}`" for case in CASES if case not in studies]
    text += [f"Not finished: {', '.join(missing)}.", ""] if missing else []
    text += [*_automatic(studies), ""]
    text += [*_teams(folder), ""]
    text += [*_cheapest(studies), ""]
    remarks = [f"- `{case.name}`: {line}" for case in studies for line in [case.note] if line]
    remarks += [
        f"- `{case.name}`, {line}"
        for case, study in studies.items()
        for line in _other_models(study)
    ]
    PAGE.write_text("\n".join(text + remarks).replace("\n\n\n", "\n\n").rstrip() + "\n")
    for name in SHOWN:
        if (drawn := folder / name / "cost.png").exists():
            shutil.copy(drawn, PICTURES / f"cost_{name}.png")


def _points(study: dict[str, Any], *, automatic: bool) -> list[dict[str, Any]]:
    """Points of a study that have an error, with the accuracy that was asked for."""
    rows = [
        row for row in study["rows"] if row["status"] == "done" and row["family"] != REFERENCE_RUN
    ]
    points = [
        {**cost, "asked": row["varied"].get("accuracy"), "cost": cost["cpu seconds"]}
        for row, cost in zip(rows, study.get("costs", []), strict=True)
    ]
    return [
        point
        for point in points
        if point["automatic"] == automatic
        and not point["other model"]
        and point["error"] is not None
    ]


def _find_cheapest(study: dict[str, Any], bound: float) -> dict[str, Any] | None:
    good = [point for point in _points(study, automatic=False) if point["error"] <= bound]
    return min(good, key=lambda point: float(point["cost"])) if good else None


def _cheapest(studies: dict[Case, dict[str, Any]]) -> list[str]:
    """The cheapest point of each study for each of some accuracies, where it differs from that of
    the accuracy before.
    """
    lines = [
        "The cheapest settings that each study tries for an accuracy; where a row is left out they are those of the row above, or there are none.",
        "",
        "| | largest error | cheapest (its error) | processor time | memory |",
        "| --- | --- | --- | --- | --- |",
    ]
    for case, study in studies.items():
        before: dict[str, Any] | None = None
        for bound in BOUNDS:
            found = _find_cheapest(study, bound)
            if found is None or (before and found["settings"] == before["settings"]):
                continue
            named = f"{found['settings']} ({100 * found['error']:.2g} %)"
            lines.append(
                f"| {case.title if before is None else ''} | {100 * bound:g} % | {named} | {found['cost']:.3g} s | {found['MB']:.0f} MB |"
            )
            before = found
    return lines


def _automatic(studies: dict[Case, dict[str, Any]]) -> list[str]:
    """Automatic choices, the cheapest that is good enough, and whether the goals are met."""
    lines = [
        "Automatic choices, compared with the cheapest point of the same study whose error is within the accuracy. "
        f"Goal: an error within the accuracy, at most {GOAL:g} times the cheapest.",
        "",
        "| | accuracy | true error | processor time, all rounds | cheapest | ratio | |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for case, study in studies.items():
        for point in _points(study, automatic=True):
            asked = float(str(point["asked"]).rstrip(" %")) / 100.0
            cheapest = _find_cheapest(study, asked)
            ratio = point["cost"] / cheapest["cost"] if cheapest else None
            met = point["error"] <= asked and (ratio is None or ratio <= GOAL)
            lines.append(
                f"| `{case.name}` | {point['asked']} | {100 * point['error']:.2g} % | {point['cost']:.3g} s | "
                + (f"{cheapest['cost']:.3g} s | {ratio:.3g} | " if cheapest else "none | | ")
                + ("met |" if met else "missed |")
            )
    return lines


def _teams(folder: Path) -> list[str]:
    """Seconds by the clock by ranks and threads."""
    lines = [
        "Elapsed seconds of `run --accuracy 1%` by ranks and BLAS threads, start of the processes included, one run each:",
        "",
        "| | "
        + " | ".join(
            f"{ranks} rank{'s' * (ranks > 1)}, {threads} thread{'s' * (threads > 1)}"
            for ranks, threads in TEAMS
        )
        + " |",
        "| --- |" + " --- |" * len(TEAMS),
    ]
    for case in CASES:
        file = folder / case.name / "teams.json"
        found = json.loads(file.read_text()) if case.timed and file.exists() else {}
        if found:
            cells = [str(found.get(f"{ranks} x {threads}", "failed")) for ranks, threads in TEAMS]
            lines.append(f"| {case.name} | {' | '.join(cells)} |")
    return lines if len(lines) > 4 else []


def _other_models(study: dict[str, Any]) -> list[str]:
    """What the study says of other models."""
    lines = [line for line in study.get("digits", []) if "another model" in line]
    return [re.sub(r"away in (\S+):", r"away in `\1`:", line) for line in lines]


if __name__ == "__main__":
    sys.exit(main())

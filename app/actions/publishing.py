"""Everything a finished run leaves besides ``results.h5`` and ``summary.json``: report, tables,
figures and mode shapes.
"""

import importlib
import json
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import jinja2

from headstock.app.commands.tool_commands import ReportOptions
from headstock.app.pictures.pictures import (
    Drawing,
    draw_charts,
    draw_machine,
    draw_modes,
    stills_by_pose,
)
from headstock.app.report.report import Stills, Worth, render_report, write_report
from headstock.app.tables.table import encode_csv
from headstock.app.terminal.console import print_remarks
from headstock.app.terminal.guard import DONE
from headstock.app.views.registry import list_tables
from headstock.app.views.view import FinishedRun
from headstock.meshing.process.strangers import SUMMARY, require_size
from headstock.pipeline.numbers.folders import SUMMARY_FILE
from headstock.pipeline.results.files import (
    FIGURES_FOLDER,
    REPORT_FILE,
    TABLES_FOLDER,
    open_results,
    read_summary,
)
from headstock.pipeline.results.mode_files import MODES_FOLDER, VOLUME_FOLDER, write_mode_files
from headstock.pipeline.results.summary import RunSummary
from headstock.pipeline.storage.outputs import (
    UnusableOutputError,
    claim_output,
    replace_outputs,
)
from headstock.pipeline.storage.provenance import ProvenanceSummary
from headstock.pipeline.storage.store import Store, default_store_root
from headstock.pipeline.storage.typed_json import find_fault

CHART_MODULE = "headstock.app.charts.effects"
EFFECTS_MODULE = "headstock.studies.effects"
EFFECTS_FILE = "effects.json"  # beside the results of the scene that it is of
PARTS = (TABLES_FOLDER, FIGURES_FOLDER, MODES_FOLDER, VOLUME_FOLDER)


def publish_run(
    folder: Path, run: FinishedRun, *, figures: bool = True, more: Sequence[Drawing] = ()
) -> list[str]:
    """Write report, tables and modes, and pictures of the machine while that goes on; remarks for
    the user.

    Args:
        figures: Draw pictures of the machine; else the report has none for browsers without WebGL.
        more: Pictures for ``figures`` besides those of the machine.

    Raises:
        OutputError: A file cannot be written.
    """
    store, view = Store(default_store_root()), run.machine
    with ThreadPoolExecutor(1) as pool:
        drawing = pool.submit(draw_machine, view, store) if figures else None
        remarks = [
            *_write_tables(folder, run),
            *write_mode_files(folder, run.summary["modal"], view),
        ]
        drawn = drawing.result() if drawing is not None else Drawing({})
    images = {name: image for part in (*more, drawn) for name, image in part.images.items()}
    remarks += replace_outputs(
        folder, FIGURES_FOLDER, {f"{name}.png": image for name, image in images.items()}
    )
    stills = Stills(stills_by_pose(view, drawn.images), drawn.remark)
    write_report(folder, run, stills, _read_worth(folder, run.summary))
    return list(dict.fromkeys([*remarks, *(part.remark for part in (drawn, *more) if part.remark)]))


def report_command(options: ReportOptions) -> int:
    """Write the report of a finished run again, and say where."""
    print(renew_report(options.folder))
    return DONE


def renew_report(folder: Path) -> Path:
    """Write what `_publish_again` writes from a folder of results, and say what there is to remark;
    the file of the report.

    Raises:
        UnusableOutputError: There is no summary, or not one that this version writes.
        OutputError: A file cannot be written.
    """
    summary = read_summary(folder)
    with claim_output(folder, (REPORT_FILE,), PARTS):
        results = open_results(folder)
        run = FinishedRun(summary, results.answers, results.view)
        print_remarks(_publish_again(folder, run))
    return folder / REPORT_FILE


def _read_worth(folder: Path, summary: RunSummary) -> Worth | None:
    """What effects and models of the scene are worth, where ``effects.json`` of the same scene lies
    beside its results.
    """
    path = folder / EFFECTS_FILE
    try:
        require_size(path, SUMMARY, UnusableOutputError)
        content = json.loads(path.read_text(encoding="utf-8"))
        kind = importlib.import_module(EFFECTS_MODULE).EffectsSummary  # loads what studies need
        if find_fault(content, kind) or not is_same_scene(
            content["provenance"], summary["provenance"]
        ):
            return None
    except (OSError, UnusableOutputError, ValueError, LookupError, TypeError, RecursionError):
        return None
    charts = importlib.import_module(CHART_MODULE)  # loads matplotlib
    return Worth(content, charts.draw_worth(content))


def is_same_scene(first: ProvenanceSummary, second: ProvenanceSummary) -> bool:
    """Compare the text, variant and overrides that two results come from."""
    own, other = (
        (each["scene_sha256"], each["variant"], each["overrides"]) for each in (first, second)
    )
    return own == other


def _publish_again(folder: Path, run: FinishedRun) -> list[str]:
    """Report, tables, modes and pictures anew from the files of a run, with all modes and every
    chart; remarks for the user.

    Raises:
        UnusableOutputError: The summary is not one that this version writes.
        OutputError: A file cannot be written.
    """
    try:
        # before anything is overwritten: the numbers may contradict each other
        plain = FinishedRun(run.summary, machine=run.machine)
        list_tables(plain)
        render_report(plain)
        with ThreadPoolExecutor(1) as pool:
            modes = pool.submit(draw_modes, run.summary, run.machine)
            more = (draw_charts(folder), modes.result())
        return publish_run(folder, run, more=more)
    except (
        ArithmeticError,
        AttributeError,
        LookupError,
        TypeError,
        ValueError,
        jinja2.TemplateError,
    ) as error:
        raise UnusableOutputError(
            f"{folder / SUMMARY_FILE} holds something else than this version writes ({type(error).__name__}: {error}); run the scene again"
        ) from error


def _write_tables(folder: Path, run: FinishedRun) -> list[str]:
    """Write every table as ``tables/NAME.csv``, and remove those of an earlier run; remarks for the
    user.

    Raises:
        OutputError: A file cannot be written.
    """
    contents = {f"{table.name}.csv": encode_csv(table) for table in list_tables(run)}
    return replace_outputs(folder, TABLES_FOLDER, contents)

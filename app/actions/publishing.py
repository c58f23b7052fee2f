"""Everything a finished run leaves besides ``results.h5`` and ``summary.json``: report, tables,
figures and mode shapes.
"""

import importlib
import json
from collections.abc import Mapping, Sequence
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
from headstock.app.report.marks import EFFECTS_FILE, mark_report
from headstock.app.report.report import Stills, Worth, render_report, write_report
from headstock.app.tables.table import encode_csv
from headstock.app.terminal.console import print_remarks
from headstock.app.terminal.guard import DONE
from headstock.app.views.registry import find_views, list_tables
from headstock.meshing.process.strangers import SUMMARY, require_size
from headstock.pipeline.numbers.folders import RESULTS_FILE, read_summary
from headstock.pipeline.results.files import (
    FIGURES_FOLDER,
    PUBLISHED,
    REPORT_FILE,
    TABLES_FOLDER,
    open_results,
)
from headstock.pipeline.results.mode_files import VOLUME_FOLDER, write_mode_files
from headstock.pipeline.results.results import Results
from headstock.pipeline.storage.outputs import (
    UnusableOutputError,
    claim_output,
    replace_outputs,
)
from headstock.pipeline.storage.provenance import Provenance
from headstock.pipeline.storage.store import Store, default_store_root
from headstock.pipeline.storage.typed_json import find_fault

CHART_MODULE = "headstock.app.charts.effects"
EFFECTS_MODULE = "headstock.studies.effects"


def publish_run(
    folder: Path, run: Results, *, figures: bool = True, more: Sequence[Drawing] = ()
) -> list[str]:
    """Write report, tables and modes, and pictures of the machine while that goes on; remarks for
    the user.

    Args:
        figures: Draw pictures of the machine; else the report has none for browsers without WebGL.
        more: Pictures for ``figures`` besides those of the machine.

    Raises:
        OutputError: A file cannot be written.
    """
    store, view = Store(default_store_root()), run.view
    with ThreadPoolExecutor(1) as pool:
        drawing = pool.submit(draw_machine, view, store) if figures else None
        remarks = [
            *_write_tables(folder, run),
            *write_mode_files(folder, run.modal, view),
        ]
        drawn = drawing.result() if drawing is not None else Drawing({})
    images = {name: image for part in (*more, drawn) for name, image in part.images.items()}
    remarks += replace_outputs(
        folder, FIGURES_FOLDER, {f"{name}.png": image for name, image in images.items()}
    )
    stills = Stills(stills_by_pose(view, drawn.images), drawn.remark)
    remarks += [part.remark for part in (drawn, *more) if part.remark]
    mark = "" if remarks else mark_report(folder, run, figures=figures)
    write_report(folder, run, stills, _read_worth(folder, run.provenance), mark)
    return list(dict.fromkeys(remarks))


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
    read_summary(folder)  # what is no folder of results is not claimed
    with claim_output(folder, (REPORT_FILE,), (*PUBLISHED, VOLUME_FOLDER)):
        print_remarks(_publish_again(folder, open_results(folder)))
    return folder / REPORT_FILE


def _read_worth(folder: Path, origin: Provenance | None) -> Worth | None:
    """What effects and models of the scene are worth, where ``effects.json`` of the same scene lies
    beside its results.
    """
    path = folder / EFFECTS_FILE
    if origin is None:
        return None
    try:
        require_size(path, SUMMARY, UnusableOutputError)
        content = json.loads(path.read_text(encoding="utf-8"))
        kind = importlib.import_module(EFFECTS_MODULE).EffectsSummary  # loads what studies need
        if find_fault(content, kind) or not is_same_scene(
            content["provenance"], origin.summarise()
        ):
            return None
    except (OSError, UnusableOutputError, ValueError, LookupError, TypeError, RecursionError):
        return None
    charts = importlib.import_module(CHART_MODULE)  # loads matplotlib
    return Worth(content, charts.draw_worth(content))


def is_same_scene(first: Mapping[str, object], second: Mapping[str, object]) -> bool:
    """Compare the text, variant and overrides that two results come from."""
    keys = ("scene_sha256", "variant", "overrides")
    return all(key in first and first[key] == second.get(key) for key in keys)


def _publish_again(folder: Path, run: Results) -> list[str]:
    """Report, tables, modes and pictures anew from the files of a run, with all modes and every
    chart; remarks for the user.

    Raises:
        UnusableOutputError: The results are not those that this version writes.
        OutputError: A file cannot be written.
    """
    try:
        # before anything is overwritten: the numbers may contradict each other
        list_tables(run, long=False)
        render_report(run)
        with ThreadPoolExecutor(1) as pool:
            modes = pool.submit(draw_modes, run)
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
            f"{folder / RESULTS_FILE} holds something else than this version writes ({type(error).__name__}: {error}); run the scene again"
        ) from error


def _write_tables(folder: Path, run: Results) -> list[str]:
    """Write every table as ``tables/NAME.csv``, and remove those of an earlier run; remarks for the
    user.

    Raises:
        OutputError: A file cannot be written.
    """
    contents = {f"{table.name}.csv": encode_csv(table) for table in list_tables(run)}
    for view in find_views(run):
        contents |= view.files(run)
    return replace_outputs(folder, TABLES_FOLDER, contents)

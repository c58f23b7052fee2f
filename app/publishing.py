"""Everything a finished run leaves besides ``results.h5`` and ``summary.json``: report, tables, figures and mode shapes."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import jinja2

from headstock.app.frf_tables import tabulate_response
from headstock.app.path_tables import tabulate_path
from headstock.app.pictures import Drawing, draw_machine, draw_pictures, stills_by_pose
from headstock.app.report import render_report, write_report
from headstock.app.summary_tables import encode_csv, list_tables
from headstock.pipeline.frf_results import ResponseCurves
from headstock.pipeline.json_texts import Json
from headstock.pipeline.machine_views import MachineView
from headstock.pipeline.mode_files import write_mode_files
from headstock.pipeline.path_results import PathCurves
from headstock.pipeline.result_files import SUMMARY_FILE, OutputError, write_output
from headstock.pipeline.store import Store, default_store_root

TABLES_FOLDER, FIGURES_FOLDER = "tables", "figures"


def publish_run(
    folder: Path,
    summary: Json,
    view: MachineView,
    curves: Sequence[ResponseCurves] = (),
    paths: Sequence[PathCurves] = (),
    *,
    figures: bool = True,
) -> list[str]:
    """Write report, tables and modes, and pictures of the machine while that goes on; remarks for the user.

    Args:
        folder: Folder of results.
        summary: Content of ``summary.json``.
        view: What there is to draw.
        curves: Of the frequency responses.
        paths: Of the path analysis.
        figures: Draw pictures of the machine; else the report has none for browsers without WebGL.

    Raises:
        OutputError: A file cannot be written.
    """
    store = Store(default_store_root())
    with ThreadPoolExecutor(1) as pool:
        drawing = pool.submit(draw_machine, folder, view, store) if figures else None
        write_tables(folder, summary, curves, paths)
        write_mode_files(folder, summary, view)
        drawn = drawing.result() if drawing is not None else Drawing({})
    _write_files(folder / FIGURES_FOLDER, {f"{name}.png": image for name, image in drawn.images.items()}, "*.png")
    write_report(folder, summary, view, stills_by_pose(view, drawn.images), curves, paths)
    return [drawn.remark] if drawn.remark else []


def publish_again(
    folder: Path,
    summary: Json,
    view: MachineView,
    curves: Sequence[ResponseCurves] = (),
    paths: Sequence[PathCurves] = (),
) -> list[str]:
    """The same from the files of a run, with the pictures of all modes and every chart; remarks for the user.

    Raises:
        OutputError: The summary is not one that this version writes, or a file cannot be written.
    """
    try:
        list_tables(summary)
        render_report(summary, view)
    except (LookupError, TypeError, ValueError, AttributeError, jinja2.TemplateError) as error:
        # before anything is overwritten: the file may be edited, or of another version
        raise OutputError(
            f"{folder / SUMMARY_FILE} holds something else than this version writes ({type(error).__name__}: {error}); run the scene again"
        ) from error
    remarks = publish_run(folder, summary, view, curves, paths)
    drawn = draw_pictures(folder, "all")
    # the machine itself stays as it is in the report
    target = folder / FIGURES_FOLDER
    kept = {path.name: path.read_bytes() for path in target.glob("machine_*.png")}
    _write_files(target, {f"{name}.png": image for name, image in drawn.images.items()} | kept, "*.png")
    return remarks + ([drawn.remark] if drawn.remark and drawn.remark not in remarks else [])


def write_tables(folder: Path, summary: Json, curves: Sequence[ResponseCurves] = (), paths: Sequence[PathCurves] = ()) -> None:
    """Write every table as ``tables/NAME.csv``.

    Raises:
        OutputError: A file cannot be written.
    """
    tables = [*list_tables(summary), *map(tabulate_response, curves), *map(tabulate_path, paths)]
    _write_files(folder / TABLES_FOLDER, {f"{table.name}.csv": encode_csv(table) for table in tables}, "*.csv")


def _write_files(folder: Path, files: dict[str, bytes], pattern: str) -> None:
    """Write files into a folder, and remove those of the pattern that are not among them."""
    try:
        if files:
            folder.mkdir(exist_ok=True)
        for name, content in files.items():
            write_output(folder / name, content)
        for path in folder.glob(pattern):
            if path.name not in files:
                path.unlink()
    except OSError as error:
        raise OutputError(f"{folder} cannot be written: {error.strerror or error}") from error

"""The report: one HTML file that works offline, made from what a run found and from what there
is to draw.
"""

import base64
import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jinja2
from markupsafe import Markup

from headstock.app.drawings.figures import percent
from headstock.app.drawings.markup import (
    draw_rows,
    format_number,
    show_number,
    write_bound,
    write_bounded,
    write_data,
)
from headstock.app.report.notes import list_notes
from headstock.app.report.template_code import TemplateCode
from headstock.app.report.viewer_data import Caption, EncodedMachine, Kind, encode_machine
from headstock.app.tables.static import PointRow, list_point_rows, shared_budget, top_shares
from headstock.app.tables.table import PlainTable, encode_csv
from headstock.app.texts.bounded_values import show_damping
from headstock.app.texts.remarks import fold_remarks
from headstock.app.views.registry import COMPONENT_COLUMNS, find_views, list_tables
from headstock.app.views.view import Section
from headstock.geometry.frames import DIRECTIONS
from headstock.geometry.machine.machine import show_position
from headstock.pipeline.answers.static import StaticAnswer
from headstock.pipeline.numbers.estimates import known_part, show_share
from headstock.pipeline.results.files import REPORT_FILE
from headstock.pipeline.results.mode_files import file_stem
from headstock.pipeline.results.results import Results
from headstock.pipeline.results.summary import sum_up, summarise_stage
from headstock.pipeline.results.views import component_colors
from headstock.pipeline.storage.outputs import write_output
from headstock.reduction.motions.mode_naming import WHOLE_MACHINE

if TYPE_CHECKING:
    from headstock.studies.effects import EffectsSummary

TEMPLATE, STYLE, VIEWER = "report_template.html", "report.css", "viewer/viewer.bundle.js"
SMALLEST_NAMED = 0.02


@dataclass(frozen=True, eq=False)
class Stills:
    """Pose to a PNG of the machine, and why there is none."""

    images: Mapping[str, bytes] = field(default_factory=dict)
    remark: str | None = None


@dataclass(frozen=True, eq=False)
class Worth:
    """What effects and models of the scene are worth: content of ``effects.json``, and its chart as
    a PNG, None where there is nothing to draw.
    """

    summary: "EffectsSummary"
    chart: bytes | None


def write_report(
    folder: Path,
    run: Results,
    stills: Stills | None = None,
    worth: Worth | None = None,
    mark: str = "",
) -> Path:
    """Write ``report.html`` into a folder of results.

    Args:
        run: What is reported; without poses to draw the report has no machine view.
        stills: Pictures of the machine, for browsers without WebGL and for paper.
        worth: Of effects and models, where that is known.
        mark: What it is made of, for the next run; empty where that should make it again.

    Raises:
        OutputError: It cannot be written.
    """
    path = folder / REPORT_FILE
    write_output(path, render_report(run, stills, worth, mark).encode())
    return path


def render_report(
    run: Results, stills: Stills | None = None, worth: Worth | None = None, mark: str = ""
) -> str:
    """Return the report as HTML text that refers to nothing outside itself.

    Every number from the summary is in a ``data`` element, or an SVG text, with its unrounded value
    as an attribute.

    Args:
        run: What is reported; without poses to draw the report has no machine view.
        stills: Pictures of the machine, for browsers without WebGL and for paper.
        worth: Of effects and models, where that is known.
        mark: As in ``write_report``.
    """
    stills = stills or Stills()
    machine = encode_machine(run.view, _captions(run))
    tables = {table.name: table for table in list_tables(run, long=False)}
    names = {
        "run": run,
        "poses": list(run.view.poses),
        "colors": component_colors(run.view),
        "tables": tables,
        "save": functools.partial(_offer_table, tables),
        "encode": lambda name: _encode_table(tables[name]),
    }
    sections = _write_sections(run, names)
    return (
        report_environment()
        .get_template(TEMPLATE)
        .render(
            names,
            mark=mark,
            keys=_key_figures(run),
            totals=sum_up(run),
            stages=[*map(summarise_stage, run.stages)],
            origin=run.provenance and run.provenance.summarise(),
            sections=sections,
            machine=None if machine is None else Markup(machine.text),
            omissions=describe_omissions(machine),
            stills={
                pose: base64.b64encode(image).decode() for pose, image in stills.images.items()
            },
            still_remark=stills.remark,
            notes=list_notes(run),
            columns=COMPONENT_COLUMNS,
            worth=None if worth is None else worth.summary,
            chart=None if worth is None else worth.chart,
            style=Markup(read_asset(STYLE)),
            scripts=[
                Markup(read_asset(name))
                for name in (VIEWER, *dict.fromkeys(section.script for section, _ in sections))
                if name
            ],
        )
    )


def _write_sections(run: Results, names: Mapping[str, Any]) -> list[tuple[Section, Markup]]:
    """Return every section, and what its template writes below its lead and its tables.

    Args:
        names: What every template may use.
    """
    environment, sections = report_environment(), []
    for view in find_views(run):
        if (section := view.make_section(run)) is not None:
            text = ""
            if section.template:
                text = environment.get_template(section.template).render(names, **section.names)
            sections.append((section, Markup(text)))
    return sections


def _offer_table(tables: Mapping[str, PlainTable], name: str, identity: str) -> Markup:
    """Write links to a table as a file, and to the picture of an element.

    Args:
        identity: ``id`` of the element in the page.
    """
    return Markup(
        '<div class="tools"><a class="save" download="{}.csv" href="data:text/csv;charset=utf-8;base64,{}">CSV</a>'
        '<button type="button" data-png="{}" hidden>PNG</button></div>\n'
    ).format(name, _encode_table(tables[name]), identity)


def _encode_table(table: PlainTable) -> str:
    return base64.b64encode(encode_csv(table)).decode()


@dataclass(frozen=True)
class _KeyFigures:
    """What a reader wants first.

    Attributes:
        point: Of the first static answer; None without any.
        compliances: There: direction, compliance along it with its ± [um/kN], and the part that
            gives most.
        text: What it says about the weak link.
        first: Frequency, its error [Hz], name and number of the first mode in which the machine does
            not move as a whole.
    """

    point: str | None = None
    compliances: Sequence[tuple[str, float | None, float | None, str]] = ()
    text: str = ""
    first: tuple[float, float | None, str, int] | None = None


def _key_figures(run: Results) -> _KeyFigures:
    """Return the compliance of the first point in the first pose, and the first mode in which the
    machine does not move as a whole.
    """
    first = None
    for modes in run.modal[:1]:
        numbers = range(modes.below + 1, modes.below + len(modes.mode_names) + 1)
        hz = map(float, modes.frequencies_hz)
        rows = zip(hz, modes.error_hz, modes.mode_names, numbers, strict=True)
        named = list(rows)[modes.rigid_count :]
        first = next((mode for mode in named if WHOLE_MACHINE not in mode[2]), None)
    for row in list_point_rows(run.find(StaticAnswer)):
        return _KeyFigures(row.name, _list_compliances(row), row.point.text, first)
    return _KeyFigures(first=first)


def _list_compliances(row: PointRow) -> list[tuple[str, float | None, float | None, str]]:
    budget, found = shared_budget(row.point), []
    for number, direction in enumerate(DIRECTIONS):
        top = top_shares(budget.get(direction, {}), 1, SMALLEST_NAMED)
        error = row.errors.get(direction)
        found.append((direction, row.matrix[number][number], error, top[0][0] if top else ""))
    return found


def describe_omissions(machine: EncodedMachine | None) -> list[str]:
    """Say what the machine view leaves out so that the page stays small enough to mail."""
    found = []
    if machine is not None and machine.left_out:
        found.append(
            "To keep this page small only the first shapes of each pose move in it; modes/ beside it holds every mode, for"
            " ParaView (.vtu) and for 3D viewers (.glb)."
        )
    if machine is not None and machine.thinned:
        names = ", ".join(
            f"{name} with {format_number(drawn)} of {format_number(whole)} faces"
            for name, (drawn, whole) in machine.thinned.items()
        )
        found.append(f"Thinned out for drawing, not for computing: {names}.")
    for name, (count, why) in {} if machine is None else machine.kept_whole.items():
        found.append(f"{name} is drawn with all of its {format_number(count)} faces: {why}.")
    return found


def _captions(run: Results) -> dict[str, list[Caption]]:
    """Forces first, then modes in which something deforms, last those in which the machine moves as
    a whole.
    """
    static = run.static
    captions: dict[str, list[Caption]] = {name: [] for name in run.view.poses}
    for name, pose in run.view.poses.items():
        for push in pose.pushes:
            point, _, direction = push.rpartition(" ")
            known = static.get(name, {}).get(point)
            shares = {} if known is None else known.budget.get(direction, {})
            text = f"1 kN at {point}, static"
            captions[name].append(
                Caption(f"push:{push}", f"Force in {direction}", text, "force", shares=shares)
            )
    for modes in run.modal:
        found = []
        for index, (hz, name) in enumerate(
            zip(map(float, modes.frequencies_hz), modes.mode_names, strict=True)
        ):
            free = index < modes.rigid_count
            kind: Kind = "whole" if free or WHOLE_MACHINE in name else "mode"
            lead = "0 Hz" if free else f"{format_number(hz)} Hz"
            found.append(
                Caption(
                    f"mode:{index}",
                    lead,
                    name,
                    kind,
                    0.0 if free else hz,
                    modes.energy_share[index],
                )
            )
        captions.setdefault(modes.pose.name, []).extend(
            sorted(found, key=lambda caption: caption.kind == "whole")
        )
    return captions


@functools.cache
def report_environment() -> jinja2.Environment:
    """Return the environment of templates, with filters that write numbers."""
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(read_asset),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        bytecode_cache=TemplateCode(),
    )
    filters: dict[str, Any] = {
        "number": show_number,
        "bound": write_bound,
        "known_part": known_part,
        "bounded": write_bounded,
        "damping": lambda ratio: write_data(ratio, show_damping(ratio)),
        "share": lambda share: write_data(share, percent(share)),
        "stem": file_stem,
        "position": lambda position, unit: write_data(
            position, show_position(position, unit).replace("-", "−")
        ),
        "base64": lambda content: base64.b64encode(content).decode(),
        "worth": lambda share: write_data(share, show_share(share)),
        "plain": lambda value: write_data(value, f"{value:g}".replace("-", "−")),
    }
    environment.filters |= filters
    environment.globals |= {
        "fold_remarks": fold_remarks,
        "draw_rows": draw_rows,
        "directions": DIRECTIONS,
    }
    return environment


@functools.cache
def read_asset(name: str) -> str:
    """Return the text of a file beside this module, or of another room of the app: ``views/NAME``."""
    room = "views" if name.startswith("views/") else "report"
    files = resources.files(f"headstock.app.{room}")
    return files.joinpath(name.removeprefix("views/")).read_text(encoding="utf-8")

"""Sweeps, comparisons, correlations and effects, each as one HTML page that works offline; a click on a
pose of a sweep shows its modes and compliance.
"""

import base64
import functools
from collections.abc import Mapping, Sequence

import numpy as np
from markupsafe import Markup

from headstock.app.drawings.markup import script_json
from headstock.app.report.report import (
    STYLE,
    VIEWER,
    Worth,
    describe_omissions,
    read_asset,
    report_environment,
)
from headstock.app.report.viewer_data import Caption, encode_machine
from headstock.app.tables.comparison import (
    alike_rigid_modes,
    comparison_csv,
    list_points,
    variant_error_words,
)
from headstock.app.tables.correlation import (
    describe_response_errors,
    list_correlation_tables,
    shorten,
)
from headstock.app.tables.model_answers import (
    CANNOT,
    cannot_words,
    cost_rows,
    nearest_mac,
    other_sections,
    response_sections,
    share_rows,
    show_change,
    verdict_words,
)
from headstock.app.tables.sweep_quantities import (
    Quantity,
    limit_words,
    list_swept,
    sampled_error_words,
)
from headstock.app.tables.table import encode_csv
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import SCENE_UNITS
from headstock.pipeline.answers.static import UM_PER_KN
from headstock.pipeline.storage.provenance import ProvenanceSummary
from headstock.studies.comparison_summary import ComparisonSummary
from headstock.studies.correlation.correlation import Correlation
from headstock.studies.sweeps.results import SweepResults

TEMPLATE, SCRIPT = "sweep_template.html", "sweep_maps.js"
DIGITS = 6
COMPARISON_TEMPLATE = "comparison_template.html"
EFFECTS_TEMPLATE = "effects_template.html"
CORRELATION_TEMPLATE = "correlation_template.html"


def render_sweep(
    results: SweepResults, figures: Mapping[str, bytes], origin: ProvenanceSummary | None = None
) -> str:
    """The page as HTML text that refers to nothing outside itself.

    Args:
        figures: Name to PNG, for browsers without scripts and for paper.
        origin: Where it comes from, as ``Provenance.summarise`` gives it.
    """
    shown = [each for each in list_swept(results) if np.isfinite(each.values).any()]
    ranges = [(float(np.nanmin(each.values)), float(np.nanmax(each.values))) for each in shown]
    tracked = results.tracked
    return (
        report_environment()
        .get_template(TEMPLATE)
        .render(
            results=results,
            error_notes=[*sampled_error_words(results), *limit_words(results)],
            errors=_list_errors(results),
            origin=origin,
            quantities=list(zip(shown, ranges, strict=True)),
            crossings={} if tracked is None else tracked.crossings,
            tracking_breaks=0 if tracked is None else tracked.tracking_breaks,
            figures=_encode_images(figures),
            unreachable=results.states.count("unreachable"),
            data=Markup(script_json(_page_data(results, shown))),
            style=Markup(read_asset(STYLE)),
            script=Markup(read_asset(SCRIPT)),
        )
    )


def _list_errors(results: SweepResults) -> dict[str, float]:
    """Name of a quantity to its largest known error."""
    found: dict[str, float] = {}
    for sample in results.pose_errors:
        sizes = {f"mode_{mode}": size for mode, size in sample.modes.items()}
        for name, errors in sample.compliances.items():
            sizes |= {f"compliance_{name}_{direction}": size for direction, size in errors.items()}
        found |= {name: size for name, size in sizes.items() if size is not None}
    return found


def _page_data(results: SweepResults, shown: Sequence[Quantity]) -> dict[str, object]:
    """Return what the script of a page of a sweep reads, numbers to six digits."""
    sweep = results.sweep
    factors = [SCENE_UNITS[unit] for unit in sweep.units]
    return {
        "kind": sweep.kind,
        "axes": sweep.axes,
        "units": [word for _, word in factors],
        "shape": sweep.shape,
        "labels": sweep.labels,
        "positions": _round(sweep.positions * [factor for factor, _ in factors]),
        "states": results.states,
        "errors": {str(number): error for number, error in enumerate(results.errors) if error},
        "modes": results.mode_names,
        "frequencies": _round(results.frequencies_hz),
        "quantities": [
            {"name": q.name, "title": q.title, "unit": q.unit, "values": _round(q.values)}
            for q in shown
        ],
        "points": {
            name: {
                "matrix": _round(UM_PER_KN * point.compliance),
                "direction": _round(point.direction),
                "largest": _round(UM_PER_KN * point.largest),
                "weakest": point.links,
                "share": _round(point.link_shares),
            }
            for name, point in results.points.items()
        },
    }


def _round(values: FloatArray) -> list[object]:
    """Numbers to so many digits, nested as their array; None where there is none."""
    return [
        _round(item) if item.ndim else (float(f"{item:.{DIGITS}g}") if np.isfinite(item) else None)
        for item in values
    ]


def render_comparison(summary: ComparisonSummary, figures: Mapping[str, bytes]) -> str:
    """The page as HTML text that refers to nothing outside itself.

    Args:
        summary: Content of ``compare.json``.
    """
    return (
        report_environment()
        .get_template(COMPARISON_TEMPLATE)
        .render(
            s=summary,
            alike=alike_rigid_modes(summary),
            error_notes=variant_error_words(summary),
            points=list_points(summary),
            figures=_encode_images(figures),
            downloads={
                name: base64.b64encode(table).decode()
                for name, table in comparison_csv(summary).items()
            },
            cannot=CANNOT,
            cannot_notes=cannot_words(summary),
            verdicts=verdict_words(summary),
            sections=(*response_sections(summary), *other_sections(summary)),
            costs=cost_rows(summary),
            shares=functools.partial(share_rows, summary),
            nearest=functools.partial(nearest_mac, summary),
            change=show_change,
            style=Markup(read_asset(STYLE)),
        )
    )


def render_effects(worth: Worth) -> str:
    """The page as HTML text that refers to nothing outside itself."""
    return (
        report_environment()
        .get_template(EFFECTS_TEMPLATE)
        .render(worth=worth.summary, chart=worth.chart, style=Markup(read_asset(STYLE)))
    )


def render_correlation(
    found: Correlation, figures: Mapping[str, bytes], origin: ProvenanceSummary | None = None
) -> str:
    """The page as HTML text that refers to nothing outside itself.

    Args:
        figures: Name to PNG.
        origin: Where it comes from.
    """
    machine = None
    if found.view is not None:
        machine = encode_machine(found.view, {found.pose: _caption_modes(found)})
    tables = list(list_correlation_tables(found))
    return (
        report_environment()
        .get_template(CORRELATION_TEMPLATE)
        .render(
            found=found,
            response_errors=""
            if found.responses is None
            else describe_response_errors(found.responses),
            listings=[shorten(table) for table in tables],
            figures=_encode_images(figures),
            downloads={
                table.name: base64.b64encode(encode_csv(table.tabulate())).decode()
                for table in tables
            },
            machine=None if machine is None else Markup(machine.text),
            omissions=describe_omissions(machine),
            stills={},
            still_remark=None,
            origin=origin,
            style=Markup(read_asset(STYLE)),
            script=Markup(read_asset(VIEWER)),
        )
    )


def _caption_modes(found: Correlation) -> list[Caption]:
    """Say of each row of the table what the viewer shows of it."""
    captions = []
    for index, row in enumerate(found.modes):
        measured = "" if row.measured_hz is None else f"measured {row.measured_hz:.4g} Hz"
        computed = "" if row.computed_hz is None else f"computed {row.computed_hz:.4g} Hz"
        lead = " / ".join(filter(None, (measured, computed)))
        text = ", ".join(filter(None, (f"MAC {row.mac:.2f}", row.name, row.remark)))
        captions.append(Caption(f"mode:{index}", lead, text))
    return captions


def _encode_images(figures: Mapping[str, bytes]) -> dict[str, str]:
    """Return name to the text of a PNG in a page."""
    return {name: base64.b64encode(image).decode() for name, image in figures.items()}

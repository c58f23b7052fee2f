"""Sweeps, comparisons and effects, each as one HTML page that works offline; a click on a pose of a sweep
shows its modes and compliance.
"""

import base64
import functools
from collections.abc import Mapping, Sequence

import numpy as np
from markupsafe import Markup

from headstock.app.drawings.markup import script_json
from headstock.app.report.report import STYLE, Worth, read_asset, report_environment
from headstock.app.tables.comparison import (
    alike_rigid_modes,
    comparison_csv,
    list_points,
    variant_error_words,
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
from headstock.app.tables.sweep_quantities import limit_words, list_swept, sampled_error_words
from headstock.geometry.machine.machine import SCENE_UNITS
from headstock.pipeline.storage.provenance import ProvenanceSummary
from headstock.studies.comparison_summary import ComparisonSummary
from headstock.studies.sweeps.files import Numbers, SweepSummary

TEMPLATE, SCRIPT = "sweep_template.html", "sweep_maps.js"
DIGITS = 6
COMPARISON_TEMPLATE = "comparison_template.html"
EFFECTS_TEMPLATE = "effects_template.html"


def render_sweep(
    summary: SweepSummary, figures: Mapping[str, bytes], origin: ProvenanceSummary | None = None
) -> str:
    """The page as HTML text that refers to nothing outside itself.

    Args:
        summary: As ``summarise_sweep`` gives it.
        figures: Name to PNG, for browsers without scripts and for paper.
        origin: Where it comes from, as ``Provenance.summarise`` gives it.
    """
    quantities = [
        quantity for quantity in list_swept(summary) if np.isfinite(quantity.values).any()
    ]
    ranges = [
        (float(np.nanmin(quantity.values)), float(np.nanmax(quantity.values)))
        for quantity in quantities
    ]
    return (
        report_environment()
        .get_template(TEMPLATE)
        .render(
            s=summary,
            error_notes=[*sampled_error_words(summary), *limit_words(summary)],
            errors=_list_errors(summary),
            origin=origin,
            quantities=list(zip(quantities, ranges, strict=True)),
            figures={name: base64.b64encode(image).decode() for name, image in figures.items()},
            failed=sum(state == "failed" for state in summary["states"]),
            unreachable=sum(state == "unreachable" for state in summary["states"]),
            data=Markup(script_json(_page_data(summary))),
            style=Markup(read_asset(STYLE)),
            script=Markup(read_asset(SCRIPT)),
        )
    )


def _list_errors(summary: SweepSummary) -> dict[str, float]:
    """Name of a quantity to its largest known error."""
    found: dict[str, float] = {}
    for sample in summary["sampled_errors"]:
        sizes = {f"mode_{mode}": size for mode, size in sample["error_hz"].items()}
        for name, errors in sample["error_um_per_kN"].items():
            sizes |= {f"compliance_{name}_{direction}": size for direction, size in errors.items()}
        found |= {name: size for name, size in sizes.items() if size is not None}
    return found


def _page_data(summary: SweepSummary) -> dict[str, object]:
    """Return what the script of a page of a sweep reads, numbers to six digits."""
    factors = [SCENE_UNITS[unit] for unit in summary["units"]]
    scaled = np.array(summary["positions"], dtype=float) * [factor for factor, _ in factors]
    return {
        "kind": summary["kind"],
        "axes": summary["axes"],
        "units": [word for _, word in factors],
        "shape": summary["shape"],
        "labels": summary["labels"],
        "positions": _round(scaled.tolist()),
        "states": summary["states"],
        "errors": summary["errors"],
        "modes": summary["mode_names"],
        "frequencies": _round(summary["frequencies_hz"]),
        "quantities": [
            {
                "name": q.name,
                "title": q.title,
                "unit": q.unit,
                "values": _round([None if np.isnan(v) else float(v) for v in q.values]),
            }
            for q in list_swept(summary)
            if np.isfinite(q.values).any()
        ],
        "points": {
            name: {
                "matrix": _round(point["compliance_um_per_kN"]),
                "direction": _round(point["direction"]),
                "largest": _round(point["largest_um_per_kN"]),
                "weakest": point["weakest"],
                "share": _round(point["weakest_share"]),
            }
            for name, point in summary["static"].items()
        },
    }


def _round(value: Numbers) -> Numbers:
    if isinstance(value, Sequence):
        return [_round(item) for item in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


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
            figures={name: base64.b64encode(image).decode() for name, image in figures.items()},
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

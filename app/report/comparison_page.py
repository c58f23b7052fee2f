"""Variants side by side as one HTML page that works offline."""

import base64
from collections.abc import Mapping

from markupsafe import Markup

from headstock.app.report.report import STYLE, read_asset, report_environment
from headstock.app.terminal.comparison import alike_rigid_modes, comparison_csv, describe_store, states_errors, variant_error_words
from headstock.pipeline.storage.json_texts import Json

TEMPLATE = "comparison_template.html"


def render_comparison(summary: Json, figures: Mapping[str, bytes]) -> str:
    """The page as HTML text that refers to nothing outside itself.

    Args:
        summary: Content of ``compare.json``.
        figures: Name to PNG.
    """
    return (
        report_environment()
        .get_template(TEMPLATE)
        .render(
            s=summary,
            states_errors=states_errors,
            alike=alike_rigid_modes(summary),
            error_notes=variant_error_words(summary),
            points=list(dict.fromkeys(point for variant in summary["variants"].values() for point in variant["static"])),
            figures={name: base64.b64encode(image).decode() for name, image in figures.items()},
            downloads={name: base64.b64encode(table).decode() for name, table in comparison_csv(summary).items()},
            stores={name: describe_store(variant["effort"]) for name, variant in summary["variants"].items()},
            style=Markup(read_asset(STYLE)),
        )
    )

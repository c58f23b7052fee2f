"""Which analyses are shown, in the order of the report: names of the summary, and of modules here; and what every
run shows: its components and stages.
"""

import importlib

from headstock.app.tables.table import (
    Column,
    PlainTable,
    tabulate,
)
from headstock.app.views.view import View
from headstock.pipeline.answers.answer import Entry
from headstock.pipeline.results.results import ComponentFacts, Results
from headstock.pipeline.results.summary import summarise_stage
from headstock.pipeline.storage.json_texts import find_known

NAMES = (
    "static",
    "modal",
    "contouring",
    "map",
    "volumetric",
    "path",
    "transient",
    "control",
    "lobes",
    "frf",
    "probes",
    "model_errors",
    "interface_errors",
    "accuracy",
)


# views that stand in a module with others
SHARED_MODULES = {
    "map": ("volumetric", "MAP_VIEW"),
    "probes": ("static", "PROBES_VIEW"),
    "model_errors": ("accuracy", "MODEL_ERRORS_VIEW"),
    "interface_errors": ("accuracy", "INTERFACE_ERRORS_VIEW"),
}


def load_view(name: str) -> View:
    """Return the view of an analysis."""
    module, variable = SHARED_MODULES.get(name, (name, "VIEW"))
    view: View = getattr(importlib.import_module(f"headstock.app.views.{module}"), variable)
    return view


def find_views(run: Results) -> list[View]:
    """Return the views of the analyses that a run has."""
    found = {answer.entry for answer in run.answers}
    return [load_view(name) for name in NAMES if name in found]


def list_tables(run: Results, *, long: bool = True) -> list[PlainTable]:
    """Return every table of a run.

    Args:
        long: Those with a row per sample, too.
    """
    views = find_views(run)
    tables = [
        tabulate("components", COMPONENT_COLUMNS, run.components.items()),
        tabulate("stages", STAGE_COLUMNS, map(summarise_stage, run.stages)),
        *(table for view in views for table in view.tables(run)),
    ]
    return tables + [table for view in views for table in view.long_tables(run) if long]


STAGE_COLUMNS: tuple[Column[Entry], ...] = (
    Column(lambda row: row["stage"], "stage"),
    Column(lambda row: row["component"], "component"),
    Column(lambda row: row["pose"], "pose"),
    Column(lambda row: row["seconds"], "seconds"),
    Column(lambda row: row["peak_rss_mb"], "peak memory [MB]"),
    Column(lambda row: row["cached"], "from the store"),
    Column(lambda row: row["reason"], "reason"),
)
COMPONENT_COLUMNS: tuple[Column[tuple[str, ComponentFacts]], ...] = (
    Column(lambda row: row[0], "component", "component", "Component"),
    Column(lambda row: row[1].fidelity, "fidelity", "fidelity", "Fidelity"),
    Column(lambda row: row[1].full_dofs, "dofs", ">dofs", "Dofs"),
    Column(lambda row: row[1].reduced_dofs, "reduced dofs", ">reduced", "reduced to"),
    Column(lambda row: row[1].mass_kg, "mass [kg]", ">kg", "Mass [kg]"),
    Column(
        lambda row: find_known(row[1].cutoff_hz),
        file="modes complete to [Hz]",
        screen=">modes to Hz",
        report="Modes complete to [Hz]",
        show=lambda hz: f"{hz:.0f}" if hz else "-",
    ),
    Column(lambda row: row[1].residual, "residual", report="Residual", digits=3),
    Column(
        lambda row: None if row[1].quality is None else row[1].quality.minimum_scaled_jacobian,
        file="worst scaled Jacobian",
        report="Worst element (1 is ideal)",
        digits=2,
    ),
    Column(
        lambda row: None if row[1].quality is None else row[1].quality.repaired,
        report="Repaired elements",
    ),
)

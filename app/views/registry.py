"""Which analyses are shown, in the order of the report: names of the summary, and of modules here; and what every
run shows: its components and stages.
"""

import importlib

from headstock.app.tables.table import Column, PlainTable, tabulate
from headstock.app.views.view import FinishedRun, View
from headstock.pipeline.results.summary import ComponentSummary, RunSummary

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


def find_views(run: FinishedRun) -> list[View]:
    """Return the views of the analyses that a run has."""
    return [load_view(name) for name in NAMES if run.find_entry(name)]


def list_tables(run: FinishedRun, *, long: bool = True) -> list[PlainTable]:
    """Return every table of a run.

    Args:
        long: Those with a row per sample, too.
    """
    views = find_views(run)
    tables = [
        tabulate("components", COMPONENT_COLUMNS, run.summary["components"].items()),
        _tabulate_stages(run.summary),
        *(table for view in views for table in view.tables(run)),
    ]
    return tables + [table for view in views for table in view.long_tables(run) if long]


def _tabulate_stages(summary: RunSummary) -> PlainTable:
    headings = (
        "stage",
        "component",
        "pose",
        "seconds",
        "peak memory [MB]",
        "from the store",
        "reason",
    )
    rows = tuple(
        (
            row["stage"],
            row["component"],
            row["pose"],
            row["seconds"],
            row["peak_rss_mb"],
            row["cached"],
            row["reason"],
        )
        for row in summary["stages"]
    )
    return PlainTable("stages", headings, rows)


COMPONENT_COLUMNS: tuple[Column[tuple[str, ComponentSummary]], ...] = (
    Column(lambda row: row[0], "component", "component", "Component"),
    Column(lambda row: row[1]["fidelity"], "fidelity", "fidelity", "Fidelity"),
    Column(lambda row: row[1]["full_dofs"], "dofs", ">dofs", "Dofs"),
    Column(lambda row: row[1]["reduced_dofs"], "reduced dofs", ">reduced", "reduced to"),
    Column(lambda row: row[1]["mass_kg"], "mass [kg]", ">kg", "Mass [kg]"),
    Column(
        lambda row: row[1]["cutoff_hz"],
        file="modes complete to [Hz]",
        screen=">modes to Hz",
        report="Modes complete to [Hz]",
        show=lambda hz: f"{hz:.0f}" if hz else "-",
    ),
    Column(lambda row: row[1]["residual"], "residual", report="Residual", digits=3),
    Column(
        lambda row: (
            row[1]["mesh_quality"]["minimum_scaled_jacobian"] if "mesh_quality" in row[1] else None
        ),
        file="worst scaled Jacobian",
        report="Worst element (1 is ideal)",
        digits=2,
    ),
    Column(
        lambda row: row[1]["mesh_quality"]["repaired"] if "mesh_quality" in row[1] else None,
        report="Repaired elements",
    ),
)

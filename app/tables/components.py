"""Rows of components."""

from headstock.app.tables.table import Column
from headstock.pipeline.results.summary import ComponentSummary

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

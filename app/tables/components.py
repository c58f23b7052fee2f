"""Rows of components, joints and models of bodies."""

from headstock.app.tables.table import Column, show_percent
from headstock.pipeline.answers.accuracy import BodyModelSummary
from headstock.pipeline.answers.interfaces import JointShapesSummary
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

JOINT_COLUMNS: tuple[Column[tuple[str, JointShapesSummary]], ...] = (
    Column(lambda row: row[0], "joint", "joint", "Joint"),
    Column(lambda row: row[1]["between"], "between", "between", "Between"),
    Column(lambda row: row[1]["shapes"], "shapes", ">shapes", "Shapes"),
    Column(lambda row: row[1]["compared_with"], "compared with", ">compared with", "Compared with"),
    Column(
        lambda row: row[1]["largest"],
        "largest change",
        ">may be off",
        "May be off",
        show=show_percent,
    ),
    Column(lambda row: row[1]["number"], "of", "<of", "of"),
)

MODEL_COLUMNS: tuple[Column[tuple[str, BodyModelSummary]], ...] = (
    Column(lambda row: row[0], "component", "body", "Body"),
    Column(lambda row: row[1]["fidelity"], "model", "model", "Model"),
    Column(lambda row: row[1]["compared_with"], "compared with", "compared with", "Compared with"),
    Column(
        lambda row: row[1]["largest"],
        "largest change",
        ">changes",
        "Largest change",
        show=show_percent,
    ),
    Column(lambda row: row[1]["number"], "of", "<of", "of"),
)

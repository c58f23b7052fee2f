"""The stability lobes of a scene, built from their table, and what may be wrong with it."""

from pathlib import Path

import numpy as np

from headstock.scene.building.draft import Draft, check_name, check_pose_names
from headstock.scene.reading.files import resolve_file
from headstock.scene.reading.findings import Findings
from headstock.scene.reading.positions import KeyPath
from headstock.scene.requests import LobesRequest
from headstock.scene.schema.mechanism import ToolModeTable
from headstock.scene.schema.scene import SceneTable
from headstock.solvers.milling.forces import CUTTING_MATERIALS, EndMill
from headstock.solvers.milling.tool_dynamics import ToolMode, across_axis

KEY: KeyPath = ("analyses", "lobes")
SUFFIXES = (".csv",)
PARALLEL = 1e-6  # what is left of a direction across the tool


def build_lobes(scene: SceneTable, poses: tuple[str, ...], folder: Path) -> LobesRequest | None:
    """The lobes a scene asks for; in ``poses`` unless it names some.

    Args:
        scene: With its tables.
        poses: Of the scene.
        folder: Of the scene, for a file of receptances.

    Raises:
        ValueError: The file of receptances is missing or out of bounds.
    """
    table = scene.analyses.lobes
    if table is None:
        return None
    mill = table.mill
    return LobesRequest(
        mill=EndMill(mill.diameter, mill.teeth, mill.helix, mill.runout),
        coefficients=CUTTING_MATERIALS[table.material],
        material=table.material,
        radial_depth=table.radial_depth,
        speeds=np.linspace(
            table.speeds.low, table.speeds.high, table.speeds.count, dtype=np.float64
        ),
        directions=tuple(table.directions),
        at=table.at or next(iter(scene.points)),
        up=table.up,
        up_to_hz=table.up_to,
        deepest=table.deepest,
        tool_modes=tuple(build_tool_mode(mode, table.up) for mode in table.tool_modes),
        tool_receptance=None
        if table.tool_receptance is None
        else resolve_file(folder, table.tool_receptance, SUFFIXES),
        checked=table.checked,
        low_immersion=table.low_immersion,
        poses=tuple(table.poses or poses),
    )


def build_tool_mode(table: ToolModeTable, up: tuple[float, float, float]) -> ToolMode:
    """A mode in its direction, or in both across the tool.

    Args:
        table: Of the mode.
        up: Direction along the tool.
    """
    if table.direction is None:
        directions = across_axis(np.array(up))
    else:
        along = np.array(table.direction)
        directions = (along / np.linalg.norm(along))[:, None]
    return ToolMode(table.name, table.frequency, table.damping, table.stiffness, directions)


def check_lobes(draft: Draft, findings: Findings) -> None:
    """Report names and files that there are not, directions along the tool, and a machine without
    damping.
    """
    scene, table = draft.table, draft.table.analyses.lobes
    if table is None:
        return
    check_pose_names((*KEY, "poses"), table.poses, draft, findings)
    if table.at is not None:
        check_name((*KEY, "at"), table.at, "points", draft, findings)
    elif not draft.sections.get("points"):
        findings.add(KEY, 'there is no point where the tool cuts; write [points], or at = "tcp"')
    up = np.array(table.up) / np.linalg.norm(table.up)
    for index, direction in enumerate(table.directions):
        if np.linalg.norm(np.cross(up, direction)) < PARALLEL:
            findings.add(
                (*KEY, "directions", index),
                "points along the tool; the tool travels across its axis: write another direction, or another up",
            )
    if table.tool_receptance is not None:
        try:
            resolve_file(draft.folder, table.tool_receptance, SUFFIXES)
        except ValueError as error:
            findings.add((*KEY, "tool_receptance"), str(error))
    if scene.effects.get("damping", False) is False:
        findings.add(
            KEY,
            "without damping every cut chatters; write [effects] damping = true and give joints or materials damping,"
            " or damping = { modal = 0.02 }",
        )

"""The stability lobes of a scene, built from their table, and what may be wrong with it."""

from pathlib import Path

import numpy as np

from headstock.meshing.process.strangers import RECEPTANCES
from headstock.scene.building.cutting import (
    build_mill,
    find_lead_fault,
    part_side,
    resolve_material,
)
from headstock.scene.building.draft import Draft, check_name, check_pose_names
from headstock.scene.building.path import build_path
from headstock.scene.reading.files import resolve_file
from headstock.scene.reading.findings import Findings, SceneError
from headstock.scene.reading.positions import KeyPath
from headstock.scene.requests import FEED, LobesRequest, Travel
from headstock.scene.scene import Scene
from headstock.scene.schema.mechanism import LobesTable, ToolModeTable
from headstock.scene.schema.scene import SceneTable
from headstock.scene.studies import Sweep
from headstock.solvers.milling.coefficients import CuttingCoefficients
from headstock.solvers.milling.forces import EndMill, MillingCut
from headstock.solvers.milling.tool_dynamics import ToolMode, across_axis
from headstock.solvers.milling.windows import MOST_ROWS, expected_rows

KEY: KeyPath = ("analyses", "lobes")
SUFFIXES = (".csv",)
FIXED = 'write directions that are the same in every pose, such as "x"'


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
    path = scene.analyses.path
    return LobesRequest(
        mill=build_mill(table.mill),
        coefficients=resolve_material(scene, table.material, table),
        material=table.material,
        radial_depth=table.radial_depth,
        speeds=np.linspace(
            table.speeds.low, table.speeds.high, table.speeds.number, dtype=np.float64
        ),
        directions=tuple(map(_build_travel, table.directions)),
        at=table.at or next(iter(scene.points)),
        up=table.up,
        up_to_hz=table.up_to,
        deepest=table.deepest,
        tool_modes=tuple(build_tool_mode(mode, table.up) for mode in table.tool_modes),
        tool_receptance=None
        if table.tool_receptance is None
        else resolve_file(folder, table.tool_receptance, SUFFIXES, RECEPTANCES),
        checked=table.checked,
        poses=tuple(table.poses or poses),
        path=None if path is None else build_path(scene, path),
        sense=table.sense,
        part=part_side(table),
    )


def _build_travel(direction: str | tuple[float, float, float]) -> Travel:
    if isinstance(direction, str):
        return Travel(direction)
    for letter, value in zip("xyz", direction, strict=True):
        if abs(value) > 1.0 - 1e-9:
            return Travel(f"{'-' if value < 0.0 else ''}{letter}", direction)
    return Travel(" ".join(f"{value:.4g}" for value in direction), direction)


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
    _check_speeds(table, findings)
    up = np.array(table.up) / np.linalg.norm(table.up)
    has_path = scene.analyses.path is not None or any(
        sweep.path is not None for sweep in scene.sweeps.values()
    )
    for index, direction in enumerate(table.directions):
        if isinstance(direction, str):
            if not has_path:
                findings.add_for(
                    "lobes",
                    (*KEY, "directions", index),
                    f"is the direction along a path, and the scene has none; write a sweep with a path, [analyses.path], or {FIXED}",
                )
        elif fault := find_lead_fault(up, np.array(direction)):
            findings.add(
                (*KEY, "directions", index),
                f"points along the tool, {fault}; write another direction, or another up",
            )
    if table.tool_receptance is not None:
        try:
            resolve_file(draft.folder, table.tool_receptance, SUFFIXES, RECEPTANCES)
        except ValueError as error:
            findings.add((*KEY, "tool_receptance"), str(error))
    if scene.effects.get("damping", False) is False:
        findings.add(
            KEY,
            "without damping every cut chatters; write [effects] damping = true and give joints or materials damping,"
            " or damping = { modal = 0.02 }",
        )


def _check_speeds(table: LobesTable, findings: Findings) -> None:
    """Report speeds so low that stability cannot be computed: too many waves between two teeth."""
    hz = table.up_to
    mill, slowest = EndMill(table.mill.diameter, table.mill.teeth), table.speeds.low
    none = CuttingCoefficients((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), "")
    rows = expected_rows(MillingCut(mill, none, slowest, 0.0, table.radial_depth), hz)
    if rows > MOST_ROWS and table.tool_receptance is None:
        rpm, waves = 30.0 / np.pi * slowest, 2.0 * np.pi * hz / (mill.teeth * slowest)
        findings.add(
            (*KEY, "speeds"),
            f"at {rpm:.3g} rpm {waves:.0f} waves of {hz:g} Hz lie between two teeth, too many for multipliers; begin at"
            f" {float(f'{1.05 * rpm * rows / MOST_ROWS:.2g}'):g} rpm"
            " or above",
        )


def require_feed_of_run(scene: Scene) -> None:
    """Refuse lobes along the feed in poses that are on no path.

    Raises:
        SceneError: The scene has no path analysis.
    """
    lobes = scene.analyses.get(LobesRequest)
    if lobes is not None and lobes.asks_for_feed and lobes.path is None:
        raise _refuse_feed(
            scene,
            lobes,
            f"a pose alone has no feed; sweep a path (./headstock sweep), write [analyses.path], or {FIXED}",
        )


def require_feed_of_sweep(scene: Scene, sweep: Sweep) -> None:
    """Refuse lobes along the feed in poses that do not follow each other.

    Raises:
        SceneError: The sweep is no path.
    """
    lobes = scene.analyses.get(LobesRequest)
    if lobes is not None and lobes.asks_for_feed and sweep.kind != "path":
        raise _refuse_feed(
            scene,
            lobes,
            f"sweep {sweep.name} is a {sweep.kind} of poses, which has no feed; write it as a path, or {FIXED}",
        )


def refuse_still_feed(scene: Scene, lobes: LobesRequest) -> SceneError:
    """The refusal of a path along which the tool stands still in its work."""
    return _refuse_feed(
        scene,
        lobes,
        f"along the path the tool at {lobes.at} does not move against its work; write another path, or {FIXED}",
    )


def _refuse_feed(scene: Scene, lobes: LobesRequest, message: str) -> SceneError:
    index = [travel.name for travel in lobes.directions].index(FEED)
    return SceneError([scene.findings.describe((*KEY, "directions", index), message)])

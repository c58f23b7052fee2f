"""From a scene's mechanism table to the mounted mechanism, and what is asked of it."""

from pathlib import Path

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.exechon import MountedExechon
from headstock.geometry.mechanisms.exechon_2 import ExechonDimensions
from headstock.scene.building.components import build_frame
from headstock.scene.reading.files import resolve_file
from headstock.scene.requests import ContouringRequest, MapRequest
from headstock.scene.scene import LegSprings, SceneMechanism
from headstock.scene.schema.mechanism import ExechonTable, MechanismTable
from headstock.scene.schema.scene import SceneTable
from headstock.solvers.milling.cutting_materials import CUTTING_MATERIALS
from headstock.solvers.milling.forces import EndMill, MillingCut
from headstock.solvers.milling.tool_path import SquareContour

FORCE_SUFFIXES = (".csv",)


def build_mechanism(table: MechanismTable) -> SceneMechanism:
    """The mechanism of a scene that has passed every check."""
    limits = {name: (low.value, high.value) for name, (low, high) in table.limits.items()}
    mounted = MountedExechon(build_dimensions(table.dimensions), build_frame(table.at, table.rotate), limits)
    springs = None if table.springs is None else LegSprings(**table.springs.model_dump())
    return SceneMechanism(
        kind=table.kind,
        model=table.model,
        mounted=mounted,
        tool=np.array(table.tool),
        carries={component: mark for mark, names in table.carries.items() for component in names},
        springs=springs,
        screw_lead=table.screw_lead,
    )


def build_dimensions(table: ExechonTable) -> ExechonDimensions:
    """Dimensions of an Exechon."""
    return ExechonDimensions(
        base=(table.base[0], table.base[1], table.base[2]),
        platform=(table.platform[0], table.platform[1], table.platform[2]),
        universal_offsets=(table.universal_offsets[0], table.universal_offsets[1]),
        platform_heights=(table.platform_heights[0], table.platform_heights[1]),
        wrist=(table.wrist[0], table.wrist[1]),
        tool_length=table.tool_length,
    )


def build_map(scene: SceneTable) -> MapRequest | None:
    """The map a scene asks for: the axes of its sweep with several positions, the others where they stand."""
    request = scene.analyses.map
    if request is None:
        return None
    spans: dict[str, FloatArray] = {
        name: np.asarray(np.linspace(span.low.value, span.high.value, span.positions), dtype=float)
        for name, span in (scene.sweeps[request.sweep].axes or {}).items()
    }
    axes = tuple((name, values) for name, values in spans.items() if len(values) > 1)
    fixed = {name: float(values[0]) for name, values in spans.items() if len(values) == 1}
    return MapRequest(axes, fixed, request.count)


def build_contouring(scene: SceneTable, folder: Path, damping_ratios: tuple[float, ...]) -> ContouringRequest | None:
    """The contour a scene asks for.

    Raises:
        ValueError: The file of measured forces is missing or out of bounds.
    """
    table = scene.analyses.contouring
    if table is None:
        return None
    mill = EndMill(table.mill.diameter, table.mill.teeth, table.mill.helix, table.mill.runout)
    # with measured forces, or none, the coefficients play no part
    name: str = table.material or "al7075-t6"
    coefficients = CUTTING_MATERIALS[name]
    return ContouringRequest(
        contour=SquareContour(
            side=table.side,
            center=(table.at[0], table.at[1]),
            height=table.at[2],
            offset=0.5 * table.mill.diameter,
            lead=table.lead,
            feed=table.feed,
            window=table.averaging,
        ),
        cut=MillingCut(mill, coefficients, table.spindle, table.axial_depth, table.radial_depth),
        model=table.model,
        steps_per_turn=table.steps_per_turn,
        damping_ratios=damping_ratios,
        material=table.material,
        forces=None if table.forces is None else resolve_file(folder, table.forces, FORCE_SUFFIXES),
        cutting=bool(scene.effects.get("cutting_force", False)),
        regeneration=bool(scene.effects.get("regeneration", False)),
    )

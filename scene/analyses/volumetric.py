"""Position error of the tool over a grid of poses."""

from dataclasses import dataclass
from typing import ClassVar

from headstock.geometry.frames import FloatArray
from headstock.scene.building.draft import Draft, SceneAnalysis
from headstock.scene.building.studies import build_grid, check_grid
from headstock.scene.reading.findings import KeyPath
from headstock.scene.scene import Request, describe_grid
from headstock.scene.schema.effects import GUIDE_ERRORS
from headstock.scene.schema.types import Names, RequestTable, Text

KEY: KeyPath = ("analyses", "volumetric")
MAX_POSES = 20_000


@dataclass(frozen=True, eq=False)
class VolumetricRequest(Request):
    """Position error of the tool at named points over a grid of poses.

    Attributes:
        axes: Name and positions ``(n,)`` of each axis of the grid [m, rad].
        fixed: Positions of the other axes.
    """

    analysis: ClassVar[str] = "volumetric"

    at: tuple[str, ...]
    axes: tuple[tuple[str, FloatArray], ...]
    fixed: dict[str, float]

    def describe(self) -> str:
        """In a few words: what is computed, and how far."""
        return f"position error of {', '.join(self.at)} in {describe_grid(self.axes)}"


class _VolumetricTable(RequestTable):
    """Position error of the tool over the poses of a sweep along two or three axes: three components
    and three angles, by source.
    """

    at: Names | None = None
    """points at which it is computed; default: all of them"""
    sweep: Text
    """a sweep of `axes` in which two or three have several positions, at most 20 000 poses"""


def _build(table: _VolumetricTable, draft: Draft) -> VolumetricRequest:
    """Build the request: the axes of its sweep with several positions, the others fixed."""
    axes, fixed = build_grid(draft.table.sweeps[table.sweep])
    return VolumetricRequest(tuple(table.at or draft.table.points), axes, fixed)


def _check(table: _VolumetricTable, draft: Draft) -> None:
    """Report unknown points and sweeps, sweeps of another form, and a machine that nothing moves."""
    scene = draft.table
    for index, point in enumerate(table.at or ()):
        draft.check_name((*KEY, "at", index), point, "points")
    if table.at is None and not scene.points:
        draft.add(
            KEY,
            'there is no point whose error is wanted; write [points] tcp = { tool = "component.interface", work = "ground" }',
        )
    if not scene.active & {GUIDE_ERRORS, "gravity"} and not scene.loads:
        draft.add(
            KEY,
            "nothing moves the tool: there are no errors of guides, no gravity and no loads; write [effects] gravity = true or guide_errors = true",
        )
    check_grid((*KEY, "sweep"), table.sweep, "a volumetric map", MAX_POSES, draft)


ANALYSIS = SceneAnalysis(
    _VolumetricTable,
    VolumetricRequest,
    "position error of the tool over a volume, see [geometric errors](geometric_errors.md)",
    build=_build,
    check=_check,
)

"""Modes, stiffness and condition number of a lumped mechanism over its workspace."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from headstock.geometry.frames import FloatArray
from headstock.scene.building.draft import Draft, SceneAnalysis
from headstock.scene.building.studies import build_grid, check_grid
from headstock.scene.reading.findings import KeyPath
from headstock.scene.scene import Request, describe_grid
from headstock.scene.schema import types

KEY: KeyPath = ("analyses", "map")
MAX_POSES = 40_000


@dataclass(frozen=True, eq=False)
class MapRequest(Request):
    """A map over two or three axes.

    Attributes:
        axes: Name and positions ``(n,)`` of each [m, rad].
        fixed: Positions of the other axes.
        count: How many frequencies.
    """

    analysis: ClassVar[str] = "map"

    axes: tuple[tuple[str, FloatArray], ...]
    fixed: dict[str, float]
    count: int = 3

    def describe(self) -> str:
        """In a few words: what is computed, and how far."""
        return f"modes, stiffness and condition number in {describe_grid(self.axes)}"


class _MapTable(types.RequestTable):
    """Modes, static stiffness and condition number of a lumped mechanism over the poses of a sweep
    along two or three axes.
    """

    sweep: types.Text
    """a sweep of `axes` in which two or three have several positions, at most 40 000 poses"""
    count: Annotated[types.WholeNumber, types.Between(1, 6)] = 3
    """number of natural frequencies; each mode is tracked by its shape"""


def _build(table: _MapTable, draft: Draft) -> MapRequest:
    """Build the request: the axes of its sweep with several positions, the others fixed."""
    axes, fixed = build_grid(draft.table.sweeps[table.sweep])
    return MapRequest(axes, fixed, table.count)


def _check(table: _MapTable, draft: Draft) -> None:
    """Report a machine without a lumped mechanism, and a sweep that spans no map."""
    if not draft.table.is_lumped:
        draft.add(KEY, "a map needs a lumped mechanism; this scene has none")
    check_grid((*KEY, "sweep"), table.sweep, "a map", MAX_POSES, draft)


ANALYSIS = SceneAnalysis(
    _MapTable, MapRequest, "a lumped mechanism over its workspace", build=_build, check=_check
)

"""Compliance at points, and static response to loads."""

from dataclasses import dataclass
from typing import ClassVar

from headstock.scene.building.draft import Draft, SceneAnalysis
from headstock.scene.scene import Request
from headstock.scene.schema.types import Names, RequestTable


@dataclass(frozen=True)
class StaticRequest(Request):
    """Compliance at named points and sensors, in named poses (all of them when empty)."""

    analysis: ClassVar[str] = "static"

    at: tuple[str, ...]
    poses: tuple[str, ...] = ()

    @property
    def loaded_places(self) -> tuple[str, ...]:
        """Return where unit loads act."""
        return self.at


class StaticTable(RequestTable):
    """Compliance at points; without `at` at every point."""

    loads_probes = "by the scene"

    at: Names | None = None
    """points, and sensors that measure x, y and z, at which it is computed; default: all points"""
    poses: Names | None = None
    """poses in which it is computed; default: all of them"""


def _build(table: StaticTable, draft: Draft) -> StaticRequest:
    """Build the request: all points and poses unless the table names some."""
    return StaticRequest(tuple(table.at or draft.table.points), tuple(table.poses or draft.poses))


def _check(table: StaticTable, draft: Draft) -> None:
    """Report points and poses that do not exist."""
    for index, point in enumerate(table.at or ()):
        draft.check_point(("analyses", "static", "at", index), point)


def _check_subject(table: StaticTable, draft: Draft) -> None:
    """Report that there is nothing to compute a compliance of."""
    scene = draft.table
    if table.at is None and not scene.points and not scene.loads:
        example = 'tcp = { tool = "component.interface", work = "ground" }'
        draft.add(
            ("analyses", "static"),
            f"there is no point to compute a compliance at; write [points] {example}",
        )


ANALYSIS = SceneAnalysis(
    StaticTable,
    StaticRequest,
    "compliance at points, and static response to loads",
    build=_build,
    check=_check,
    check_complete=_check_subject,
)

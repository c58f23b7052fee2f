"""Closed loops of the drives: poles, margins, bandwidth and tracking error."""

from dataclasses import dataclass
from typing import ClassVar

from headstock.scene.building.draft import Draft, SceneAnalysis
from headstock.scene.building.drives import DRIVE_CONTROL, check_sampling
from headstock.scene.reading.findings import KeyPath
from headstock.scene.scene import Request
from headstock.scene.schema import types

KEY: KeyPath = ("analyses", "control")


@dataclass(frozen=True)
class ControlRequest(Request):
    """Closed loops of the drives: poles up to a frequency [Hz], lag at a speed [m/s], in named
    poses; frequencies to guard also over the poses of a sweep, None for these poses.
    """

    analysis: ClassVar[str] = "control"

    up_to_hz: float
    speed: float
    poses: tuple[str, ...] = ()
    sweep: str | None = None

    def describe(self, drives: tuple[str, ...]) -> str:
        """In a few words, with the drives whose loops are closed."""
        return f"effect drive_control: loops of {', '.join(drives)} closed, poles up to {self.up_to_hz:g} Hz"


class _ControlTable(types.RequestTable):
    """Closed-loop poles, margins, bandwidth and tracking error of the drives."""

    highest: ClassVar[str] = "up_to"

    up_to: types.PositiveFrequency = 500.0
    """highest frequency of the poles listed"""
    speed: types.PositiveSpeed = 0.05
    """axis speed at which the lag is reported"""
    poses: types.Names | None = None
    """poses in which it is computed; default: all of them"""
    sweep: types.Text | None = None
    """sweep over whose poses frequencies to guard are followed; default: the `poses`"""


def _build(table: _ControlTable, draft: Draft) -> ControlRequest:
    """Build the request: in all poses unless the table names some."""
    return ControlRequest(table.up_to, table.speed, tuple(table.poses or draft.poses), table.sweep)


def _check(table: _ControlTable, draft: Draft) -> None:
    """Report a sweep that there is not."""
    if table.sweep is not None:
        draft.check_name((*KEY, "sweep"), table.sweep, "sweeps")


def _check_drives(table: _ControlTable, draft: Draft) -> None:
    """Report drives that are not controlled, or sample too slowly."""
    if DRIVE_CONTROL not in draft.table.active:
        draft.findings.add_for(
            "control", KEY, "drives are not controlled; write [effects] drive_control = true"
        )
    check_sampling(draft, table.up_to, "control", "up_to")


ANALYSIS = SceneAnalysis(
    _ControlTable,
    ControlRequest,
    "closed-loop poles and margins, see [drives](drives.md)",
    build=_build,
    check=_check,
    check_complete=_check_drives,
)

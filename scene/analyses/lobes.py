"""Stability lobes: the limit depth of cut over the speed of the spindle."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import MachinePath
from headstock.meshing.process.strangers import TEST_DATA
from headstock.scene.analyses.path import PathTable, build_path
from headstock.scene.building.cutting import (
    build_mill,
    build_tool_mode,
    check_cutter,
    find_lead_fault,
    part_side,
    resolve_material,
)
from headstock.scene.building.draft import Draft, SceneAnalysis
from headstock.scene.reading.files import TEST_DATA_SUFFIXES, resolve_file
from headstock.scene.reading.findings import Findings, KeyPath, SceneError
from headstock.scene.reading.units import ANGULAR_SPEED
from headstock.scene.scene import Request, Scene
from headstock.scene.schema import types
from headstock.scene.schema.cutting import MillTable, ToolModeTable
from headstock.scene.studies import Sweep
from headstock.solvers.milling.coefficients import CuttingCoefficients
from headstock.solvers.milling.forces import EndMill, MillingCut, Sense, Side
from headstock.solvers.milling.tool_dynamics import ToolMode
from headstock.solvers.milling.windows import MOST_ROWS, expected_rows

KEY: KeyPath = ("analyses", "lobes")
FIXED = 'write directions that are the same in every pose, such as "x"'
PARALLEL = 1e-6  # what is left of a direction across the tool
FEED = "feed"  # name of the direction of travel that a path has in each pose
MOST_SPEEDS = 5000


@dataclass(frozen=True)
class Travel:
    """A direction in which a tool travels, the part on one side of it.

    Attributes:
        name: ``x``, ``-y``, three numbers, or ``feed``.
        along: Machine frame; None for the feed, which differs from pose to pose.
    """

    name: str
    along: tuple[float, float, float] | None = None


@dataclass(frozen=True, eq=False)
class LobesRequest(Request):
    """Stability lobes, in named poses.

    Attributes:
        radial_depth: [m].
        speeds: ``(n,)`` rising speeds of the spindle [rad/s].
        at: Point where the tool is.
        up: Direction from the tool's tip to its holder, machine frame.
        up_to_hz: Modes of the machine count up to here [Hz].
        deepest: Depth of cut up to which a limit is looked for [m].
        tool_modes: Of spindle and tool, from the machine to the tip.
        tool_receptance: File of measured receptances in their place.
        checked: Share of the speeds at which the limit is looked for.
        poses: All of them when empty.
        path: Whose feed counts in a run; None without a path analysis.
        sense: Down or up milling.
        part: On which side of the travel the part lies, seen from above.
    """

    analysis: ClassVar[str] = "lobes"

    mill: EndMill
    coefficients: CuttingCoefficients
    material: str
    radial_depth: float
    speeds: FloatArray
    directions: tuple[Travel, ...]
    at: str
    up: tuple[float, float, float]
    up_to_hz: float
    deepest: float
    tool_modes: tuple[ToolMode, ...] = ()
    tool_receptance: Path | None = None
    checked: float = 1.0
    poses: tuple[str, ...] = ()
    path: MachinePath | None = None
    sense: Sense = "down"
    part: Side = "right"

    @property
    def loaded_places(self) -> tuple[str, ...]:
        """Return where the cut acts."""
        return (self.at,)

    @property
    def asks_for_feed(self) -> bool:
        """Return whether one of the directions is that of the feed."""
        return any(travel.along is None for travel in self.directions)

    def travels(self, feed: FloatArray) -> tuple[Travel, ...]:
        """Directions of travel in a pose; without the feed where it is not across the tool.

        Args:
            feed: ``(3,)`` machine frame; NaN where there is none.
        """
        x, y, z = map(float, feed)
        across = np.linalg.norm(np.cross(self.up, feed)) > PARALLEL * np.linalg.norm(self.up)
        return tuple(
            travel if travel.along else Travel(travel.name, (x, y, z))
            for travel in self.directions
            if travel.along or across
        )

    @property
    def immersion(self) -> float:
        """Radial depth over diameter."""
        return self.radial_depth / self.mill.diameter

    def cut_at(self, speed: float, coefficients: CuttingCoefficients | None = None) -> MillingCut:
        """The deepest cut at a speed of the spindle.

        Args:
            speed: [rad/s].
            coefficients: Others than those of the material.
        """
        return MillingCut(
            self.mill,
            coefficients or self.coefficients,
            speed,
            self.deepest,
            self.radial_depth,
            sense=self.sense,
        )

    def rows_at(self, speed: float, *, faster: float = 1.0) -> float:
        """Rows of the matrix whose multipliers say whether a cut at a speed [rad/s] is stable, besides
        those of the machine's poles.

        Args:
            faster: Highest frequency of the poles over that which is asked for.
        """
        return expected_rows(self.cut_at(speed), faster * self.highest_hz)

    @property
    def highest_hz(self) -> float:
        """Highest natural frequency of machine, spindle and tool that is asked for [Hz]."""
        return max([self.up_to_hz, *(mode.hz for mode in self.tool_modes)])

    @property
    def reach_hz(self) -> float:
        """Return how high chatter is looked for: beyond the modes of machine, spindle and tool [Hz]."""
        return max([self.up_to_hz, *(1.5 * mode.hz for mode in self.tool_modes)])

    def describe(self) -> str:
        """In a few words: what is computed, and how far."""
        low, high = 30.0 / math.pi * self.speeds[0], 30.0 / math.pi * self.speeds[-1]
        return f"limit depth at {len(self.speeds)} speeds from {low:g} to {high:g} rpm in {self.material}, {100.0 * self.immersion:.3g} % immersion"


class _SpeedsSpan(NamedTuple):
    """Lowest and highest speed of the spindle and the number of speeds."""

    low: types.PositiveAngularSpeed
    high: types.PositiveAngularSpeed
    number: Annotated[types.WholeNumber, types.Between(2, MOST_SPEEDS)]


def _check_span(span: _SpeedsSpan) -> _SpeedsSpan:
    if span.high <= span.low:
        raise types.problem("ends at no higher speed than it begins; write the lowest speed first")
    return span


Speeds = Annotated[
    _SpeedsSpan,
    types.read_span('speeds: ["2000 rpm", "12000 rpm", 400]'),
    AfterValidator(_check_span),
    types.describe_span((ANGULAR_SPEED,), ["2000 rpm", "12000 rpm", 400], 2),
]


TravelForm = Annotated[
    Literal["feed"] | tuple[float, float, float],
    BeforeValidator(lambda value: value if value == FEED else types.read_direction(value)),
    types.describe_direction(
        "x, -z ..., three plain numbers, or feed",
        (FEED, *types.AXIS_DIRECTIONS),
        "x",
        "feed",
        [1, 1, 0],
    ),
]


class _LobesTable(types.RequestTable):
    """Stability lobes: limit depth of cut over the speed of the spindle."""

    speeds: Speeds
    """lowest and highest speed of the spindle, number of speeds"""
    mill: MillTable
    """the milling tool"""
    radial_depth: types.PositiveLength
    """depth of cut across the tool, at most its diameter"""
    sense: Literal["down", "up"] = "down"
    """`down` (climb): teeth leave at the finished face; `up` (conventional): they enter there"""
    part_side: Literal["right", "left"] | None = None
    """side of the travel on which the part lies; default: where a clockwise tool mills in this sense"""
    material: types.Text
    """workpiece material: of `[cutting.NAME]`, or of the [catalogue](cutting_coefficients.md)"""
    feed_per_tooth: types.PositiveLength | None = None
    """where the tangent to Kienzle's force is taken: at the mean thickness of its chips"""
    directions: Annotated[list[TravelForm], Field(min_length=1, max_length=12)] = [
        (1.0, 0.0, 0.0),
        (0.0, 1.0, 0.0),
    ]
    """directions of the travel. `feed` is that of a path, see [lobes](lobes.md#over-the-workspace-and-along-a-path)"""
    at: types.Text | None = None
    """point where the tool is, or a sensor there that measures x, y and z; default: the first point"""
    up: types.Direction = (0.0, 0.0, 1.0)
    """direction from the tool's tip to its holder"""
    up_to: types.PositiveFrequency = 1000.0
    """modes of the machine are kept at least up to here; higher ones count where they can chatter, those of `tool_modes` always"""
    deepest: types.PositiveLength = 0.05
    """depth of cut up to which a limit is looked for"""
    tool_modes: Annotated[list[ToolModeTable], Field(max_length=12)] = []
    """lumped modes of spindle and tool in a row, from the machine to the tip"""
    tool_receptance: types.Text | None = None
    """measured receptances in their place, equal in both directions across the tool: of the free assembly of spindle, holder and tool, as CSV
    with the columns `frequency,tip_re,tip_im,cross_re,cross_im,base_re,base_im` in Hz and m/N, or as UFF 58 or another
    [file of test data](test_data.md) with the points `tip` and `base` (or two numbers, the lower one the tip); or one receptance alone,
    of the tip of the mounted tool, to which the machine adds nothing"""
    checked: types.NotNegativeShare = 1.0
    """share of the speeds at which the limit is looked for, evenly spread; the others are hatched"""
    poses: types.Names | None = None
    """poses in which it is computed; default: all of them"""

    def _faults(self) -> Iterator[str]:
        if self.radial_depth > self.mill.diameter:
            yield (
                f"radial_depth is {1e3 * self.radial_depth:g} mm and the tool has {1e3 * self.mill.diameter:g} mm; take at most"
                " its diameter"
            )
        if self.tool_modes and self.tool_receptance is not None:
            yield "gives both tool_modes and tool_receptance; keep one"


def _build(table: _LobesTable, draft: Draft) -> LobesRequest:
    """Build the request: in all poses unless the table names some.

    Raises:
        ValueError: The file of receptances is missing or out of bounds.
    """
    scene = draft.table
    path = scene.analyses.get(PathTable)
    return table.fill(
        LobesRequest,
        mill=build_mill(table.mill),
        coefficients=resolve_material(scene, table.material, table, _feeds_per_tooth(table)),
        speeds=np.linspace(
            table.speeds.low, table.speeds.high, table.speeds.number, dtype=np.float64
        ),
        directions=tuple(map(_build_travel, table.directions)),
        at=table.at or next(iter(scene.points)),
        up_to_hz=table.up_to,
        tool_modes=tuple(build_tool_mode(mode, table.up) for mode in table.tool_modes),
        tool_receptance=None
        if table.tool_receptance is None
        else resolve_file(draft.folder, table.tool_receptance, TEST_DATA_SUFFIXES, TEST_DATA),
        poses=tuple(table.poses or draft.poses),
        path=None if path is None else build_path(scene, path),
        part=part_side(table),
    )


def _feeds_per_tooth(table: _LobesTable) -> list[float]:
    return [] if table.feed_per_tooth is None else [table.feed_per_tooth]


def _build_travel(direction: str | tuple[float, float, float]) -> Travel:
    if isinstance(direction, str):
        return Travel(direction)
    return Travel(types.show_direction(direction).strip('"[]').replace(",", ""), direction)


def _check(table: _LobesTable, draft: Draft) -> None:
    """Report names and files that do not exist, directions along the tool, and a machine without
    damping.
    """
    scene = draft.table
    if table.at is not None:
        draft.check_point((*KEY, "at"), table.at)
    elif not draft.sections.get("points"):
        draft.add(KEY, 'there is no point where the tool cuts; write [points], or at = "tcp"')
    _check_speeds(table, draft.findings)
    up = np.array(table.up) / np.linalg.norm(table.up)
    has_path = "path" in scene.analyses.requested or any(
        sweep.path is not None for sweep in scene.sweeps.values()
    )
    for index, direction in enumerate(table.directions):
        if isinstance(direction, str):
            if not has_path:
                draft.findings.add_for(
                    "lobes",
                    (*KEY, "directions", index),
                    f"is the direction along a path, and the scene has none; write a sweep with a path, [analyses.path], or {FIXED}",
                )
        elif fault := find_lead_fault(up, np.array(direction)):
            draft.add(
                (*KEY, "directions", index),
                f"points along the tool, {fault}; write another direction, or another up",
            )
    if table.tool_receptance is not None:
        try:
            resolve_file(draft.folder, table.tool_receptance, TEST_DATA_SUFFIXES, TEST_DATA)
        except ValueError as error:
            draft.add((*KEY, "tool_receptance"), str(error))
    if "damping" not in scene.active:
        draft.add(
            KEY,
            "without damping every cut chatters; write [effects] damping = true and give joints or materials damping,"
            " or damping = { modal = 0.02 }",
        )
    check_cutter(KEY, table, _feeds_per_tooth(table), draft, always=True)


def _check_speeds(table: _LobesTable, findings: Findings) -> None:
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


def _require_feed_of_sweep(scene: Scene, sweep: Sweep) -> None:
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


ANALYSIS = SceneAnalysis(
    _LobesTable,
    LobesRequest,
    "limit depth of cut over the speed of the spindle, see [lobes](lobes.md)",
    build=_build,
    check=_check,
    check_sweep=_require_feed_of_sweep,
)

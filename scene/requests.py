"""What is to be computed of a machine: one request per kind of analysis."""

import math
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import MachinePath, show_position
from headstock.solvers.linear.load_history import LoadHistory
from headstock.solvers.mechanisms.modes import PoseDamping
from headstock.solvers.milling.forces import (
    CuttingCoefficients,
    EndMill,
    MillingCut,
    Sense,
    Side,
)
from headstock.solvers.milling.tool_dynamics import ToolMode
from headstock.solvers.milling.tool_path import PolylineContour, SquareContour, describe_contour
from headstock.solvers.milling.windows import expected_rows
from headstock.solvers.paths.response import LowPass
from headstock.solvers.paths.set_points import SetPoint
from headstock.solvers.second_order import Channel, Motion

LOAD = "load"  # direction of an input that is a load of the scene
PARALLEL = 1e-6  # what is left of a direction across the tool
FEED = "feed"  # name of the direction of travel that a path has in each pose


Motors = Literal["locked", "controlled"]
# analyses in the order of the schema; each is described in a module of this name in scene/analyses
NAMES = (
    "static",
    "modal",
    "frf",
    "map",
    "contouring",
    "path",
    "control",
    "volumetric",
    "lobes",
    "transient",
)


class Request:
    """What is to be computed by one analysis.

    Attributes:
        analysis: Its name, that of its table in ``[analyses]``.
    """

    analysis: ClassVar[str]


@dataclass(frozen=True)
class StaticRequest(Request):
    """Compliance at named points, in named poses (all of them when empty)."""

    analysis: ClassVar[str] = "static"

    at: tuple[str, ...]
    poses: tuple[str, ...] = ()


@dataclass(frozen=True)
class ModalRequest(Request):
    """Natural frequencies: a count or everything up to a frequency [Hz], in named poses.

    ``from_hz``: modes below are counted and not listed. ``stated``: the count is the scene's own.
    ``spread``: also with every interface rigid and with every one averaging.
    """

    analysis: ClassVar[str] = "modal"

    count: int | None = None
    up_to_hz: float | None = None
    poses: tuple[str, ...] = ()
    spread: bool = False
    from_hz: float = 0.0
    stated: bool = True

    def describe(self) -> str:
        """In a few words: what is computed, and how far."""
        if self.from_hz:
            return f"frequencies from {self.from_hz:g} to {self.up_to_hz:g} Hz"
        if self.up_to_hz is None:
            return "all frequencies" if self.count is None else f"{self.count} frequencies"
        first = "frequencies" if self.count is None else f"{self.count} frequencies at most,"
        return f"{first} up to {self.up_to_hz:g} Hz"


@dataclass(frozen=True)
class FrfRequest(Request):
    """Frequency response between input and output channels, in named poses.

    Attributes:
        inputs: Where loads act: ``(point or component.interface, direction)``, or a load of the
            scene as ``(name, LOAD)``.
        outputs: Where motion is wanted.
        probes: Where displacement and stress are wanted.
        from_hz: Lowest frequency [Hz].
        to_hz: Highest frequency [Hz].
        points: Of the even grid.
        spacing: Of the even grid.
        adaptive: Add points around every resonance.
        motion: What is tabled and drawn.
        poses: All of them when empty.
        motors: Locked, or under control.
        fields_at: Frequencies at which volume meshes get displacement and stress [Hz].
    """

    analysis: ClassVar[str] = "frf"

    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    to_hz: float
    probes: tuple[str, ...] = ()
    from_hz: float = 0.0
    points: int = 401
    spacing: Literal["linear", "log"] = "linear"
    adaptive: bool = True
    motion: Motion = "receptance"
    poses: tuple[str, ...] = ()
    motors: Motors = "locked"
    fields_at: tuple[float, ...] = ()

    def describe(self) -> str:
        """In a few words: what is computed, and how far."""
        entries = f"{len(self.outputs)} × {len(self.inputs)} responses"
        under = ", drives under control" if self.motors == "controlled" else ""
        inside = f", displacement and stress at {', '.join(self.probes)}" if self.probes else ""
        return f"{self.motion}, {entries} from {self.from_hz:g} to {self.to_hz:g} Hz{under}{inside}"


def _describe_grid(axes: tuple[tuple[str, FloatArray], ...]) -> str:
    poses = " × ".join(str(len(values)) for _, values in axes)
    *others, last = (name for name, _ in axes)
    return f"{poses} poses of {', '.join(others)} and {last}"


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
        return f"modes, stiffness and condition number in {_describe_grid(self.axes)}"


@dataclass(frozen=True)
class ContouringRequest(Request):
    """A contour.

    Attributes:
        contour: The way of the tool.
        cut: Tool, material and engagement.
        model: ``linear`` along the path, or the full equations.
        steps_per_turn: Time steps per turn of the spindle.
        damping: Of a lumped mechanism.
        material: Name of the work material; None with measured forces.
        forces: File of measured forces; None for computed ones.
        cutting: Whether the tool cuts; otherwise it goes its way in air.
        regeneration: Whether a tooth meets the wave the one before it left.
        point: Where the tool is, of a machine of components; a lumped mechanism has its own.
        modes_to_hz: Modes kept of a machine of components; what is above follows at once.
        follows_pose: The machine's matrices change along the way; else those of its first straight
            cut hold.
        traces: File of measured positions of axes or legs; None for the computed path.
        traces_knots: Distance of the knots of the spline through them [s].
        tool_modes: Lumped modes of spindle and tool, from the machine to the tip.
        cut_off: Wavelength between roughness and waviness of milled faces [m].
        estimate: Its numbers get a ±.
    """

    analysis: ClassVar[str] = "contouring"

    contour: SquareContour | PolylineContour
    cut: MillingCut
    model: Literal["linear", "nonlinear"]
    steps_per_turn: int
    damping: PoseDamping = field(default_factory=PoseDamping)
    material: str | None = None
    forces: Path | None = None
    cutting: bool = True
    regeneration: bool = False
    point: str | None = None
    modes_to_hz: float = math.inf
    follows_pose: bool = True
    traces: Path | None = None
    traces_knots: float = 0.01
    tool_modes: tuple[ToolMode, ...] = ()
    cut_off: float = 0.8e-3
    estimate: bool = True

    def describe(self) -> str:
        """In a few words: what is computed, and how far."""
        source = (
            f"forces of {self.forces.name}"
            if self.forces is not None
            else f"cutting forces in {self.material}"
        )
        if not self.cutting:
            source = "no cutting force: not named in [effects]"
        elif self.regeneration:
            source += ", chips as thick as the last teeth left them"
        if self.traces is not None:
            source += f", drives as in {self.traces.name}"
        if self.tool_modes:
            source += f", {len(self.tool_modes)} mode(s) of spindle and tool"
        return f"tool gap {describe_contour(self.contour)}, {self.model}, {source}"


@dataclass(frozen=True)
class PathCut:
    """Milling along a path.

    Attributes:
        cut: Tool, material and engagement.
        at: Point where the tool is.
        up: Direction from the tool's tip to its holder, machine frame.
        part: On which side of the travel the part lies, seen from above.
    """

    cut: MillingCut
    at: str
    up: tuple[float, float, float]
    part: Side = "right"


@dataclass(frozen=True)
class PathRequest(Request):
    """A move of axes, straight in their positions, once per feed.

    Attributes:
        path: From where to where.
        moves: One per feed, in the order of the scene.
        outputs: Where the deviation is wanted.
        sampling_hz: Samples a second.
        low_pass: What the deviation is filtered by; None for nothing.
        residual_time: How long after a ramp its residual vibration is looked at, and recorded after the end [s].
        band_hz: How high it looks [Hz].
        cut: What is milled on the way; None for a move in air.
        follows_pose: The machine's matrices change along the way; else those of its middle hold.
        estimate: Its numbers get a ±.
    """

    analysis: ClassVar[str] = "path"

    path: MachinePath
    moves: tuple[SetPoint, ...]
    outputs: tuple[Channel, ...]
    sampling_hz: float
    low_pass: LowPass | None
    residual_time: float
    band_hz: float
    cut: PathCut | None = None
    follows_pose: bool = True
    estimate: bool = True

    def describe(self) -> str:
        """In a few words: what is computed, and how far."""
        feeds = " and ".join(move.name.partition(" ")[0] for move in self.moves)
        unit = self.moves[0].name.partition(" ")[2]
        length = show_position(self.path.length, self.path.unit)
        cut = "" if self.cut is None else f", cutting forces in {self.cut.cut.coefficients.name}"
        return f"{', '.join(self.path.axes)} moves {length} at {feeds} {unit}, sampled at {self.sampling_hz:g} Hz{cut}"


@dataclass(frozen=True)
class ControlRequest(Request):
    """Closed loops of the drives: poles up to a frequency [Hz], lag at a speed [m/s], in named
    poses.
    """

    analysis: ClassVar[str] = "control"

    up_to_hz: float
    speed: float
    poses: tuple[str, ...] = ()

    def describe(self, drives: tuple[str, ...]) -> str:
        """In a few words, with the drives whose loops are closed."""
        return f"effect drive_control: loops of {', '.join(drives)} closed, poles up to {self.up_to_hz:g} Hz"


@dataclass(frozen=True, eq=False)
class VolumetricRequest(Request):
    """Position error of the tool at named points over a grid of poses.

    Attributes:
        at: Points.
        axes: Name and positions ``(n,)`` of each axis of the grid [m, rad].
        fixed: Positions of the other axes.
    """

    analysis: ClassVar[str] = "volumetric"

    at: tuple[str, ...]
    axes: tuple[tuple[str, FloatArray], ...]
    fixed: dict[str, float]

    def describe(self) -> str:
        """In a few words: what is computed, and how far."""
        return f"position error of {', '.join(self.at)} in {_describe_grid(self.axes)}"


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
        mill: The tool.
        coefficients: Of the material.
        material: Its name.
        radial_depth: [m].
        speeds: ``(n,)`` rising speeds of the spindle [rad/s].
        directions: Of the travel.
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
    def asks_for_feed(self) -> bool:
        """Whether one of the directions is that of the feed."""
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

    def rows_at(self, speed: float) -> float:
        """Rows of the matrix whose multipliers say whether a cut at a speed [rad/s] is stable, besides
        those of the machine's poles.
        """
        return expected_rows(self.cut_at(speed), self.highest_hz)

    @property
    def highest_hz(self) -> float:
        """Highest natural frequency of machine, spindle and tool that is asked for [Hz]."""
        return max([self.up_to_hz, *(mode.hz for mode in self.tool_modes)])

    @property
    def reach_hz(self) -> float:
        """How high chatter is looked for: beyond the modes of machine, spindle and tool [Hz]."""
        return max([self.up_to_hz, *(1.5 * mode.hz for mode in self.tool_modes)])

    def describe(self) -> str:
        """In a few words: what is computed, and how far."""
        low, high = 30.0 / math.pi * self.speeds[0], 30.0 / math.pi * self.speeds[-1]
        return f"limit depth at {len(self.speeds)} speeds from {low:g} to {high:g} rpm in {self.material}, {100.0 * self.immersion:.3g} % immersion"


@dataclass(frozen=True, eq=False)
class TimedLoad:
    """A load over time.

    Attributes:
        name: Of it.
        target: Where it acts, as point or interface with a direction; or the name of a static load.
        shape: As the scene has it.
        history: Force, moment or factor of the static load over time.
    """

    name: str
    target: Channel | str
    shape: str
    history: LoadHistory


@dataclass(frozen=True, eq=False)
class TransientRequest(Request):
    """Motion under loads that change with time, in named poses.

    Attributes:
        loads: What acts.
        velocities: Component to its velocity before the time zero, machine axes [m/s].
        outputs: Where motion is wanted.
        duration: From the time zero [s].
        sampling_hz: Samples a second.
        up_to_hz: Modes up to here vibrate; those above follow at once.
        settled: Share of its way within which an output has settled.
        poses: All of them when empty.
        motors: Locked, or under control.
        probes: Where displacement and stress are wanted.
    """

    analysis: ClassVar[str] = "transient"

    loads: tuple[TimedLoad, ...]
    velocities: dict[str, tuple[float, float, float]]
    outputs: tuple[Channel, ...]
    duration: float
    sampling_hz: float
    up_to_hz: float
    settled: float
    poses: tuple[str, ...] = ()
    motors: Motors = "locked"
    probes: tuple[str, ...] = ()

    def describe(self) -> str:
        """In a few words: what is computed, and how far."""
        causes = [f"{load.shape.replace('_', ' ')} {load.name}" for load in self.loads]
        if self.velocities:
            causes.append(f"initial velocity of {', '.join(self.velocities)}")
        under = ", drives under control" if self.motors == "controlled" else ""
        inside = f", displacement and stress at {', '.join(self.probes)}" if self.probes else ""
        return f"{', '.join(causes)}: {self.duration:g} s with modes up to {self.up_to_hz:g} Hz{under}{inside}"


@dataclass(frozen=True, init=False)
class Analyses:
    """What is to be computed: at most one request of each kind.

    Attributes:
        requests: In the order of ``NAMES``.
    """

    requests: tuple[Request, ...]

    def __init__(self, *requests: Request | None) -> None:
        """Keep the first request of each kind; None stands for none."""
        given = {request.analysis: request for request in reversed(requests) if request is not None}
        ordered = tuple(given[name] for name in NAMES if name in given)
        object.__setattr__(self, "requests", ordered)

    def get[R: Request](self, kind: type[R]) -> R | None:
        """Return the request of a kind; None where the analysis is not requested."""
        return next((request for request in self.requests if isinstance(request, kind)), None)

    def __getitem__[R: Request](self, kind: type[R]) -> R:
        """Return the request of a kind.

        Raises:
            KeyError: The analysis is not requested.
        """
        request = self.get(kind)
        if request is None:
            raise KeyError(kind.analysis)
        return request

    def __contains__(self, kind: type[Request]) -> bool:
        """Return whether an analysis is requested."""
        return self.get(kind) is not None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the analyses that are requested."""
        return tuple(request.analysis for request in self.requests)

    def keep(self, names: Collection[str]) -> "Analyses":
        """Return the requests of the named analyses."""
        return Analyses(*(request for request in self.requests if request.analysis in names))

    def drop(self, names: Collection[str]) -> "Analyses":
        """Return all requests but those of the named analyses."""
        return self.keep(set(self.names).difference(names))

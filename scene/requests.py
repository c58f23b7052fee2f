"""What is to be computed of a machine: one request per kind of analysis."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import MachinePath
from headstock.solvers.milling.forces import MillingCut
from headstock.solvers.milling.tool_path import SquareContour
from headstock.solvers.paths.response import LowPass
from headstock.solvers.paths.set_points import SetPoint
from headstock.solvers.second_order import Motion, Port


@dataclass(frozen=True)
class StaticRequest:
    """Compliance at named points, in named poses (all of them when empty)."""

    at: tuple[str, ...]
    poses: tuple[str, ...] = ()


@dataclass(frozen=True)
class ModalRequest:
    """Natural frequencies: a count or everything up to a frequency [Hz], in named poses.

    ``spread``: also with every interface rigid and with every one averaging.
    """

    count: int | None = None
    up_to_hz: float | None = None
    poses: tuple[str, ...] = ()
    spread: bool = False


@dataclass(frozen=True)
class FrfRequest:
    """Frequency response between ports, in named poses.

    Attributes:
        inputs: Where loads act: ``(point or component.interface, direction)``.
        outputs: Where motion is wanted.
        from_hz: Lowest frequency [Hz].
        to_hz: Highest frequency [Hz].
        points: Of the even grid.
        spacing: Of the even grid.
        adaptive: Add points around every resonance.
        motion: What is tabled and drawn.
        poses: All of them when empty.
    """

    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    to_hz: float
    from_hz: float = 0.0
    points: int = 401
    spacing: Literal["linear", "log"] = "linear"
    adaptive: bool = True
    motion: Motion = "receptance"
    poses: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class MapRequest:
    """A map over two or three axes.

    Attributes:
        axes: Name and positions ``(n,)`` of each [m, rad].
        fixed: Positions of the other axes.
        count: How many frequencies.
    """

    axes: tuple[tuple[str, FloatArray], ...]
    fixed: dict[str, float]
    count: int = 3


@dataclass(frozen=True)
class ContouringRequest:
    """A contour on a lumped mechanism.

    Attributes:
        contour: The way of the tool.
        cut: Tool, material and engagement.
        model: ``linear`` along the path, or the full equations.
        steps_per_turn: Time steps per turn of the spindle.
        damping_ratios: Of the first, second, ... mode, the last for all others; empty for none.
        material: Name of the work material; None with measured forces.
        forces: File of measured forces; None for computed ones.
        cutting: Whether the tool cuts; otherwise it goes its way in air.
        regeneration: Whether a tooth meets the wave the one before it left.
    """

    contour: SquareContour
    cut: MillingCut
    model: Literal["linear", "nonlinear"]
    steps_per_turn: int
    damping_ratios: tuple[float, ...] = ()
    material: str | None = None
    forces: Path | None = None
    cutting: bool = True
    regeneration: bool = False


@dataclass(frozen=True)
class PathCut:
    """Milling along a path.

    Attributes:
        cut: Tool, material and engagement; the part lies on the right of the travel.
        at: Point where the tool is.
        up: Direction from the tool's tip to its holder, machine frame.
    """

    cut: MillingCut
    at: str
    up: tuple[float, float, float]


@dataclass(frozen=True)
class PathRequest:
    """A straight move of axes, once per feed.

    Attributes:
        path: From where to where.
        moves: One per feed, in the order of the scene.
        outputs: Where the deviation is wanted.
        sampling_hz: Samples a second.
        low_pass: What the deviation is filtered by; None for nothing.
        ring_down: How long after a ramp its ringing is looked at, and recorded after the end [s].
        cut: What is milled on the way; None for a move in air.
        follows_pose: The machine's matrices change along the way; else those of its middle hold.
    """

    path: MachinePath
    moves: tuple[SetPoint, ...]
    outputs: tuple[Port, ...]
    sampling_hz: float
    low_pass: LowPass | None
    ring_down: float
    cut: PathCut | None = None
    follows_pose: bool = True


@dataclass(frozen=True)
class ControlRequest:
    """Closed loops of the drives: poles up to a frequency [Hz], lag at a speed [m/s], in named poses."""

    up_to_hz: float
    speed: float
    poses: tuple[str, ...] = ()


@dataclass(frozen=True)
class Analyses:
    """What is to be computed; None where an analysis is not asked for."""

    static: StaticRequest | None = None
    modal: ModalRequest | None = None
    frf: FrfRequest | None = None
    map: MapRequest | None = None
    contouring: ContouringRequest | None = None
    path: PathRequest | None = None
    control: ControlRequest | None = None

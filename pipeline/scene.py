"""The scene: a machine, where it stands, and what is to be computed of it."""

import dataclasses
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from headstock.geometry.components import Fidelity
from headstock.geometry.drives import Drive
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine_paths import MachinePath
from headstock.geometry.machines import Machine, Pose
from headstock.geometry.tool_mechanisms import ToolMechanism
from headstock.pipeline.study_points import Study
from headstock.pipeline.sweep_poses import Sweep
from headstock.solvers.milling_forces import MillingCut
from headstock.solvers.path_figures import LowPass
from headstock.solvers.second_order import Motion, Port
from headstock.solvers.set_points import SetPoint
from headstock.solvers.tool_paths import SquareContour


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


@dataclass(frozen=True)
class Limits:
    """What a run may cost: elements of one mesh, memory [byte], time of one mesh [s]; None for the defaults."""

    elements: int | None = None
    memory_bytes: float | None = None
    time_s: float | None = None


@dataclass(frozen=True)
class AccuracyGoal:
    """How far any requested number may be off.

    Attributes:
        to: Relative error.
        fidelity: Elastic components whose share of the strain energy is small enough may become rigid.
    """

    to: float
    fidelity: bool = False


@dataclass(frozen=True)
class CompareSettings:
    """What ``headstock compare`` shows unless it is told otherwise.

    Attributes:
        variants: Columns, ``A+B`` for joined variants and ``as written`` for none; empty for all.
        fidelities: Each variant once with its elastic parts at each of them; empty for as they are.
        pose: Pose name; None for the first.
        reference: Column the others are held against; None for the richest.
    """

    variants: tuple[str, ...] = ()
    fidelities: tuple[Fidelity, ...] = ()
    pose: str | None = None
    reference: str | None = None


@dataclass(frozen=True)
class LegSprings:
    """Springs of each leg of a lumped mechanism.

    Attributes:
        joint: Platform joint, along and across the leg [N/m].
        drive: Nut and bearings, along the leg [N/m].
        screw: Young's modulus times section of the screw [N].
        screw_offset: Free length of the screw less the length of the leg [m].
    """

    joint: float
    drive: float
    screw: float
    screw_offset: float = 0.0


@dataclass(frozen=True, eq=False)
class SceneMechanism(ToolMechanism):
    """The closed-loop mechanism of a scene.

    Attributes:
        kind: Which mechanism.
        model: ``lumped``: rigid bodies on springs in the legs; ``components``: it only places the components it carries.
        springs: For the lumped model.
        screw_lead: Travel of a leg per turn of its motor [m]; None where it is not known.
    """

    kind: str
    model: Literal["lumped", "components"]
    springs: LegSprings | None = None
    screw_lead: float | None = None


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene that has passed every check.

    Attributes:
        name: Name in the scene, or the file's.
        path: Scene file.
        machine: The machine in SI units.
        poses: By name, at least one: ``reference`` with every axis at zero when the scene names none.
        analyses: What is to be computed.
        on_request: What is computed only when it is named.
        effects: Names of the effects that are switched on.
        variants: Names of the variants the scene offers.
        compare: Which of them are held side by side.
        raw: Parsed TOML after overrides.
        limits: What a run may cost.
        warnings: What is allowed but looks wrong, each with its place.
        variant: Variant that was applied.
        studies: What may be varied, by name.
        sweeps: Poses in which the analyses may be repeated, by name.
        mechanism: The closed-loop mechanism that carries components, if any.
        drives: By name; empty unless the effect drive_control is on.
        accuracy: How far any number may be off; None where mesh sizes and modes are as the scene says.
        modal_damping: Damping ratios of the first, second, ... elastic mode, the last for all others; empty for none.
    """

    name: str
    path: Path
    machine: Machine
    poses: dict[str, Pose]
    analyses: Analyses
    effects: frozenset[str]
    variants: tuple[str, ...]
    raw: dict[str, Any]
    limits: Limits = field(default_factory=Limits)
    warnings: tuple[str, ...] = ()
    variant: str | None = None
    studies: dict[str, Study] = field(default_factory=dict)
    sweeps: dict[str, Sweep] = field(default_factory=dict)
    mechanism: SceneMechanism | None = None
    modal_damping: tuple[float, ...] = ()
    compare: CompareSettings = field(default_factory=CompareSettings)
    accuracy: AccuracyGoal | None = None
    on_request: Analyses = field(default_factory=Analyses)
    drives: dict[str, Drive] = field(default_factory=dict)


def keep_analyses(scene: Scene, names: Collection[str]) -> Scene:
    """The scene with only the named ones of its analyses, those on request among them."""
    kept = {name: request for name, request in list_analyses(scene).items() if name in names}
    return dataclasses.replace(scene, analyses=Analyses(**kept))


def list_analyses(scene: Scene) -> dict[str, Any]:
    """Every analysis of a scene by name, on request or not."""
    return {
        item.name: request
        for item in dataclasses.fields(Analyses)
        for request in (getattr(scene.analyses, item.name) or getattr(scene.on_request, item.name),)
        if request is not None
    }

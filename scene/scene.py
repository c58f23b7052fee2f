"""The scene: a machine, its orientation, and what is to be computed of it."""

import dataclasses
import itertools
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Literal

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import Drive
from headstock.geometry.machine.guide_errors import ErrorProfile
from headstock.geometry.machine.machine import Machine, Pose
from headstock.geometry.mechanisms.exechon import ToolMechanism
from headstock.geometry.parts.components import Fidelity
from headstock.geometry.parts.solids import SuperelementFile
from headstock.scene.exports import Export
from headstock.scene.reading.files import TomlTable, TomlValue
from headstock.scene.reading.findings import Findings, Problem, SceneError, suggest_names
from headstock.scene.reading.names import NAMES
from headstock.scene.reading.open_values import OpenValue
from headstock.scene.studies import Study, Sweep

LOAD = "load"  # direction of an input that is a load of the scene
Motors = Literal["locked", "controlled"]


class Request:
    """What is to be computed by one analysis.

    Attributes:
        analysis: Its name, that of its table in ``[analyses]``.
    """

    analysis: ClassVar[str]

    @property
    def poses(self) -> tuple[str, ...] | None:
        """Return the poses it is computed in, empty for all; None where it is computed once a run."""
        return None

    @property
    def loaded_places(self) -> tuple[str, ...]:
        """Return names of the points, sensors, interfaces and loads at which forces act."""
        return ()

    def names_pose(self, pose: str) -> bool:
        """Return whether it is computed in a pose."""
        return self.poses is not None and (not self.poses or pose in self.poses)


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


def describe_grid(axes: tuple[tuple[str, FloatArray], ...]) -> str:
    """Return how many poses a grid has, and of which axes.

    Args:
        axes: Name and positions ``(n,)`` of each.
    """
    poses = " × ".join(str(len(values)) for _, values in axes)
    *others, last = (name for name, _ in axes)
    return f"{poses} poses of {', '.join(others)} and {last}"


@dataclass(frozen=True)
class Limits:
    """What a run may cost: elements of one mesh, memory [byte], time of one mesh [s]; None for the
    defaults.
    """

    elements: int | None = None
    memory_bytes: float | None = None
    time_s: float | None = None


@dataclass(frozen=True)
class AccuracyGoal:
    """How far any requested number may be off.

    Attributes:
        models: Which bodies become rigid, segmented or elastic as the accuracy allows: those that
            deform in the scene, all, or none.
        interfaces: Which interfaces with six motions at rigid joints may get deformation shapes:
            those whose kind is not written, all, or none.
    """

    to: float
    models: Literal["none", "deforming", "all"] = "none"
    interfaces: Literal["none", "open", "all"] = "none"


@dataclass(frozen=True)
class CompareSettings:
    """What ``headstock compare`` shows by default.

    Attributes:
        variants: Columns, ``A+B`` for joined variants and ``as written`` for none; empty for all.
        fidelities: Each variant once with its elastic parts at each of them; empty for as they are.
        pose: Pose name; None for the first.
        reference: Column the others are compared with; None for the richest.
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
        model: ``lumped``: rigid bodies on springs in the legs; ``components``: it only places the
            components it carries.
        screw_lead: Travel of a leg per turn of its motor [m]; None where it is not known.
        leg_errors: Number of a leg, 0..2, to the error of its length over its length.
    """

    kind: str
    model: Literal["lumped", "components"]
    springs: LegSprings | None = None
    screw_lead: float | None = None
    leg_errors: Mapping[int, ErrorProfile] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class FitSpread:
    """What fits to measurements leave open of a scene.

    Attributes:
        moves: Independent changes by half of a 95 % interval, each dotted keys to values.
        open: Parameters that the measurements leave open; no move has them.
        scatter: Kind of measurement to half of the 95 % interval of its errors, relative.
        overrides: ``key=value`` settings with which the scene was loaded.
        values: Keys to values with which it was loaded.
    """

    moves: tuple[Mapping[str, TomlValue], ...]
    open: tuple[str, ...]
    scatter: Mapping[str, float]
    overrides: tuple[str, ...]
    values: Mapping[str, TomlValue]


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene that has passed every check.

    Attributes:
        name: Name in the scene, or the file's.
        poses: By name, at least one: ``reference`` with every axis at zero when the scene names
            none.
        analyses: What is to be computed.
        on_request: What is computed only when it is named.
        deferred: What keeps an analysis on request from running as the scene stands, by its name.
        variants: Names of the variants the scene offers.
        raw: Parsed TOML after overrides, in full.
        written: The same as it is written: expressions not calculated, ``places`` in short.
        limits: What a run may cost.
        warnings: What is allowed but looks wrong, each with its place.
        assumptions: Which values are the catalogue's, and how uncertain they are.
        studies: What may be varied, by name.
        sweeps: Poses in which the analyses may be repeated, by name.
        mechanism: The closed-loop mechanism that carries components, if any.
        drives: By name; empty unless the effect drive_control is on.
        accuracy: How far any number may be off; None where mesh sizes and modes are as the scene
            says.
        model_errors: Compare rigid and segmented bodies with coarse finite elements.
        interface_errors: Compare rigid joints between elastic bodies with deformation shapes.
        modal_damping: Damping ratios of the first, second, ... elastic mode, the last for all
            others; empty for none.
        findings: Where each key comes from, for what only the files of parts can tell.
        exports: What a run writes for other programs, by name.
        questions: Values that are open, whose defaults are used.
        fit: What the fits whose variants are applied leave open; None without any.
    """

    name: str
    path: Path
    machine: Machine
    poses: dict[str, Pose]
    analyses: Analyses
    effects: frozenset[str]
    variants: tuple[str, ...]
    raw: TomlTable
    limits: Limits = field(default_factory=Limits)
    warnings: tuple[str, ...] = ()
    assumptions: tuple[str, ...] = ()
    variant: str | None = None
    studies: dict[str, Study] = field(default_factory=dict)
    sweeps: dict[str, Sweep] = field(default_factory=dict)
    mechanism: SceneMechanism | None = None
    modal_damping: tuple[float, ...] = ()
    compare: CompareSettings = field(default_factory=CompareSettings)
    accuracy: AccuracyGoal | None = None
    model_errors: bool = False
    interface_errors: bool = False
    on_request: Analyses = field(default_factory=Analyses)
    deferred: dict[str, tuple[Problem, ...]] = field(default_factory=dict)
    drives: dict[str, Drive] = field(default_factory=dict)
    findings: Findings = field(default_factory=lambda: Findings(""))
    written: TomlTable = field(default_factory=dict)
    fit: FitSpread | None = None
    exports: dict[str, Export] = field(default_factory=dict)
    questions: tuple[OpenValue, ...] = ()

    @property
    def is_lumped(self) -> bool:
        """Return whether the mechanism itself is the model: rigid bodies on springs in its legs."""
        return self.mechanism is not None and self.mechanism.model == "lumped"


def require_name(scene: Scene, section: str, name: str, known: Iterable[str]) -> None:
    """Refuse a name that is none of those there are.

    Args:
        section: Of the scene, that names the things.
        known: Those that can be.

    Raises:
        SceneError: It is none of them; says which one was probably meant.
    """
    names = list(known)
    if name not in names:
        hint = suggest_names(name, names, what=section)
        text = f"there is none of this name; {hint}"
        raise SceneError([scene.findings.describe((section, name), text)])


def deforming_parts(scene: Scene) -> list[str]:
    """Components whose fidelity may be chosen: neither rigid nor imported as a superelement."""
    return [
        name
        for name, component in scene.machine.components.items()
        if component.fidelity != "rigid" and not isinstance(component.solid, SuperelementFile)
    ]


def keep_analyses(scene: Scene, names: Collection[str]) -> Scene:
    """The scene with only the named ones of its analyses, those on request among them.

    Raises:
        SceneError: A named analysis cannot run as the scene stands.
    """
    if lacking := [problem for name in names for problem in scene.deferred.get(name, ())]:
        raise SceneError(lacking)
    return dataclasses.replace(scene, analyses=_every_request(scene).keep(names))


def choose_poses(scene: Scene) -> dict[str, Pose]:
    """Return the poses that an analysis asks for, in the scene's order; without an analysis the first, to
    show that the machine couples.
    """
    requested = {
        name: pose
        for name, pose in scene.poses.items()
        if any(request.names_pose(name) for request in scene.analyses.requests)
    }
    return requested or dict(itertools.islice(scene.poses.items(), 1))


def acting_assumptions(scene: Scene) -> tuple[str, ...]:
    """Assumptions, but those of analyses that are not run."""
    idle = tuple(f"analyses.{name}." for name in NAMES if name not in scene.analyses.names)
    return tuple(text for text in scene.assumptions if not text.startswith(idle))


def list_analyses(scene: Scene) -> dict[str, Request]:
    """Every analysis of a scene by name, on request or not."""
    return {request.analysis: request for request in _every_request(scene).requests}


def _every_request(scene: Scene) -> Analyses:
    return Analyses(*scene.analyses.requests, *scene.on_request.requests)

"""The state of a run: what its stages have made so far and hand on."""

import dataclasses
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from headstock.geometry.errors import lacks_memory, out_of_memory, printable
from headstock.geometry.frames import FloatArray, Frame
from headstock.geometry.machine.drives import Drive
from headstock.geometry.machine.machine import Pose, Probe, Sensor
from headstock.geometry.parts.components import Component, Load, Support
from headstock.geometry.parts.skins import Skin
from headstock.meshing.component_mesh import ComponentMesh, MeshQuality
from headstock.meshing.errors import MeshError, PatchError
from headstock.pipeline.answers.answer import Answer, find_answers
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.answers.modal import PoseModes
from headstock.pipeline.answers.static import PointCompliance, StaticAnswer
from headstock.pipeline.numbers.estimates import Estimate
from headstock.pipeline.numbers.numbers import Key
from headstock.pipeline.planning.budgets import iterative_seconds, reduction_seconds
from headstock.pipeline.planning.plan import Plan, Stage, StageRecord
from headstock.pipeline.planning.resources import measure
from headstock.pipeline.results.views import PoseView, ShiftArray
from headstock.pipeline.storage.part_files import locate_patch
from headstock.pipeline.storage.store import Store
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.joint_forces import JointForces
from headstock.reduction.motions.mode_naming import NamedModes
from headstock.reduction.superelement import Superelement
from headstock.scene.scene import Scene
from headstock.solvers.control.drive_trains import DriveTrain
from headstock.solvers.linear.modal_analysis import ModalResult
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import SharedFailure
from headstock.solvers.second_order import Channel, ComplexArray, SecondOrderSystem


@dataclass(frozen=True, eq=False)
class ReducedComponent:
    """What the store keeps of a reduced component: its superelement, the quality of the mesh it
    came from and that mesh's skin.
    """

    superelement: Superelement
    quality: MeshQuality | None = None
    skin: Skin | None = None


@dataclass(frozen=True, eq=False)
class HarmonicMotion:
    """Motion of a coupled machine under a harmonic load, complex amplitudes.

    Attributes:
        given: Input at which it acts with unit size, or as a whole load of the scene.
        hz: Its frequency [Hz].
        motion: ``(n_all,)`` of all superelement dofs.
        inside: Component to how much of each unit load of its superelement acts in it.
        lossy: Component to its complex modulus over its modulus.
    """

    given: Channel
    hz: float
    motion: ComplexArray
    inside: Mapping[str, Mapping[str, float]]
    lossy: Mapping[str, complex]


@dataclass(frozen=True, eq=False)
class PoseMotions:
    """Motions of a coupled machine in a pose: of all superelement dofs, and which of them are each
    component's.

    Attributes:
        motions: ``"POINT DIRECTION"`` to ``(n_all,)`` motion under a unit force there [m/N, rad/N].
        harmonic: Motions under harmonic loads.
    """

    offsets: dict[str, slice]
    motions: dict[str, FloatArray] = field(default_factory=dict)
    harmonic: tuple[HarmonicMotion, ...] = ()


@dataclass(frozen=True, eq=False)
class MachineParts:
    """What a machine is made of, in every pose.

    Attributes:
        reduced: Component to what it was reduced to; on rank 0.
    """

    scene: Scene
    plan: Plan
    reduced: Mapping[str, ReducedComponent]

    @property
    def superelements(self) -> dict[str, Superelement]:
        """By component, in the order of the plan."""
        return {name: self.reduced[name].superelement for name in self.plan.components}


@dataclass(frozen=True, eq=False)
class Solved[T]:
    """What an analysis found, and what is said with it.

    Attributes:
        failures: Parts that were refused, with the reason.
        errors: ± of the answer's numbers, where it does not hold them itself.
    """

    answer: T
    warnings: tuple[str, ...] = ()
    failures: tuple[str, ...] = ()
    errors: Mapping[Key, Estimate] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Released:
    """A machine in a pose with its motors let go.

    Attributes:
        weight: ``(n, n)`` what weight and the anchors of motors add to its stiffness [N/m]; None
            where weight does not count.
    """

    model: "PoseModel"
    trains: tuple[DriveTrain, ...]
    weight: FloatArray | None = None


class PoseModel(Protocol):
    """What analyses ask of a machine in a pose, coupled of superelements or a lumped mechanism.

    Motions of superelement dofs ``(n_all, k)`` hold those of all components, one below the other.
    """

    @property
    def parts(self) -> MachineParts:
        """Components of the machine."""

    @property
    def pose(self) -> Pose:
        """Positions of its axes."""

    @property
    def coupled(self) -> CoupledMachine | None:
        """The machine of superelements; None of a lumped mechanism."""

    @property
    def system(self) -> SecondOrderSystem:
        """Its equations of motion."""

    @property
    def all_modes(self) -> ModalResult:
        """All undamped modes of the system, solved once for the analyses that need them."""

    @property
    def placements(self) -> Mapping[str, Frame]:
        """Frame of each component in the machine frame."""

    @property
    def offsets(self) -> dict[str, slice]:
        """Component to its rows among the superelement dofs."""

    def expand(self, motions: FloatArray) -> FloatArray:
        """Motions of superelement dofs ``(n_all, k)`` of motions of the system ``(n, k)``."""

    @property
    def loads(self) -> Mapping[str, FloatArray]:
        """Generalised load ``(n,)`` of every static load by name, gravity among them."""

    @property
    def joints(self) -> tuple[JointForces, ...]:
        """Forces of its joints, or of the springs of a lumped mechanism's legs."""

    def momentum(self, velocities: Mapping[str, FloatArray]) -> FloatArray:
        """Generalised momentum ``(n,)`` of components that translate, each at its velocity
        ``(3,)`` in machine axes [m/s]; the others are at rest.
        """

    def push(self, channel: Channel) -> FloatArray:
        """Motion of the system ``(n,)`` under a unit force or moment in a channel [m/N]."""

    def name_modes(self, modes: ModalResult) -> NamedModes:
        """Names and energy shares of undamped modes."""

    def estimate_mode_errors(self, modes: ModalResult) -> tuple[Estimate, ...]:
        """An estimate [Hz] per natural frequency."""

    def solve_point(self, name: str) -> Solved[PointCompliance]:
        """Static compliance at a point, its budget and its errors."""

    def release(self, drives: Collection[Drive]) -> Released:
        """The same machine with the motors of drives let go: they are coordinates of its system."""

    def view(self) -> PoseView:
        """Return what is drawn of the pose without motions."""

    def shift_skins(self, skins: dict[str, Skin], motions: FloatArray) -> dict[str, ShiftArray]:
        """Displacement ``(k, n, 3)`` of every skin point in machine axes under motions of
        superelement dofs.
        """


@dataclass(eq=False)
class RunState:
    """Everything stages read and add to; complete on rank 0.

    On other ranks ``meshes`` tells which components are to be reduced, and holds None for each.
    """

    scene: Scene
    plan: Plan
    comm: MPI.Comm
    store: Store
    meshes: dict[str, ComponentMesh | None] = field(default_factory=dict)
    reduced: dict[str, ReducedComponent] = field(default_factory=dict)
    read: dict[object, ReducedComponent] = field(default_factory=dict)
    model: PoseModel | None = None
    skins: dict[str, Skin] = field(default_factory=dict)
    views: dict[str, PoseView] = field(default_factory=dict)
    motions: dict[str, PoseMotions] = field(default_factory=dict)
    answers: list[Answer] = field(default_factory=list)
    energy_errors: dict[str, float] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)

    @property
    def is_root(self) -> bool:
        """This is rank 0, which reads, writes and couples."""
        return int(self.comm.rank) == 0

    @property
    def parts(self) -> MachineParts:
        """Components of the machine."""
        return MachineParts(self.scene, self.plan, self.reduced)

    @property
    def coupled(self) -> CoupledMachine | None:
        """The coupled machine in this pose; None before coupling and of a lumped mechanism."""
        return None if self.model is None else self.model.coupled

    @property
    def static(self) -> tuple[StaticAnswer, ...]:
        """Static compliances found so far, one per pose."""
        return find_answers(self.answers, StaticAnswer)

    @property
    def modal(self) -> tuple[PoseModes, ...]:
        """Natural modes found so far, one per pose."""
        return find_answers(self.answers, PoseModes)

    @property
    def responses(self) -> tuple[PoseResponse, ...]:
        """Frequency responses found so far, one per pose."""
        return find_answers(self.answers, PoseResponse)

    def weigh_meshes(self, factors: Mapping[str, float]) -> None:
        """Multiply components' estimates of mesh errors; those not reduced here are left out."""
        for name, factor in factors.items():
            if name in self.reduced:
                known = self.reduced[name]
                errors = known.superelement.errors
                weighed = dataclasses.replace(errors, mesh_safety=factor * errors.mesh_safety)
                self.reduced[name] = dataclasses.replace(
                    known, superelement=dataclasses.replace(known.superelement, errors=weighed)
                )

    def warn(self, message: str | None) -> None:
        """Keep a warning, each text once, on one line and without what a terminal would obey."""
        message = printable(message or "")
        if message and message not in self.warnings:
            self.warnings.append(message)


@dataclass(frozen=True)
class Outcome:
    """How a stage went.

    Attributes:
        cached: Its result came from the store.
        detail: What came out, in a few words.
        answers: What it found, to be kept.
        failures: Analyses that were refused, with the reason.
    """

    cached: bool = False
    detail: str = ""
    answers: tuple[Answer, ...] = ()
    warnings: tuple[str, ...] = ()
    failures: tuple[str, ...] = ()


Announcer = Callable[[Stage], None]
Observer = Callable[[StageRecord], None]


def _expect_by_mesh(state: RunState, stage: Stage) -> Stage:
    """Return the reduction of a mesh with what it costs by that mesh, which a plan without a survey
    takes for one without imprints; any other stage as it is.
    """
    mesh = state.meshes.get(stage.component or "")
    if stage.kind != "reduce" or stage.component is None or mesh is None:
        return stage
    component, dofs = state.plan.components[stage.component], 3 * len(mesh.points)
    iterates = component.reduction.solver == "iterative"
    cost = iterative_seconds if iterates else reduction_seconds
    seconds = cost(dofs, component, mesh.quality.volume)
    return dataclasses.replace(stage, estimated_dofs=dofs, estimated_seconds=seconds)


def run_stage(
    state: RunState,
    stage: Stage,
    work: Callable[[RunState, Stage], Outcome],
    *,
    announce: Announcer = lambda stage: None,
    observer: Observer = lambda record: None,
) -> None:
    """Do the work of a stage and measure what it costs.

    Args:
        work: Collective; adds to the state.
        announce: Called with the stage before it begins, on every rank.
        observer: Called with the record of the stage as it ends, on rank 0.

    Raises:
        HeadstockError: The work failed, or the memory was not enough for it.
    """
    announce(_expect_by_mesh(state, stage))
    with measure() as cost:
        try:
            outcome = work(state, stage)
        except SharedFailure as failure:
            if isinstance(failure.__cause__, Exception):
                raise SharedFailure from _locate_error(state, stage, failure.__cause__)
            raise
        except Exception as error:
            located = _locate_error(state, stage, error)
            if located is error:
                raise
            raise located from error
    state.answers += outcome.answers
    for message in outcome.warnings:
        state.warn(message)
    state.failures += [message for message in outcome.failures if message not in state.failures]
    if state.is_root:
        observer(
            StageRecord(
                stage,
                cost.seconds,
                outcome.cached,
                cost.peak_rss_mb,
                outcome.detail,
                cpu_seconds=cost.cpu_seconds,
            )
        )


def _locate_error(state: RunState, stage: Stage, error: Exception) -> Exception:
    """An error of a stage with its place in the scene; where memory lacked, which stage it was."""
    if lacks_memory(error) and not isinstance(error, MeshError):
        return out_of_memory(" ".join(filter(None, ("stage", stage.kind, stage.component))))
    if isinstance(error, PatchError) and stage.component is not None:
        return locate_patch(state.scene, stage.component, error)
    return error


def pose_name(stage: Stage) -> str:
    """The pose a stage works in.

    Raises:
        ValueError: It is a stage of a component or of all poses.
    """
    if stage.pose is None:
        raise ValueError(f"a {stage.kind} stage needs a pose")
    return stage.pose


def pose_model(state: RunState) -> PoseModel:
    """The machine in the pose at hand.

    Raises:
        ValueError: No stage has coupled or placed it.
    """
    if state.model is None:
        raise ValueError("an analysis needs a machine in a pose before it")
    return state.model


def component_supports(state: RunState, component: Component) -> tuple[Support, ...]:
    """Return the supports on a component."""
    return _select(component, state.scene.machine.supports)


def component_loads(state: RunState, component: Component) -> tuple[Load, ...]:
    """Return the loads on a component."""
    return _select(component, state.scene.machine.loads)


def component_probes(state: RunState, component: Component) -> tuple[Probe, ...]:
    """Return the probes in a component."""
    return _select(component, state.scene.machine.probes)


def component_sensors(state: RunState, component: Component) -> tuple[Sensor, ...]:
    """Return the sensors and point masses on a component."""
    return _select(component, state.scene.machine.sensors)


def _select[T: (Support, Load, Probe, Sensor)](
    component: Component, items: Mapping[str, T]
) -> tuple[T, ...]:
    return tuple(item for item in items.values() if item.component == component.name)

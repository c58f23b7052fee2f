"""Analyses as entries of a run: when a scene asks for one, what its stage says and costs, who does it and
what it finds. One more analysis is one more record in :data:`RECORDS`.

Records name functions and classes by text: what a scene does not ask for is not imported.
"""

import importlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from headstock.geometry.machine.machine import Pose
from headstock.geometry.parts.components import Component
from headstock.pipeline.planning.budgets import (
    CONTOUR_AGAIN,
    CONTROLLED_COST,
    COUPLINGS_PER_SECOND,
    DOFS_OF_A_BODY,
    MANY_DOFS,
    PATH_STEPS_PER_TURN,
    POSES_PER_SECOND,
    SECONDS_PER_COUPLED_CUBE,
    STAGE_SECONDS,
    contour_memory_mb,
    contour_step_seconds,
    lobes_seconds,
    path_memory_mb,
    path_seconds,
    plan_tool_steps,
    pose_seconds,
    transient_seconds,
)
from headstock.pipeline.planning.plan import Stage
from headstock.reduction.estimates.corrected_elements import (
    COMBINED_REFINEMENTS,
    SEPARATE_REFINEMENTS,
    Refinement,
    list_refinements,
)
from headstock.scene.analyses.contouring import ContouringRequest
from headstock.scene.analyses.control import ControlRequest
from headstock.scene.analyses.frf import FrfRequest
from headstock.scene.analyses.lobes import LobesRequest
from headstock.scene.analyses.map import MapRequest
from headstock.scene.analyses.modal import ModalRequest
from headstock.scene.analyses.path import PathRequest
from headstock.scene.analyses.static import StaticRequest
from headstock.scene.analyses.transient import TransientRequest
from headstock.scene.analyses.volumetric import VolumetricRequest
from headstock.scene.scene import Analyses, Scene
from headstock.solvers.milling.forces import MillingCut
from headstock.solvers.milling.tool_path import plan_contour
from headstock.solvers.motion.deviation import PADDING

GRAVITY = "gravity"
PROBED = 9  # numbers at a probe
# Craig-Bampton frequencies of a column with two rigid faces are right within 0.6 % when modes reach
# 3 times the wanted range (1.5 % at 2 times): Craig and Bampton (1968), checked by `validate
# reduction`.
MODE_MARGIN = 3.0
# Near a resonance a response is far more sensitive: 12 times keep it within 1 % of the whole
# model up to 1.5 times the highest frequency, 3 times miss up to 6 % (`validate
# frequency_response`, a column with two rigid faces, loss factor 4 %).
FRF_MARGIN = 12.0
EXACT_MARGIN = 1.5
EFFECTS_ALONG_PATHS = {
    "friction": "friction",
    "torque_ripple": "torque ripple",
    "guide_errors": "errors of guides and drives",
    "coriolis": "forces of speeds (Coriolis)",
}


@dataclass(frozen=True)
class PlannedMachine:
    """The machine of a scene as its components are planned.

    Attributes:
        components: With the settings that the plan decided on.
    """

    scene: Scene
    components: Mapping[str, Component]
    dofs: int

    @property
    def coupled_seconds(self) -> float:
        """Return what an analysis takes longer where dampers or loss factors couple the modes [s]."""
        joints, parts = self.scene.machine.joints.values(), self.components.values()
        couples = "damping" in self.scene.effects and (
            any(joint.loss_factor or joint.damping.any() for joint in joints)
            or any(part.material.loss_factor for part in parts if part.fidelity != "rigid")
        )
        return SECONDS_PER_COUPLED_CUBE * self.dofs**3 if couples else 0.0


def _describe(scene: Scene, request: Any) -> str:
    return str(request.describe())


@dataclass(frozen=True)
class AnalysisRecord:
    """What a run has to know of an analysis.

    Attributes:
        solve: Module and function that do its work, ``module:function``.
        answer: Module and class of what it finds, ``module:class``.
        reason: Why the scene calls for it, in plain words.
        seconds: Processor time in a pose at so many dofs [s]; None where nothing can be said.
        stage: The stage of a whole run; None for an analysis of each pose it names.
        reach: How high it looks [Hz], and how many times that the modes must reach; None where it
            names no frequency or needs no modes.
        reach_name: What is said to reach that far.
        dynamic: It needs mass and modes.
        asked: Whether a scene with the request calls for it.
    """

    kind: str
    request: type[Any]
    solve: str
    answer: str
    reason: Callable[[Scene, Any], str] = _describe
    seconds: Callable[[PlannedMachine, Any], float | None] | None = None
    stage: Callable[[PlannedMachine, Any, str], Stage] | None = None
    shared: bool = False
    reach: Callable[[Any], tuple[float, float] | None] | None = None
    reach_name: str = ""
    dynamic: bool = True
    asked: Callable[[Scene], bool] = lambda scene: True

    def find_request(self, scene: Scene) -> Any | None:
        """Return the request of a scene that calls for the analysis; None where none does."""
        request = scene.analyses.get(self.request)
        return request if request is not None and self.asked(scene) else None

    def plan_pose(self, machine: PlannedMachine, pose: Pose) -> Stage | None:
        """Return the stage in a pose; None where it is not asked for there."""
        request = self.find_request(machine.scene)
        if self.stage is not None or request is None or not request.names_pose(pose.name):
            return None
        seconds = (
            pose_seconds(self.kind, machine.dofs)
            if self.seconds is None
            else self.seconds(machine, request)
        )
        why = self.reason(machine.scene, request)
        return Stage(self.kind, None, why, pose=pose.name, estimated_seconds=seconds)

    def plan_run(self, machine: PlannedMachine) -> Stage | None:
        """Return the stage of a whole run; None where it is not asked for."""
        request = self.find_request(machine.scene)
        if self.stage is None or request is None:
            return None
        return self.stage(machine, request, self.reason(machine.scene, request))


def load_answer_types() -> list[type[Any]]:
    """Return the classes of everything that a run may find."""
    return [load_named(text) for text in (*(record.answer for record in RECORDS), *OTHER_ANSWERS)]


def load_named(text: str) -> Any:
    """Return what ``module:name`` names."""
    module, _, name = text.partition(":")
    return getattr(importlib.import_module(module), name)


def is_dynamic(analyses: Analyses) -> bool:
    """Return whether an analysis needs mass and fixed-interface modes."""
    return any(record.dynamic and record.request in analyses for record in RECORDS)


def list_reaches(analyses: Analyses) -> dict[str, tuple[float, float]]:
    """Return how high each analysis looks [Hz], and how many times that the modes must reach; a count of
    frequencies says nothing.
    """
    return {
        record.reach_name: reach
        for record in RECORDS
        if record.reach is not None
        and (request := analyses.get(record.request)) is not None
        and (reach := record.reach(request)) is not None
    }


def _describe_acting(scene: Scene, request: PathRequest | ContouringRequest) -> str:
    """Return what is done along a path and what acts there: drives whose loops are closed, and effects;
    nothing where only ideal motors move the machine.
    """
    controlled = [f"{', '.join(scene.drives)} under control"] if scene.drives else []
    acting = [text for effect, text in EFFECTS_ALONG_PATHS.items() if effect in scene.effects]
    return request.describe() + "".join(f", {text}" for text in (*controlled, *acting))


def _plan_contour(machine: PlannedMachine, contour: ContouringRequest, what: str) -> Stage:
    scene, dofs = machine.scene, machine.dofs
    regenerative = contour.regeneration and contour.cutting
    steps = _contour_steps(contour)
    steps *= CONTROLLED_COST if scene.drives and scene.is_lumped else 1.0
    per_step = contour_step_seconds(
        contour.cut,
        # the bodies of a mechanism turn on the way, whatever they bring
        dofs=None if scene.is_lumped else max(dofs, MANY_DOFS if scene.mechanism else 0),
        nonlinear=contour.model == "nonlinear",
        regenerative=regenerative,
    )
    again = _count_repeats(
        machine.components, COMBINED_REFINEMENTS, contour.cut if contour.cutting else None
    )
    again *= contour.estimate
    times = 1.0 + again * (1.0 if regenerative else CONTOUR_AGAIN)
    return Stage(
        "contour",
        None,
        what,
        estimated_memory_mb=contour_memory_mb(_contour_steps(contour)),
        estimated_seconds=times * steps * per_step,
    )


def _count_repeats(
    components: Mapping[str, Component], refinements: Sequence[Refinement], cut: MillingCut | None
) -> int:
    """How often an analysis is repeated for its ±: without each source of error, and for each range of
    the coefficients of its cut.
    """
    ranges = 0 if cut is None else len(cut.coefficients.ranges)
    return len(list_refinements(components, refinements)) + ranges


def _plan_path(machine: PlannedMachine, path: PathRequest, what: str) -> Stage:
    """Return the path, repeated in the pose of the middle for its ±."""
    scene, dofs = machine.scene, machine.dofs
    cut = None if path.cut is None else path.cut.cut
    repeats = path.estimate * _count_repeats(machine.components, SEPARATE_REFINEMENTS, cut)
    samples = [(move.duration + path.residual_time) * path.sampling_hz for move in path.moves]
    # before and after a record a low-pass rests for some of its periods
    rest = 0.0 if path.low_pass is None else 2.0 * PADDING / path.low_pass.frequency_hz
    friction = any(drive.friction is not None for drive in scene.drives.values())
    memory = path_memory_mb(
        max(samples) + rest * path.sampling_hz,
        len(path.outputs),
        friction=friction,
        watched=_count_watched(scene),
    )
    if scene.mechanism is None:
        turns = 0.0
        if friction and path.cut is not None:
            turns = sum(samples) / path.sampling_hz * path.cut.cut.spindle / (2.0 * math.pi)
        seconds = path_seconds(
            samples,
            dofs=dofs,
            friction=friction,
            cut_steps=PATH_STEPS_PER_TURN * turns,
            follows_pose=path.follows_pose,
            repeats=repeats,
        )
        seconds += machine.coupled_seconds
    else:
        bodies = len(scene.machine.components)
        steps = plan_tool_steps(
            path,
            dofs=DOFS_OF_A_BODY * bodies if scene.is_lumped else dofs,
            deforms=not scene.is_lumped and dofs > DOFS_OF_A_BODY * bodies,
            controlled=bool(scene.drives),
            up_to_hz=MODE_MARGIN * path.band_hz,
            repeats=repeats,
        )
        seconds, memory = steps.seconds, memory + steps.memory_mb
    return Stage(
        "path",
        None,
        what,
        estimated_memory_mb=memory,
        estimated_seconds=seconds,
    )


def _count_friction_samples(scene: Scene) -> float:
    """Samples of a transient analysis on which friction acts; none where nothing rubs."""
    request = scene.analyses.get(TransientRequest)
    friction = any(drive.friction is not None for drive in scene.drives.values())
    if request is None or request.motors == "locked" or not friction:
        return 0.0
    return request.duration * request.sampling_hz


def _count_watched(scene: Scene) -> int:
    """What a path watches: forces of joints, force and position of each drive, and displacement and
    stress at probes.
    """
    if scene.mechanism is not None:
        return PROBED * len(scene.machine.probes)  # one joint after the other
    springs = sum(
        bool(joint.stiffness[dof].any())
        for joint in scene.machine.joints.values()
        for dof in range(len(joint.stiffness))
        if dof not in joint.fixed
    )
    return 2 * len(scene.drives) + springs + PROBED * len(scene.machine.probes)


def _contour_steps(request: ContouringRequest) -> float:
    """Time steps of a contour, roughly."""
    seconds = plan_contour(request.contour).path.span[1]
    return seconds * request.cut.spindle / (2.0 * math.pi) * request.steps_per_turn


def _plan_grid(kind: str, per_second: float) -> Callable[[PlannedMachine, Any, str], Stage]:
    def plan(machine: PlannedMachine, request: Any, what: str) -> Stage:
        count = math.prod(len(values) for _, values in request.axes)
        return Stage(kind, None, what, estimated_seconds=count / per_second)

    return plan


def _has_probe_loads(scene: Scene) -> bool:
    """Return whether probes would show anything at rest."""
    machine = scene.machine
    acting = {GRAVITY, "guide_errors"} & {*scene.effects}
    return bool(
        machine.probes
        and (machine.loads or machine.displacements or machine.base_motions or acting)
    )


STAGES, ANSWERS = "headstock.pipeline.stages", "headstock.pipeline.answers"
OTHER_ANSWERS = (
    f"{ANSWERS}.map:MechanismPose",
    f"{ANSWERS}.control:GuardAnswer",
    f"{ANSWERS}.accuracy:AccuracyAnswer",
    f"{ANSWERS}.accuracy:ModelErrorsAnswer",
    f"{ANSWERS}.accuracy:InterfaceErrorsAnswer",
)
# in the order of their stages: those of each pose first
RECORDS: tuple[AnalysisRecord, ...] = (
    AnalysisRecord(
        "static",
        StaticRequest,
        f"{STAGES}.static:run_static_stage",
        f"{ANSWERS}.static:StaticAnswer",
        reason=lambda scene, request: f"compliance at {', '.join(request.at)}",
        dynamic=False,
    ),
    AnalysisRecord(
        "recover",
        StaticRequest,
        f"{STAGES}.probes:run_recover_stage",
        f"{ANSWERS}.probes:ProbeAnswer",
        reason=lambda scene, request: (
            f"displacement and stress at {', '.join(scene.machine.probes)}"
        ),
        dynamic=False,
        asked=_has_probe_loads,
    ),
    AnalysisRecord(
        "modal",
        ModalRequest,
        f"{STAGES}.modal:run_modal_stage",
        f"{ANSWERS}.modal:PoseModes",
        reach=lambda request: request.up_to_hz and (request.up_to_hz, MODE_MARGIN),
        reach_name="modal analysis",
    ),
    AnalysisRecord(
        "frf",
        FrfRequest,
        f"{STAGES}.frf:run_frf_stage",
        f"{ANSWERS}.frf:PoseResponse",
        seconds=lambda machine, request: STAGE_SECONDS["frf"] + machine.coupled_seconds,
        reach=lambda request: (request.to_hz, FRF_MARGIN),
        reach_name="frequency response",
    ),
    AnalysisRecord(
        "control",
        ControlRequest,
        f"{STAGES}.control:run_control_stage",
        f"{ANSWERS}.control:ControlAnswer",
        reason=lambda scene, request: request.describe(tuple(scene.drives)),
        reach=lambda request: (request.up_to_hz, MODE_MARGIN),
        reach_name="control",
    ),
    AnalysisRecord(
        "lobes",
        LobesRequest,
        "headstock.pipeline.lobes.lobes:run_lobes_stage",
        f"{ANSWERS}.lobes:PoseLobes",
        seconds=lambda machine, request: (
            lobes_seconds(request, machine.scene.machine, machine.components, machine.dofs)
            + machine.coupled_seconds
        ),
        reach=lambda request: (request.up_to_hz, MODE_MARGIN),
        reach_name="lobes",
    ),
    AnalysisRecord(
        "respond",
        TransientRequest,
        "headstock.pipeline.motion.transient:run_transient_stage",
        f"{ANSWERS}.transient:TransientAnswer",
        seconds=lambda machine, request: transient_seconds(_count_friction_samples(machine.scene)),
        reach=lambda request: (request.up_to_hz, MODE_MARGIN),
        reach_name="transient analysis",
    ),
    AnalysisRecord(
        "map",
        MapRequest,
        f"{STAGES}.map:run_map_stage",
        f"{ANSWERS}.map:WorkspaceMap",
        stage=_plan_grid("map", POSES_PER_SECOND),
        shared=True,
        dynamic=False,
    ),
    AnalysisRecord(
        "contour",
        ContouringRequest,
        "headstock.pipeline.motion.contouring:run_contour_stage",
        f"{ANSWERS}.contouring:ContourAnswer",
        reason=_describe_acting,
        stage=_plan_contour,
        reach=lambda request: (request.modes_to_hz, MODE_MARGIN),
        reach_name="contour",
    ),
    AnalysisRecord(
        "path",
        PathRequest,
        "headstock.pipeline.motion.path:run_path_stage",
        f"{ANSWERS}.path:PathResult",
        reason=_describe_acting,
        stage=_plan_path,
        reach=lambda request: (request.band_hz, MODE_MARGIN),
        reach_name="path analysis",
    ),
    AnalysisRecord(
        "volumetric",
        VolumetricRequest,
        f"{STAGES}.volumetric:run_volumetric_stage",
        f"{ANSWERS}.volumetric:VolumetricAnswer",
        stage=_plan_grid("volumetric", COUPLINGS_PER_SECOND),
        dynamic=False,
    ),
)

"""What a run found.

Where a closed-loop mechanism stands in a pose, for results.
"""

from dataclasses import dataclass, field

from headstock.geometry.frames import FloatArray, Frame
from headstock.geometry.machine.machine import Pose
from headstock.geometry.mechanisms.exechon import condition_numbers
from headstock.geometry.mechanisms.tool_mechanism import ToolMechanism
from headstock.meshing.component_mesh import MeshQuality
from headstock.pipeline.planning.plan import StageRecord
from headstock.pipeline.results.estimates import Estimate
from headstock.pipeline.results.frf import PoseResponse
from headstock.pipeline.results.path import PathResult
from headstock.pipeline.results.views import MachineView
from headstock.pipeline.storage.json_texts import Json
from headstock.pipeline.storage.provenance import Provenance


@dataclass(frozen=True, eq=False)
class ComponentFacts:
    """What became of a component.

    Attributes:
        fidelity: ``rigid``, ``elastic`` or ``superelement``.
        full_dofs: Dofs before reduction.
        reduced_dofs: Dofs of its superelement.
        mass_kg: Mass [kg].
        cutoff_hz: Its fixed-interface modes are complete up to here; inf for rigid bodies.
        residual: Largest relative residual of its solves.
        quality: Of its mesh; None without one.
    """

    fidelity: str
    full_dofs: int
    reduced_dofs: int
    mass_kg: float
    cutoff_hz: float
    residual: float
    quality: MeshQuality | None = None


@dataclass(frozen=True, eq=False)
class PointCompliance:
    """Static compliance at a named point, tool relative to work, machine axes.

    Attributes:
        compliance: ``(6, 6)`` [m/N, 1/N, 1/(N m)], rows and columns x y z rx ry rz; NaN where a free motion leaves it open.
        budget: Direction x, y, z to share of the compliance per component or joint; shares sum to 1.
        sentence: What it says about the weak link.
        displacement: ``(6,)`` motion under the scene's static loads [m, rad], NaN where a free motion leaves it open; None without loads.
        errors: Direction x, y, z to how far the compliance in it may be off [m/N].
        free_motions: Motions of the machine that nothing holds.
    """

    compliance: FloatArray
    budget: dict[str, dict[str, float]]
    sentence: str = ""
    displacement: FloatArray | None = None
    errors: dict[str, Estimate] = field(default_factory=dict)
    free_motions: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class ProbeResponse:
    """Response of a component to all static loads together at a probe, in machine axes.

    Attributes:
        component: Its name.
        displacement: ``(3,)`` [m].
        stress: ``(3, 3)`` [Pa].
        jump: Largest difference between the stresses of the cells that meet there over their largest entry.
    """

    component: str
    displacement: FloatArray
    stress: FloatArray
    jump: float


@dataclass(frozen=True, eq=False)
class PoseModes:
    """Natural modes of vibration in one pose.

    Attributes:
        pose: Axis positions.
        frequencies_hz: ``(m,)``, rigid-body modes first.
        rigid_count: How many of them are rigid-body modes.
        errors: How far each may be off [Hz].
        damping_ratio: Of each; None without damping.
        damped_hz: Frequency of the damped oscillation [Hz]; zero where it is overdamped, None without damping.
        damped_error_hz: How far each damped frequency may be off [Hz]; None where nobody knows, zero where it is overdamped.
        damping_error: How far each damping ratio may be off; None where nobody knows.
        mode_names: In plain words.
        energy_share: Per mode, share of the strain energy per component or joint.
        kinetic_share: Per mode, share of the kinetic energy per component.
        shapes: ``(n, m)`` mass-normalised, over the dofs of all superelements in the order of ``labels``.
        pose_units: Axis to the unit of its position, ``m`` or ``rad``.
        placements: Frame of each component in the machine in this pose.
        spread_hz: Lowest and highest frequency of each mode with every interface averaging and rigid [Hz]; None where it has no partner,
            empty where none was asked for.
    """

    pose: Pose
    frequencies_hz: FloatArray
    rigid_count: int
    errors: tuple[Estimate, ...]
    damping_ratio: tuple[float | None, ...]
    mode_names: tuple[str, ...]
    energy_share: tuple[dict[str, float], ...]
    kinetic_share: tuple[dict[str, float], ...]
    shapes: FloatArray
    damped_hz: tuple[float | None, ...] = ()
    damped_error_hz: tuple[float | None, ...] = ()
    damping_error: tuple[float | None, ...] = ()
    pose_units: dict[str, str] = field(default_factory=dict)
    placements: dict[str, Frame] = field(default_factory=dict)
    spread_hz: tuple[tuple[float, float] | None, ...] = ()

    @property
    def error_hz(self) -> tuple[float | None, ...]:
        """Estimated error of each frequency, all sources together; None where there is no estimate."""
        return tuple(error.total for error in self.errors)


@dataclass(frozen=True)
class MechanismPose:
    """A closed-loop mechanism in a pose: its coordinates [m, rad] and how well its drives command the wrist centre."""

    coordinates: dict[str, float]
    condition_number: float


@dataclass(frozen=True, eq=False)
class Results:
    """Everything a run found.

    Attributes:
        name: Scene name.
        versions: Of the libraries behind it.
        stages: What ran, in order.
        components: By name.
        static: Pose name to point name to compliance.
        modal: One per pose.
        responses: Frequency responses, one per pose.
        probes: Pose name to probe name to response.
        joint_springs: Joint name to ``(6, 6)`` stiffness in its joint frame [N/m, N m/rad].
        labels: A name for each row of the mode shapes.
        warnings: In plain words.
        failures: Analyses that were refused, with the reason; the others were still computed.
        view: What pictures of the machine are drawn from.
        control: Pose name to closed-loop poles and figures of the drives, as in the summary.
        contouring: Tool gap around a milled block, as in the summary.
        path: Deviation from a path while axes accelerate.
        map: Frequencies, stiffness and condition number over a plane of poses, as in the summary.
        mechanism: Pose name to where a closed-loop mechanism stands; empty without one.
        accuracy: How settings were chosen for an accuracy, as in the summary; None where the scene asks for none.
        files: SHA-256 by file name of what was written beside the summary.
        provenance: Where it comes from; None where nobody said.
    """

    name: str
    versions: dict[str, str]
    stages: tuple[StageRecord, ...]
    components: dict[str, ComponentFacts]
    static: dict[str, dict[str, PointCompliance]]
    modal: tuple[PoseModes, ...]
    joint_springs: dict[str, FloatArray]
    labels: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    failures: tuple[str, ...] = ()
    probes: dict[str, dict[str, ProbeResponse]] = field(default_factory=dict)
    view: MachineView = field(default_factory=MachineView)
    files: dict[str, str] = field(default_factory=dict)
    mechanism: dict[str, MechanismPose] = field(default_factory=dict)
    map: Json | None = None
    contouring: Json | None = None
    path: PathResult | None = None
    control: dict[str, Json] = field(default_factory=dict)
    responses: tuple[PoseResponse, ...] = ()
    accuracy: Json | None = None
    provenance: Provenance | None = None


def describe_state(mechanism: ToolMechanism, state: FloatArray) -> MechanismPose:
    """Coordinates and condition number at a closed state ``(n,)``."""
    known = mechanism.mounted.mechanism
    coordinates = {name: float(state[known.index(name)]) for name in (*known.driven, *known.passive)}
    return MechanismPose(coordinates, float(condition_numbers(known, state)))

"""Error estimates against true errors: reduced machines of very different components by number of
modes, and their unreduced models.
"""

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import scipy.stats

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.geometry.machine.joints import Joint, JointEnd
from headstock.geometry.machine.machine import Machine, Point, Pose
from headstock.geometry.parts.components import (
    Component,
    Interface,
    MeshSettings,
    Patch,
    ReductionSettings,
    Support,
)
from headstock.geometry.parts.solids import HollowColumn, Plate, Solid
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.components.meshing import describe_component, mesh_component
from headstock.pipeline.storage.provenance import PROJECT
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.components.rigid import reduce_rigid
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.estimates.frequency_errors import bound_frequency_errors, truncated_parts
from headstock.reduction.requests import ReductionRequest
from headstock.reduction.superelement import Superelement, Truncation, lowest_participating
from headstock.scene.building.loader import load_scene
from headstock.solvers.elastic.eigenpairs import ModeTarget
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.mpi import MPI
from headstock.validation.machines.monolithic_machines import (
    MonolithicMachine,
    fix_carriages,
    monolithic_frequencies,
    monolithic_machine,
    view_carriages,
)
from headstock.validation.parts.closed_form_cases import (
    COLUMN_SIZE,
    STEEL,
    column,
    face_interface,
    mesh_settings,
)
from headstock.validation.parts.component_models import fixed_by, full_model, full_modes
from headstock.validation.references.rows import (
    Target,
    ValidationRow,
    compare_bound,
    compare_value,
    show,
)

MACHINES = PROJECT / "machines"
MOUNT = np.diag([2e8, 2e8, 4e8, 2e5, 2e5, 2e5])
CLAMP = np.diag([5e9, 5e9, 5e9, 5e6, 5e6, 5e6])
MODE_COUNTS = (0, 3, 6, 10, 16, 25, 40)
WATCHED = 14
SHIFT_HZ = 20.0
COVERED = 0.95  # share of the true errors that an estimate must not be below
LARGEST_MEDIAN = 10.0  # times too large in the median
LEAST_CORRELATION = 0.8
# relative: the unreduced three-axis machine comes out 1.3e-8 off throughout, beside its air springs
RESOLVED = 3e-8
CLEAR = 1e-6  # and above which a ratio of errors means something


@dataclass(frozen=True, eq=False)
class Specimen:
    """A machine in a pose with the meshes of its elastic components."""

    name: str
    machine: Machine
    pose: Pose
    meshes: dict[str, ComponentMesh]
    point: str

    @property
    def rigid(self) -> dict[str, Superelement]:
        """Superelements of the components that are not meshed."""
        parts = self.machine.components
        return {
            name: reduce_rigid(part, describe_component(part))
            for name, part in parts.items()
            if name not in self.meshes
        }


def unreduced(specimen: Specimen) -> MonolithicMachine:
    """Return the machine with every node of its meshes."""
    machine, pose, meshes = specimen.machine, specimen.pose, specimen.meshes
    if not any(joint.length for joint in machine.joints.values()):
        return monolithic_machine(machine, meshes, pose)
    return monolithic_machine(
        fix_carriages(machine, pose), meshes, pose, views=view_carriages(machine, meshes, pose)
    )


def keep_fewer(element: Superelement, count: int) -> Superelement:
    """Return the superelement as it would have been with fewer modes, and the moments of those it
    leaves out then.

    Unlike ``trim_superelement`` it cuts through clusters of close frequencies: the estimates must
    hold for such a basis too.
    """
    boundary, size = element.boundary_size, element.boundary_size + count
    if element.errors.truncation is None or count >= element.modal_count:
        return element
    left = element.mass[:boundary, size:]
    eigenvalues = (2.0 * np.pi * element.modal_frequencies_hz[count:]) ** 2
    first = element.errors.truncation.first + (left / eigenvalues) @ left.T
    second = element.errors.truncation.second + (left / eigenvalues**2) @ left.T
    limit = float(eigenvalues[0]) if count else lowest_participating(first, second)
    return dataclasses.replace(
        element,
        labels=element.labels[:size],
        stiffness=element.stiffness[:size, :size],
        mass=element.mass[:size, :size],
        constraints=element.constraints[:, :size],
        recovery=None,
        modal_frequencies_hz=element.modal_frequencies_hz[:count],
        cutoff_hz=float(element.modal_frequencies_hz[count]) if count else 0.0,
        errors=dataclasses.replace(element.errors, truncation=Truncation(first, second, limit)),
        rails={
            name: dataclasses.replace(rail, control=rail.control[:, :size])
            for name, rail in element.rails.items()
        },
    )


def clamped_beam() -> Specimen:
    """Return the column of Kono et al. on a stiff clamp, rigid faces."""
    interfaces = {
        name: face_interface(name, face, "rigid") for name, face in (("foot", "z-"), ("tip", "z+"))
    }
    part = column(mesh_settings("tet10", 0.025), interfaces)
    return _specimen(
        "beam", {"column": part}, {"clamp": _spring("clamp", "column.foot", CLAMP)}, "column.tip"
    )


def patched_column() -> Specimen:
    """Return a hollow column with round and square averaging patches on two sides, free at its top."""
    size = (0.20, 0.24, 0.70)
    interfaces = {
        "foot": Interface("foot", (Patch("z-"),), "average"),
        "rail": Interface(
            "rail", (Patch("x+", "rect", (size[0] / 2, 0.06, 0.55), (0.05, 0.08)),), "average"
        ),
        "other": Interface(
            "other", (Patch("x+", "rect", (size[0] / 2, -0.06, 0.55), (0.05, 0.08)),), "average"
        ),
        "screw": Interface(
            "screw", (Patch("y+", "disk", (0.0, size[1] / 2, 0.35), (0.06,)),), "rigid"
        ),
    }
    part = _component("column", HollowColumn(size, 0.012, 0.015, 0.01, ribs_z=2), interfaces, 0.05)
    joints = {
        "base": _spring("base", "column.foot", MOUNT),
        "drive": _spring("drive", "column.screw", 0.2 * MOUNT),
    }
    return _specimen("hollow column", {"column": part}, joints, "column.rail")


def ribbed_plate() -> Specimen:
    """Return a ribbed plate on four rigid feet, seen at a disk in its middle."""
    corners = {
        "foot_1": (0.24, 0.16),
        "foot_2": (-0.24, 0.16),
        "foot_3": (-0.24, -0.16),
        "foot_4": (0.24, -0.16),
    }
    interfaces = {
        name: Interface(name, (Patch("z-", "disk", (x, y, 0.0), (0.05,)),), "rigid")
        for name, (x, y) in corners.items()
    }
    interfaces["table"] = Interface(
        "table", (Patch("z-", "disk", (0.0, 0.0, 0.0), (0.08,)),), "average"
    )
    part = _component(
        "plate", Plate((0.6, 0.4, 0.02), 0.05, 0.015, ribs_x=2, ribs_y=3), interfaces, 0.05
    )
    joints = {name: _spring(name, f"plate.{name}", MOUNT) for name in corners}
    return _specimen("ribbed plate", {"plate": part}, joints, "plate.table")


def free_pair() -> Specimen:
    """Two of the column of Kono et al.s, one on the other, with nothing to hold them: six rigid motions."""
    lower = column(
        mesh_settings("hex27", 0.05),
        {
            "foot": face_interface("foot", "z-", "rigid"),
            "top": face_interface("top", "z+", "average"),
        },
    )
    upper = dataclasses.replace(
        column(
            mesh_settings("hex27", 0.05),
            {
                "bottom": face_interface("bottom", "z-", "average"),
                "tip": face_interface("tip", "z+", "rigid"),
            },
        ),
        name="upper",
    )
    placed = dataclasses.replace(
        upper,
        placement=dataclasses.replace(upper.placement, origin=np.array([0.0, 0.0, COLUMN_SIZE[2]])),
    )
    ends = (JointEnd("column", "top"), JointEnd("upper", "bottom"))
    joints = {"bolt": Joint("bolt", ends, "spring", stiffness=0.2 * CLAMP)}
    return _specimen("free pair", {"column": lower, "upper": placed}, joints, "upper.tip")


def _cast_column() -> Specimen:
    """Return the shipped column from a STEP file alone, fixed at its foot by a support; averaging
    patches for rails and screw.
    """
    part = load_scene(MACHINES / "step_column.toml").machine.components["column"]
    patches = {
        name: interface
        for name, interface in part.interfaces.items()
        if interface.coupling == "average"
    }
    part = dataclasses.replace(part, interfaces=patches)
    support = Support("foot", "column", (Patch("z-"),), ("x", "y", "z"))
    machine = Machine("STEP column", {"column": part}, supports={"foot": support})
    return Specimen(
        "STEP column", machine, Pose("reference"), {"column": mesh_component(part, (support,))}, ""
    )


def guideway() -> Specimen:
    """Return the shipped table on rails, far from the bearing."""
    return _shipped("guideway", "guideway.toml", "far")


def three_axis() -> Specimen:
    """Return the shipped three-axis machine with three elastic components."""
    return _shipped("three-axis machine", "three_axis.toml", None)


SPECIMENS: tuple[Callable[[], Specimen], ...] = (
    clamped_beam,
    patched_column,
    ribbed_plate,
    free_pair,
    guideway,
    three_axis,
)


def _component(name: str, solid: Solid, interfaces: dict[str, Interface], size: float) -> Component:
    settings = MeshSettings(size=size, order=2, cells="tet")
    return Component(
        name,
        solid,
        STEEL,
        interfaces=interfaces,
        mesh=settings,
        reduction=ReductionSettings(modes=0),
    )


def _spring(name: str, end: str, stiffness: FloatArray) -> Joint:
    component, interface = end.split(".")
    return Joint(name, (JointEnd(), JointEnd(component, interface)), "spring", stiffness=stiffness)


def _specimen(
    name: str, parts: dict[str, Component], joints: dict[str, Joint], tool: str
) -> Specimen:
    component, interface = tool.split(".")
    points = {"tcp": Point("tcp", JointEnd(component, interface), JointEnd())}
    meshes = {key: mesh_component(part) for key, part in parts.items()}
    return Specimen(name, Machine(name, parts, joints, points), Pose("reference"), meshes, "tcp")


def _shipped(name: str, file: str, pose: str | None) -> Specimen:
    scene = load_scene(MACHINES / file)
    meshes = {
        key: mesh_component(part)
        for key, part in scene.machine.components.items()
        if part.fidelity == "elastic"
    }
    return Specimen(
        name,
        scene.machine,
        scene.poses[pose] if pose else next(iter(scene.poses.values())),
        meshes,
        "tcp",
    )


@dataclass(frozen=True, eq=False)
class ErrorPairs:
    """True errors and their estimates, relative to the value, ``(n,)`` each; NaN where no estimate
    was given.
    """

    true: FloatArray
    estimated: FloatArray

    @property
    def given(self) -> BoolArray:
        """Those with an estimate."""
        return np.isfinite(self.estimated)

    @property
    def clear(self) -> BoolArray:
        """Those with one, and a true error well above the roundoff of both methods."""
        return self.given & (self.true > CLEAR)


def check_frequency_estimates() -> Iterator[ValidationRow]:
    """Bounds of the reduction error of natural frequencies over machines of six kinds and numbers
    of modes from none to forty.
    """
    found = []
    for make in SPECIMENS:
        specimen = make()
        pairs = _compare_frequencies(
            specimen, monolithic_frequencies(unreduced(specimen), WATCHED, shift_hz=SHIFT_HZ)
        )
        yield report_coverage(specimen.name, pairs)
        found.append(pairs)
    yield from evaluate_pairs("all", join_pairs(found))


def check_step_estimates() -> Iterator[ValidationRow]:
    """Check the same for a column from a STEP file with 195 000 dofs, against whole-mesh modes."""
    specimen = _cast_column()
    part = specimen.machine.components["column"]
    mesh = specimen.meshes["column"]
    supports = specimen.machine.supports
    whole = full_model(
        mesh, part.material, comm=MPI.COMM_SELF, fixed=fixed_by(mesh, tuple(supports.values()))
    )
    pairs = _compare_frequencies(specimen, full_modes(whole, WATCHED).frequencies_hz)
    yield report_coverage(specimen.name, pairs)
    yield from evaluate_pairs(specimen.name, pairs)


def _compare_frequencies(specimen: Specimen, exact: FloatArray) -> ErrorPairs:
    """True and estimated errors of the lowest elastic frequencies of a machine for every number of
    modes.
    """
    whole = reduce_specimen(specimen, max(MODE_COUNTS))
    pairs = []
    for count in MODE_COUNTS:
        parts = {
            name: keep_fewer(element, count) for name, element in whole.items()
        } | specimen.rigid
        coupled = couple(parts, specimen.machine, specimen.pose)
        modes = solve_modal(coupled.system, count=min(WATCHED, len(coupled.system.mass)))
        errors = bound_frequency_errors(coupled.system, truncated_parts(coupled), modes)
        kept = slice(modes.rigid_count, len(modes.frequencies_hz))
        right = exact[: len(modes.frequencies_hz)][kept]
        pairs.append(
            ErrorPairs(modes.frequencies_hz[kept] / right - 1.0, errors.bounds_hz[kept] / right)
        )
    return join_pairs(pairs)


def reduce_specimen(specimen: Specimen, count: int) -> dict[str, Superelement]:
    """Superelements of the elastic components with so many modes."""
    request = ReductionRequest(ModeTarget(count=count), recovery=False)
    parts, supports = specimen.machine.components, tuple(specimen.machine.supports.values())
    return {
        name: reduce_elastic(parts[name], mesh, supports, comm=MPI.COMM_SELF, request=request)
        for name, mesh in specimen.meshes.items()
    }


def join_pairs(parts: list[ErrorPairs]) -> ErrorPairs:
    """Join pairs of errors."""
    return ErrorPairs(
        np.concatenate([part.true for part in parts]),
        np.concatenate([part.estimated for part in parts]),
    )


def evaluate_pairs(what: str, pairs: ErrorPairs) -> list[ValidationRow]:
    """Rows for coverage, size and rank correlation of estimates.

    Args:
        what: Beginning of the rows' names.
        pairs: True and estimated errors.
    """
    given, clear = pairs.given, pairs.clear
    missed = float(np.mean(pairs.true[given] > pairs.estimated[given] + RESOLVED))
    ratio = float(np.median(pairs.estimated[clear] / pairs.true[clear]))
    correlation = float(scipy.stats.spearmanr(pairs.true[clear], pairs.estimated[clear]).statistic)
    note = f"{given.sum()} of {len(given)} have an estimate"
    return [
        compare_bound(
            f"{what}: share of true errors above their estimate", missed, 1.0 - COVERED, note
        ),
        compare_bound(
            f"{what}: estimate over true error, median",
            ratio,
            LARGEST_MEDIAN,
            f"{clear.sum()} errors above {CLEAR:g}",
        ),
        compare_value(
            f"{what}: rank correlation",
            correlation,
            Target(1.0, "-", 1.0 - LEAST_CORRELATION, "identity"),
        ),
    ]


def report_coverage(name: str, pairs: ErrorPairs) -> ValidationRow:
    """Return a row for the share of true errors that their estimate covers, and how much too large
    it is.

    Args:
        name: What was estimated, and of which part.
        pairs: True and estimated errors, in one unit.
    """
    given, clear = pairs.given, pairs.clear
    covered = float(np.mean(pairs.true[given] <= pairs.estimated[given] + RESOLVED))
    ratios = pairs.estimated[clear] / pairs.true[clear]
    low, middle, high = np.quantile(ratios, [0.1, 0.5, 0.9]) if len(ratios) else (np.nan,) * 3
    note = f"{given.sum()} of {len(given)} with an estimate; estimate over true {low:.2f} .. {middle:.2f} .. {high:.2f}"
    return show(
        f"{name}: share covered",
        covered,
        "-",
        f"{note} (10, 50, 90 %); true up to {pairs.true[given].max():.2g}",
    )

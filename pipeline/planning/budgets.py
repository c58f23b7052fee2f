"""Estimates of dofs, memory and time before anything is computed, checked against the limits of the
scene and the machine.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.errors import HeadstockError
from headstock.geometry.machine.machine import Machine
from headstock.geometry.parts.components import Component, MeshSettings, weigh_modes
from headstock.geometry.parts.solids import Box
from headstock.meshing.sizing import CELL_BUDGET
from headstock.pipeline.planning.plan import Stage
from headstock.scene.analyses.lobes import LobesRequest
from headstock.scene.analyses.path import PathRequest
from headstock.solvers.milling.border import DENSE
from headstock.solvers.milling.forces import MillingCut
from headstock.solvers.milling.windows import MOST_ROWS

# Nodes per cell of an endless mesh, and how much its surface adds: 1 + share / cells^(1/3);
# measured on blocks, within a quarter.
NODES_PER_CELL = {
    ("tet", 1): (0.18, 7.0),
    ("tet", 2): (1.38, 4.7),
    ("hex", 1): (1.0, 2.4),
    ("hex", 2): (8.0, 2.4),
}
# Measured on steel blocks of 20k to 1M dofs with one MUMPS factorisation and 32 reduced dofs: 0.26,
# 1.2, 4.0, 17.7 GB.
REFERENCE_DOFS = 100_000
REFERENCE_MB = 1100.0
MEMORY_EXPONENT = 1.2
BASE_MB = 130.0
COPIES_OF_BASIS = 2
# CPU seconds of assembly, factorisation and errors at 100k dofs, and per dof and reduced dof, on
# one core of a virtual AMD EPYC: the shipped scenes (11k to 223k dofs, 14 to 236 reduced ones, tets
# and hexes) took 0.7 to 1.4 times as long (benchmarks/plan.py)
REFERENCE_SECONDS = 4.2
SECONDS_EXPONENT = 1.4
SECONDS_PER_ENTRY = 6e-7
# iterating takes no factors: operators twice and one cycle [kB per dof], and for each vector that is
# iterated three times three others; seconds as above, of 100k and 300k dofs (benchmarks/large_parts.py)
ITERATIVE_KB_PER_DOF = 2.4
ITERATED_COPIES = 9
ITERATIVE_SECONDS_PER_ENTRY = 5.8e-6
# of generating and compiling the kernel of one matrix of a cell, with the start of the compiler in
# those of stiffness; on the same core (benchmarks/kernels.py)
KERNEL_SECONDS = {
    "stiffness-tet4": 0.5,
    "stiffness-tet10": 1.0,
    "stiffness-tet10-curved": 5.2,
    "stiffness-hex8": 1.2,
    "stiffness-hex27": 2.1,
    "mass-tet4": 0.2,
    "mass-tet10": 0.2,
    "mass-tet10-curved": 1.0,
    "mass-hex8": 0.9,
    "mass-hex27": 0.2,
    "corners-tet10": 0.6,
    "corners-tet10-curved": 0.6,
    "corners-hex27": 1.1,
}
MESHING_SECONDS_PER_DOF = {"tet": 2e-5, "hex": 1e-6}
MESHING_START = {"tet": 0.3, "hex": 0.03}
STAGE_SECONDS = {
    "segment": 0.01,
    "expand": 0.3,
    "place": 0.005,
    "recover": 0.5,
    "models": 0.3,
    "joints": 0.3,
    "fit": 0.3,
    "frf": 0.08,
    "control": 0.06,
    "respond": 0.3,
}
# at no dofs of the coupled machine, and per dof: three to nine bodies of 18 to 384 dofs, as above
SECONDS_OF_DOFS = {
    "couple": (0.006, 1e-4),
    "static": (0.004, 7e-5),
    "modal": (0.005, 2.5e-4),
    "lobes": (0.1, 5e-4),
}
# per cube of dofs where damping couples the modes, of a frequency response, lobes and a path alike: the mill of
# machines/mill.toml (467 dofs) took 3.1, 3.2 and 2.5 s, on a core of a virtual Intel Xeon
SECONDS_PER_COUPLED_CUBE = 2.5e-8
# of a limit: multipliers that find it where speeds are dense and where they are not, those that its ± adds
# where bodies are finite elements, and their time by the rows of a matrix over a tooth period, two of each pole besides.
# Where the tool's body deforms its modes are followed, too, so many times as high as those that are asked for. Poles
# are some of the springs and a share of the dofs; segments bring few. The three-axis machine (800 limits) rigid,
# segmented and of finite elements and machines/mill.toml (32) rigid and of finite elements took 0.9 to 1.6 times
# as long, on a busy core of a virtual Intel Xeon
DENSE_MULTIPLIERS, SPARSE_MULTIPLIERS, ELASTIC_MULTIPLIERS = 10, 24, 8
FEWEST_POLES, POLES_PER_DOF, FASTER_TOOL = 10.0, 0.2, 2.2
SECONDS_PER_ROW, SECONDS_PER_CUBIC_ROW = 9e-6, 2e-10
WRITE_START, SECONDS_PER_DRAWN_BODY = 0.025, 0.002
DOFS_OF_A_BODY = 6
STEPS_PER_SECOND = 3e4  # of a contour of a lumped mechanism
# of a machine of components in its modes: up to the number of its dofs from which more add no modes
# below the frequency up to which they are kept (elastic legs of the Tripteor up to 1 kHz, 41 modes), and
# the share of a machine of hardly any; friction at the speeds of the motors; and what each tooth in the
# cut adds that meets the waves of those before. A mill of three bodies (18 dofs), the three-axis machine
# rigid (42), of elastic columns (110) and segmented (384) and the Tripteor, blocks of 5 to 200 mm, on a
# core of a virtual AMD EPYC took 0.6 to 1.0 times as long; a core whose other thread is busy takes twice
# as long
COUPLED_STEPS_PER_SECOND = 1.2e4
MANY_DOFS, FEW_SHARE = 250, 1.0 / 3.0
COUPLED_NONLINEAR_STEPS_PER_SECOND = 7e3
SECONDS_PER_WAVY_TOOTH = 5e-4
# of a lumped one with waves of the teeth before, with the full equations, and with both; with the
# other thread of the core busy
REGENERATIVE_STEPS_PER_SECOND = 7e3
NONLINEAR_STEPS_PER_SECOND = 900.0
BOTH_STEPS_PER_SECOND = 420.0
# a lumped contour whose drives are under control takes so many times as long (1.2 to 1.5, as above)
CONTROLLED_COST = 1.5
# a contour that is repeated for its ± takes this share, since its machine is looked at in a few poses only and
# what is rigid is known (the Tripteor with elastic legs: 0.4 and 0.5); all of it where waves take the time
CONTOUR_AGAIN = 0.5
# of a path: at no dofs of the coupled machine and per dof, for the poses on the way; per sample in its
# modes. The three-axis machine rigid (42), of finite elements (97) and segmented (426), 4 500 to
# 600 000 samples, on a core of a virtual AMD EPYC: within a third
PATH_START, SECONDS_PER_PATH_DOF = 0.1, 2.2e-3
PATH_SAMPLES_PER_SECOND = 4.5e4
# with friction per move and per sample, or with a cut per step of the teeth's forces, where guides that turn back make
# steps shorter; along the poses of the way once more, and that many times as long. The three-axis machine
# rigid, 4 800 to 120 000 samples and 6 700 steps of a cut
SECONDS_PER_RUBBING_MOVE, SECONDS_PER_RUBBING_PATH_SAMPLE = 0.2, 1e-4
SECONDS_PER_RUBBING_CUT_STEP = 1.6e-3
RUBBING_ALONG = 2.2
# a repeat without friction takes all modes of an elastic machine: so many times a path of a rigid one (13 000
# and 121 000 samples, on a busy core)
SECONDS_AGAIN = 3.0
KEPT_FOR_REPEATS = 2.1  # times the memory: moves are kept until they are compared
RICHER = 1.3  # a machine with the modes that are left out, among those repeated, as a share more
# of the tool of a mechanism per swing of the highest mode, which lies somewhat above the frequency up to
# which modes are kept, and as many modes as dofs per so much of it. The Tripteor, lumped, of rigid legs and of
# finite elements (363 dofs, 45 modes up to 960 Hz), with and without control, 20 000 to 150 000 steps
TOOL_STEPS_PER_SWING, HZ_PER_MODE_AND_DOF = 29.0, 8e3
SECONDS_PER_TOOL_STEP, SECONDS_PER_TOOL_STEP_AND_MODE = 2e-5, 1.5e-6
TOOL_KB_PER_STEP_AND_MODE = 0.075
PATH_STEPS_PER_TURN = 96  # of the spindle along a path: forces of the cut are straight between them
# of its longest move, for one output and each further one; likewise, 4 500 to 1 200 000 samples
PATH_MB, PATH_KB_PER_SAMPLE, PATH_KB_PER_OUTPUT, FRICTION_KB_PER_SAMPLE = 60.0, 0.82, 0.07, 2.0
PATH_KB_PER_WATCHED = 0.009  # force, displacement or stress on the way
# of a transient analysis with friction, five to six times for ±, in a pose and per sample: the three-axis
# machine and the lumped Tripteor, 2 000 samples, and a slide on a bed of finite elements, 801 samples that
# stick and slip, within half and twice
FRICTION_START, SECONDS_PER_FRICTION_SAMPLE = 0.4, 2.2e-4
POSES_PER_SECOND = 7e3  # of a map
COUPLINGS_PER_SECOND = 60.0  # of a volumetric map
MOST_GUESSED_MODES = 300
LARGEST_BLOCK = 40  # of vectors that are iterated together
CONTROL_POINT_DOFS = 4
# estimates are refused only where they exceed the limit by more than their own error; the run
# itself stops at the limit
TIME_MARGIN = 2.0
# of a path or contour, beyond which a slip of a key is likelier than patience; limits.time says
# otherwise [s]
MOST_PATH_SECONDS = 4.0 * 3600.0
PATH_KEYS = {
    "path": "write a lower sampling, higher feeds, a shorter residual_time or a higher lowpass in [analyses.path]",
    "contour": "write a slower spindle, fewer steps_per_turn or a faster feed in [analyses.contouring]",
}
# of a contour per step in time, three-axis machine rigid, 29 000 to 600 000 steps
CONTOUR_KB_PER_STEP = 0.6


def contour_step_seconds(
    cut: MillingCut, *, dofs: int | None, nonlinear: bool, regenerative: bool
) -> float:
    """Processor time of a time step of a contour [s].

    Args:
        dofs: Of the coupled machine; None of a lumped mechanism.
        nonlinear: The full equations, or friction at the speeds of the motors.
        regenerative: Teeth meet the waves of those before.
    """
    if dofs is None:
        if nonlinear:
            return 1.0 / (BOTH_STEPS_PER_SECOND if regenerative else NONLINEAR_STEPS_PER_SECOND)
        return 1.0 / (REGENERATIVE_STEPS_PER_SECOND if regenerative else STEPS_PER_SECOND)
    share = FEW_SHARE + (1.0 - FEW_SHARE) * min(1.0, dofs / MANY_DOFS)
    moving = share / COUPLED_STEPS_PER_SECOND
    if nonlinear:
        moving = 1.0 / COUPLED_NONLINEAR_STEPS_PER_SECOND
    return moving + (SECONDS_PER_WAVY_TOOTH * _count_teeth_in_cut(cut) if regenerative else 0.0)


def path_seconds(
    samples: Sequence[float],
    *,
    dofs: int,
    friction: bool,
    cut_steps: float = 0.0,
    follows_pose: bool = False,
    repeats: int = 0,
) -> float:
    """Processor time of a path of axes [s].

    Args:
        friction: Guides of drives under control have friction.
        cut_steps: Of the forces of a cut with friction; none elsewhere.
        follows_pose: It goes through the poses along the path, too.
    """
    start = PATH_START + SECONDS_PER_PATH_DOF * dofs
    # what is to be compared in that pose is computed in it, too
    again = repeats + (follows_pose if repeats else 0)
    if not friction:
        once = sum(samples) / PATH_SAMPLES_PER_SECOND
        return start + once * (1.0 + SECONDS_AGAIN * again)
    once = len(samples) * SECONDS_PER_RUBBING_MOVE
    once += sum(samples) * SECONDS_PER_RUBBING_PATH_SAMPLE
    once += SECONDS_PER_RUBBING_CUT_STEP * cut_steps
    return start + once * (1.0 + RUBBING_ALONG * follows_pose + again)


@dataclass(frozen=True)
class _ToolSteps:
    """Steps in time of a path of a mechanism's tool: in a frozen pose, in those along the path, and in a
    frozen one with modes up to twice the frequency.

    Attributes:
        follows_pose: It goes through the poses along the path, too.
        truncated: Modes are left out, whose share in the error is estimated.
        controlled: Its legs are under control.
    """

    steps: float
    modes: float
    follows_pose: bool
    truncated: bool
    controlled: bool
    repeats: int

    @property
    def seconds(self) -> float:
        """Processor time [s]."""
        found = (1.0 + self.follows_pose) * self.steps * _tool_step_seconds(self.modes)
        if self.follows_pose and self.truncated:
            found += 2.0 * self.steps * _tool_step_seconds(2.0 * self.modes)
        if self.repeats:
            again = self.repeats + self.follows_pose + RICHER
            found += again * self.steps * _tool_step_seconds(self.modes)
        return PATH_START + found

    @property
    def memory_mb(self) -> float:
        """Peak memory, beside that of a path of axes [MB]."""
        times = 4.0 if self.follows_pose and self.truncated else 1.0
        times *= KEPT_FOR_REPEATS if self.repeats else 1.0
        states = TOOL_KB_PER_STEP_AND_MODE * (1.0 + self.controlled)
        return 1e-3 * times * states * self.steps * self.modes


def plan_tool_steps(
    request: PathRequest,
    *,
    dofs: int,
    deforms: bool,
    controlled: bool,
    up_to_hz: float,
    repeats: int,
) -> _ToolSteps:
    """Return how far a path of a mechanism's tool goes in time.

    Args:
        deforms: Bodies deform, so that more modes are there than are kept.
        controlled: Its legs are under control.
        up_to_hz: Modes kept [Hz].
    """
    rate = TOOL_STEPS_PER_SWING * up_to_hz
    if request.cut is not None:
        rate = max(rate, PATH_STEPS_PER_TURN * request.cut.cut.spindle / (2.0 * math.pi))
    seconds = sum(move.duration + request.residual_time for move in request.moves)
    modes = min(float(dofs), dofs * up_to_hz / HZ_PER_MODE_AND_DOF)
    return _ToolSteps(
        steps=rate * seconds,
        modes=modes,
        follows_pose=request.follows_pose,
        truncated=deforms,
        controlled=controlled,
        repeats=repeats,
    )


def _tool_step_seconds(modes: float) -> float:
    return SECONDS_PER_TOOL_STEP + SECONDS_PER_TOOL_STEP_AND_MODE * modes


def transient_seconds(friction_samples: float) -> float:
    """Processor time of a transient analysis in a pose [s].

    Args:
        friction_samples: How many there are of motion with friction; none without it.
    """
    start = STAGE_SECONDS["respond"]
    if not friction_samples:
        return start
    return start + FRICTION_START + SECONDS_PER_FRICTION_SAMPLE * friction_samples


def contour_memory_mb(steps: float) -> float:
    """Peak memory of a contour of so many time steps [MB]."""
    return BASE_MB + PATH_MB + 1e-3 * CONTOUR_KB_PER_STEP * steps


def path_memory_mb(samples: float, outputs: int, *, friction: bool, watched: int = 0) -> float:
    """Peak memory of a path [MB].

    Args:
        outputs: Where its deviation is wanted.
        friction: Guides of drives under control have friction.
        watched: Forces, displacements and stresses that are watched on the way.
    """
    own = FRICTION_KB_PER_SAMPLE if friction else PATH_KB_PER_SAMPLE
    kilobytes = own + PATH_KB_PER_OUTPUT * (outputs - 1) + PATH_KB_PER_WATCHED * watched
    return BASE_MB + PATH_MB + 1e-3 * kilobytes * samples


def _count_teeth_in_cut(cut: MillingCut) -> float:
    """Teeth that cut at a time, in the mean."""
    mill = cut.mill
    arc = math.acos(1.0 - 2.0 * min(cut.radial_depth / mill.diameter, 1.0))
    lag = 2.0 * cut.axial_depth * math.tan(abs(mill.helix)) / mill.diameter
    return mill.teeth * (arc + lag) / (2.0 * math.pi)


def pose_seconds(kind: str, dofs: int) -> float | None:
    """Processor time of a stage in a pose [s]; None where nothing can be said beforehand."""
    if kind in SECONDS_OF_DOFS:
        start, slope = SECONDS_OF_DOFS[kind]
        return start + slope * dofs
    return STAGE_SECONDS.get(kind)


def lobes_seconds(
    request: LobesRequest, machine: Machine, components: Mapping[str, Component], dofs: int
) -> float:
    """Processor time of the lobes in a pose [s], where damping couples no modes.

    Args:
        machine: With the point that cuts.
        components: As they are planned.
        dofs: Of the coupled machine.
    """
    parts = components.values()
    segments = sum(part.segments.count for part in parts if part.fidelity == "segmented")
    poles = FEWEST_POLES + POLES_PER_DOF * max(0, dofs - DOFS_OF_A_BODY * segments)
    sensor = machine.sensors.get(request.at)
    carrier = machine.points[request.at].carrier if sensor is None else sensor
    tool = components.get(carrier.component or "")
    faster = FASTER_TOOL if tool is not None and tool.fidelity != "rigid" else 1.0
    own = np.array([request.rows_at(float(speed), faster=faster) for speed in request.speeds])
    rows = own + 2.0 * poles
    each = SECONDS_PER_ROW * rows + SECONDS_PER_CUBIC_ROW * rows**3
    start, slope = SECONDS_OF_DOFS["lobes"]
    # waves between two teeth change so much from speed to speed, at most
    periods = 2.0 * np.pi / (request.mill.teeth * request.checked * request.speeds)
    apart = request.highest_hz * np.abs(np.diff(periods)).max(initial=0.0)
    tries = DENSE_MULTIPLIERS if apart < DENSE else SPARSE_MULTIPLIERS
    if any(part.fidelity == "elastic" for part in parts):
        tries += ELASTIC_MULTIPLIERS
    limits = request.checked * len(request.directions) * tries
    return float(start + slope * dofs + limits * each[rows < MOST_ROWS].sum())


def kernel_seconds(name: str) -> float:
    """Processor time of compiling a kernel [s]; the longest of them where nobody measured it.

    Args:
        name: Of the kernel, see ``kernel_name``.
    """
    return KERNEL_SECONDS.get(name, max(KERNEL_SECONDS.values()))


def write_seconds(components: int, poses: int) -> float:
    """Processor time of writing results [s]."""
    return WRITE_START + SECONDS_PER_DRAWN_BODY * components * poses


def reduced_dofs(component: Component, volume: float | None) -> int:
    """Dofs that a component brings to the machine, roughly.

    Args:
        volume: Of the component [m^3], to guess how many modes lie below a frequency.
    """
    if component.fidelity == "rigid":
        return DOFS_OF_A_BODY
    if component.fidelity == "segmented":
        return DOFS_OF_A_BODY * component.segments.count
    return _boundary_dofs(component) + _guess_modes(component, volume)


class BudgetError(HeadstockError):
    """A scene asks for more than the machine or its own limits allow; nothing has been computed."""


def displacement_dofs(cells: int, settings: MeshSettings) -> int:
    """Displacement dofs of a mesh with so many cells."""
    nodes, surface_share = NODES_PER_CELL[settings.cells, settings.order]
    return round(3 * nodes * cells * (1.0 + surface_share / float(max(cells, 1) ** (1.0 / 3.0))))


def mesh_memory_mb(dofs: int) -> float:
    """Peak memory of meshing [MB]: about 1 kB per dof in the mesher."""
    return BASE_MB + dofs / 1000.0


def reduction_memory_mb(dofs: int, component: Component) -> float:
    """Peak memory of assembly, factorisation and reduction [MB]; grows like ``n^1.2`` with a sparse
    direct solver in 3D.
    """
    vectors = _vector_count(component)
    factor = REFERENCE_MB * float((dofs / REFERENCE_DOFS) ** MEMORY_EXPONENT)
    return BASE_MB + factor + COPIES_OF_BASIS * 8e-6 * dofs * vectors


def mesh_seconds(dofs: int, settings: MeshSettings) -> float:
    """Processor time of meshing [s]."""
    return MESHING_START[settings.cells] + MESHING_SECONDS_PER_DOF[settings.cells] * dofs


def reduction_seconds(dofs: int, component: Component, volume: float | None = None) -> float:
    """Processor time of assembly, factorisation and reduction [s].

    Args:
        volume: Of the component [m^3], to guess how many modes lie below a frequency.
    """
    reduced = reduced_dofs(component, volume)
    return (
        REFERENCE_SECONDS * float((dofs / REFERENCE_DOFS) ** SECONDS_EXPONENT)
        + SECONDS_PER_ENTRY * dofs * reduced
    )


def iterative_memory_mb(dofs: int, component: Component) -> float:
    """Peak memory of assembly and reduction without a factorisation [MB]."""
    kept = COPIES_OF_BASIS * 8e-6 * dofs * _vector_count(component)
    block = min(1.15 * (component.reduction.modes or LARGEST_BLOCK) + 1.0, LARGEST_BLOCK)
    iterated = ITERATED_COPIES * 8e-6 * dofs * block
    return BASE_MB + 1e-3 * ITERATIVE_KB_PER_DOF * dofs + iterated + kept


def iterative_seconds(dofs: int, component: Component, volume: float | None = None) -> float:
    """Processor time of assembly and reduction without a factorisation [s]; see
    ``reduction_seconds``.
    """
    reduced = reduced_dofs(component, volume)
    return REFERENCE_SECONDS * dofs / REFERENCE_DOFS + ITERATIVE_SECONDS_PER_ENTRY * dofs * reduced


def _boundary_dofs(component: Component) -> int:
    rails = [
        interface.rail for interface in component.interfaces.values() if interface.rail is not None
    ]
    shapes = sum(interface.flexible for interface in component.interfaces.values())
    return (
        6 * (len(component.interfaces) - len(rails))
        + CONTROL_POINT_DOFS * sum(rail.control_points for rail in rails)
        + shapes
    )


def _guess_modes(component: Component, volume: float | None) -> int:
    """Fixed-interface modes to expect."""
    settings, material = component.reduction, component.material
    if settings.modes_to_hz is None:
        return settings.modes or 0
    if volume is None or not material.density > 0.0:
        return 0
    # bodies longer than thick have more low modes than their volume says: as many again, and a few
    bulk = (
        volume
        * settings.modes_to_hz**3
        * weigh_modes(material.youngs_modulus, material.poisson_ratio, material.density)
    )
    found = max(2.0 * bulk, _count_plate_modes(component, settings.modes_to_hz)) + 4.0
    return int(min(found, MOST_GUESSED_MODES if settings.modes is None else settings.modes))


def _count_plate_modes(component: Component, up_to_hz: float) -> float:
    """Natural frequencies of a box below a frequency as those of a plate as thick as its least side:
    bending, and two families of waves in its plane, each as many as ``area k^2 / (4 pi)`` for many
    of them; none of other shapes, whose sides are not known.

    Source: Weyl's law in the plane; wave numbers ``k`` of the Kirchhoff plate, Cremer and Heckl
    (1996), section 2.3.
    """
    solid, material = component.solid, component.material
    if not isinstance(solid, Box):
        return 0.0
    thickness, width, length = sorted(solid.size)
    speed = math.sqrt(material.youngs_modulus / material.density)
    narrowing = 1.0 - material.poisson_ratio**2
    omega = 2.0 * math.pi * up_to_hz
    squares = (
        math.sqrt(12.0 * narrowing) * omega / (speed * thickness),
        narrowing * (omega / speed) ** 2,
        2.0 * (1.0 + material.poisson_ratio) * (omega / speed) ** 2,
    )
    return width * length / (4.0 * math.pi) * sum(squares)


def check_cells(component: Component, cells: int, limit: int | None) -> None:
    """Refuse a mesh with more cells than the scene allows, or than the mesher does.

    Args:
        limit: ``limits.elements`` of the scene; None for the mesher's own.

    Raises:
        BudgetError: Names the component, the estimate and the limit.
    """
    allowed = CELL_BUDGET if limit is None else min(limit, CELL_BUDGET)
    if cells > allowed:
        whose = "limits.elements allows" if limit == allowed else "the mesher takes at most"
        raise BudgetError(
            f"component {component.name!r} would be meshed with about {cells:.3g} cells, {whose} {allowed};"
            " write a larger mesh size"
        )


def check_time(stages: Sequence[Stage], limit_s: float | None) -> None:
    """Refuse stages that together would take far longer than the scene allows, if it says so, else a
    path or contour of many hours.

    Raises:
        BudgetError: Names the longest stage, the estimates and the limit.
    """
    total = sum(stage.estimated_seconds or 0.0 for stage in stages)
    if limit_s is None:
        for stage in stages:
            seconds = stage.estimated_seconds or 0.0
            if stage.kind in PATH_KEYS and seconds > TIME_MARGIN * MOST_PATH_SECONDS:
                raise BudgetError(
                    f"stage {stage.kind} would take about {seconds:.2g} s, {seconds / 3600.0:.2g} hours; {PATH_KEYS[stage.kind]}, or allow"
                    f' it by limits = {{ time = "{1.2 * seconds / 3600.0:.2g} h" }}'
                )
        return
    if total > TIME_MARGIN * limit_s:
        longest = max(stages, key=lambda stage: stage.estimated_seconds or 0.0)
        what: str = longest.kind
        remedy = PATH_KEYS.get(longest.kind)
        if longest.component is not None:
            what += f" of component {longest.component!r} with about {longest.estimated_dofs or 0:.3g} dofs"
        raise BudgetError(
            f"this run would take about {total:.3g} s, {what} alone {longest.estimated_seconds:.3g} s, limits.time allows {limit_s:g} s;"
            f" {remedy or 'write a larger mesh size or keep fewer modes'}"
        )


def check_elapsed(seconds: float, limit_s: float | None, stage: Stage) -> None:
    """Stop a run that has used up the time the scene allows.

    Args:
        seconds: Wall time since the run began [s].
        limit_s: ``limits.time`` of the scene [s]; None for no limit.

    Raises:
        BudgetError: Names the stage that was due, the time and the limit.
    """
    if limit_s is not None and seconds > limit_s:
        due = stage.component or stage.pose
        raise BudgetError(
            f"{seconds:.3g} s have passed, limits.time allows {limit_s:g} s; stopped before {stage.kind}"
            + (f" of {due!r}" if due else "")
            + ": earlier results are unchanged; finished meshes and reductions are stored for the next run"
        )


def _vector_count(component: Component) -> int:
    """Boundary dofs and modes that are certain; how many modes lie below a frequency nobody knows
    beforehand.
    """
    settings = component.reduction
    return 6 * len(component.interfaces) + (
        settings.modes or 0 if settings.modes_to_hz is None else 0
    )

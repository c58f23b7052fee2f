"""NAFEMS tests 5H and 5T: the deep simply supported beam under a harmonic and a suddenly applied
uniform load, as a 3D body.
"""

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.joints import Joint, JointEnd
from headstock.geometry.machine.machine import Machine, Pose
from headstock.geometry.parts.components import Component, Load
from headstock.geometry.parts.solids import Box
from headstock.meshing.component_mesh import ComponentMesh
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.requests import ReductionRequest
from headstock.solvers.elastic.eigenpairs import ModeTarget
from headstock.solvers.elastic.stress_recovery import find_point_rows
from headstock.solvers.linear.damping import add_modal_damping
from headstock.solvers.linear.frequency_response import solve_frf
from headstock.solvers.linear.state_space import to_state_space
from headstock.solvers.linear.static_response import solve_static
from headstock.solvers.linear.time_response import solve_time_response
from headstock.solvers.mpi import MPI
from headstock.solvers.second_order import Channel, SecondOrderSystem
from headstock.solvers.stresses import STRESS_NAMES
from headstock.validation.parts.closed_form_cases import DEEP_BEAM, face_interface, mesh_settings
from headstock.validation.parts.component_models import shared_mesh
from headstock.validation.references.rows import Target, ValidationRow, compare_value, show

LOAD_PER_LENGTH = 1e6
DAMPING = 0.02
SIZE, MODES = 0.5, 120
LOAD: Channel = ("load", "x")
MOVED: Channel = ("middle", "x")
MIDDLE = np.array([0.0, 0.0, 0.5 * DEEP_BEAM.length])
FIBRE = MIDDLE[None] - np.array([[0.5 * DEEP_BEAM.width, 0.0, 0.0]])
SWEEP: FloatArray = np.asarray(np.linspace(40.0, 45.0, 2001), dtype=float)
STEP, DURATION, NEAR = 1e-5, 0.02, 100
PUBLISHED = "published"


@dataclass(frozen=True, eq=False)
class LoadedBeam:
    """The beam of FV5 as a 3D body with 2 % damping of every mode.

    Attributes:
        system: In: the uniform load; out: displacement of the axis at midspan, and every
            coordinate.
        fields: ``(3 n_points, n)`` displacement of the mesh points per coordinate.
    """

    system: SecondOrderSystem
    mesh: ComponentMesh
    fields: FloatArray

    def stresses(self, coordinates: FloatArray, points: FloatArray) -> FloatArray:
        """Stress along the beam ``(n_points,)`` [Pa]."""
        field, along = (self.fields @ coordinates)[:, None], 3 + STRESS_NAMES.index("zz")
        rows = [find_point_rows(self.mesh, DEEP_BEAM.material, point) for point in points]
        return np.array([each.apply(field)[along, 0] for each in rows])


def check_harmonic_beam(comm: MPI.Comm) -> list[ValidationRow]:
    """NAFEMS 5H: peak displacement, its frequency and the fibre stress at midspan between 40 and 45
    Hz, 2 % damping of all modes.

    The published stress is that of beam theory: bending moment over section modulus, and so it is
    taken from the section here. The fibre itself bears 2 % more, because stress is not linear over
    the depth of so deep a beam.

    Source: NAFEMS R0016 (1993), Selected benchmarks for forced vibration, test 5H; Abaqus
    Benchmarks Guide 4.5.2.
    """
    beam = _loaded_beam(comm)
    moved = np.abs(
        solve_frf(beam.system, SWEEP, inputs=[LOAD], outputs=[MOVED]).receptance[:, 0, 0]
    )
    peak = int(np.argmax(moved))
    every = [channel for channel in beam.system.outputs if channel != MOVED]
    swing = solve_frf(beam.system, SWEEP[[peak]], inputs=[LOAD], outputs=every).receptance[0, :, 0]
    parts = (np.array(swing.real, dtype=float), np.array(swing.imag, dtype=float))
    places, weights = _section_points()
    modulus = DEEP_BEAM.width * DEEP_BEAM.depth**2 / 6.0
    bending = math.hypot(
        *(float(weights @ beam.stresses(part, places)) / modulus for part in parts)
    )
    fibre = math.hypot(*(float(beam.stresses(part, FIBRE)[0]) for part in parts))
    note = "3D body of hex27 on averaged supports"
    return [
        compare_value(
            "peak displacement", 1e3 * moved[peak], Target(13.45, "mm", 1e-2, PUBLISHED), note
        ),
        compare_value("frequency of the peak", SWEEP[peak], Target(42.65, "Hz", 1e-2, PUBLISHED)),
        compare_value(
            "peak bending stress",
            1e-6 * bending,
            Target(241.9, "MPa", 1e-2, PUBLISHED),
            "moment over section modulus",
        ),
        show(
            "peak stress of the fibre itself",
            1e-6 * fibre,
            "MPa",
            "no beam theory: stress bends over the depth",
        ),
    ]


def check_transient_beam(comm: MPI.Comm) -> list[ValidationRow]:
    """NAFEMS 5T: peak displacement, its time, static displacement and fibre stress at midspan under
    a suddenly applied load.

    Source: NAFEMS R0016 (1993), Selected benchmarks for forced vibration, test 5T; Altair
    OptiStruct verification OS-V:0330.
    """
    beam = _loaded_beam(comm)
    system, every = beam.system, [channel for channel in beam.system.outputs if channel != MOVED]
    space = to_state_space(system, inputs=[LOAD], outputs=[MOVED, *every])
    found = solve_time_response(space, np.ones((round(DURATION / STEP) + 1, 1)), STEP)
    moved = found.outputs[:, 0]
    # stress is largest close to the largest displacement
    near = range(int(np.argmax(moved)) - NEAR, int(np.argmax(moved)) + NEAR + 1, NEAR // 5)
    stress = max(abs(float(beam.stresses(found.outputs[place, 1:], FIBRE)[0])) for place in near)
    static = float(system.outputs[MOVED] @ solve_static(system, system.inputs[LOAD]).displacements)
    return [
        compare_value("peak displacement", 1e3 * moved.max(), Target(1.043, "mm", 1e-2, PUBLISHED)),
        compare_value(
            "time of the peak",
            1e3 * found.times[int(np.argmax(moved))],
            Target(11.7, "ms", 2e-2, PUBLISHED),
        ),
        compare_value("static displacement", 1e3 * static, Target(0.538, "mm", 1e-2, PUBLISHED)),
        compare_value("peak fibre stress", 1e-6 * stress, Target(18.76, "MPa", 4e-2, PUBLISHED)),
    ]


def _loaded_beam(comm: MPI.Comm) -> LoadedBeam:
    """Mesh, reduce and support the beam."""
    size = (DEEP_BEAM.width, DEEP_BEAM.depth, DEEP_BEAM.length)
    interfaces = {
        name: face_interface(name, face, "average") for name, face in (("a", "z-"), ("b", "z+"))
    }
    part = Component(
        "beam",
        Box(size),
        DEEP_BEAM.material,
        interfaces=interfaces,
        mesh=mesh_settings("hex27", SIZE),
    )
    # a uniform load is a uniform acceleration of a prismatic body
    load = Load(
        "line", "beam", "body", vector=(LOAD_PER_LENGTH / DEEP_BEAM.mass_per_length, 0.0, 0.0)
    )
    mesh = shared_mesh(part, (), (load,), comm=comm)
    element = reduce_elastic(
        part, mesh, (), (load,), comm=comm, request=ReductionRequest(modes=ModeTarget(count=MODES))
    )
    fixed = {"a": (0, 1, 2, 5), "b": (0, 1)}
    joints = {
        end: Joint(end, (JointEnd(), JointEnd("beam", end)), "spring", fixed=dofs)
        for end, dofs in fixed.items()
    }
    coupled = couple(
        {"beam": element},
        Machine("deep beam", {"beam": part}, joints, loads={"line": load}),
        Pose("reference"),
    )
    if element.recovery is None:
        raise ValueError("the beam was reduced without its recovery basis")
    fields: FloatArray = element.recovery.basis @ coupled.basis
    axis = int(np.argmin(np.linalg.norm(mesh.points - MIDDLE, axis=1)))
    unit: FloatArray = np.eye(fields.shape[1])
    outputs: dict[Channel, FloatArray] = {MOVED: fields[3 * axis]}
    outputs |= {(f"q{number}", "x"): unit[number] for number in range(len(unit))}
    system = dataclasses.replace(
        coupled.system, inputs={LOAD: coupled.loads["line"]}, outputs=outputs
    )
    return LoadedBeam(add_modal_damping(system, [DAMPING]), mesh, fields)


def _section_points() -> tuple[FloatArray, FloatArray]:
    """Gauss points of the section at midspan ``(n, 3)``, and weights that make the bending moment
    of stresses there.
    """
    nodes, weights = np.polynomial.legendre.leggauss(2)
    edges = np.arange(-0.5 * DEEP_BEAM.width, 0.5 * DEEP_BEAM.width, SIZE)
    places = (edges[:, None] + 0.5 * SIZE * (nodes + 1.0)).ravel()
    shares = np.tile(0.5 * SIZE * weights, len(edges))
    x, y = (part.ravel() for part in np.meshgrid(places, places, indexing="ij"))
    area = np.outer(shares, shares).ravel()
    return np.column_stack([x, y, np.full_like(x, MIDDLE[2])]), area * x

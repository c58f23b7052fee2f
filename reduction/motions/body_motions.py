"""What each component does in a motion of the machine: rigid motion and deformation, and the
motions that nothing resists.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from headstock.geometry.frames import FloatArray, rigid_transfer
from headstock.meshing.scipy_library import scipy
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.motions.part_names import join_names
from headstock.reduction.superelement_checks import characteristic_length, dof_scale
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.static_response import BalancedResult, solve_balanced
from headstock.solvers.linear.symmetric_matrices import find_null_space

MOTION_NAMES = (
    "X translation",
    "Y translation",
    "Z translation",
    "A rotation",
    "B rotation",
    "C rotation",
)
MOVING_SHARE = 1e-6
RANK_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """The motion of one component.

    Attributes:
        rigid: ``(6,)`` best rigid motion at the centre of mass, machine axes.
        deformation: ``(n_c,)`` what is left of its dofs, machine axes.
        weights: ``(6,)`` size of each rigid motion: by kinetic energy, or with a length for
            rotations where nothing has mass.
    """

    component: str
    rigid: FloatArray
    deformation: FloatArray
    weights: FloatArray

    @property
    def main(self) -> int:
        """The dominating one of the six rigid motions; the first of equals."""
        return int(
            np.argmax(
                np.round(self.weights / max(float(self.weights.max()), np.finfo(float).tiny), 6)
            )
        )


def center_of_mass(coupled: CoupledMachine, name: str) -> FloatArray:
    """Return the centre of mass ``(3,)`` of a component in the machine frame [m]."""
    placement = coupled.placements[name]
    return placement.origin + placement.rotation @ coupled.layout.superelements[name].center_of_mass


def rigid_dofs(coupled: CoupledMachine, name: str, point: FloatArray) -> FloatArray:
    """Return the dofs ``(n_c, 6)`` of a component when it moves rigidly: three unit displacements
    and three unit rotations, machine axes.

    Args:
        point: ``(3,)`` point about which it rotates, machine frame [m].
    """
    return coupled.matrices.rigid[name] @ rigid_transfer(point, coupled.placements[name].origin)


def _body_motion(coupled: CoupledMachine, name: str, stacked: FloatArray) -> BodyMotion:
    """Split a component's part of a stacked motion ``(n_all,)`` into rigid motion and deformation.

    The rigid part is the one nearest in the norm of the mass matrix (of the boundary dofs where the
    component has no mass).
    """
    superelement = coupled.layout.superelements[name]
    local = stacked[coupled.offsets[name]]
    motions = rigid_dofs(coupled, name, center_of_mass(coupled, name))
    metric = coupled.matrices.masses[name]
    if not metric.any():
        inverse = 1.0 / dof_scale(superelement) ** 2
        inverse[superelement.boundary_size :] = 0.0
        metric = np.diag(inverse)
    gram = motions.T @ metric @ motions
    length = characteristic_length(superelement)
    scale = np.repeat([1.0, 1.0 / length], 3)
    solved = np.linalg.lstsq(
        gram * scale * scale[:, None], scale * (motions.T @ metric @ local), rcond=1e-12
    )[0]
    rigid = scale * solved
    return BodyMotion(name, rigid, local - motions @ rigid, gram.diagonal() * rigid**2)


def split_motions(coupled: CoupledMachine, stacked: FloatArray) -> tuple[BodyMotion, ...]:
    """Return the motion of every component that has dofs."""
    return tuple(_body_motion(coupled, name, stacked) for name in coupled.offsets)


@dataclass(frozen=True, eq=False)
class FreeMotion:
    """One independent motion that meets no stiffness.

    Attributes:
        bodies: Components that take part.
        motion: Machine-tool word such as ``X translation``.
        shape: ``(n_all,)`` stacked dofs.
    """

    bodies: tuple[str, ...]
    motion: str
    shape: FloatArray

    def __str__(self) -> str:
        return f"{self.motion} of {join_names(self.bodies)}" if self.bodies else self.motion


def find_free_motions(coupled: CoupledMachine) -> tuple[FreeMotion, ...]:
    """Find the independent motions that meet no stiffness, each as simple as can be: one body
    moves, the others of the set do not.
    """
    null = find_null_space(coupled.system.stiffness)
    if null.dimension == 0:
        return ()
    shapes = coupled.basis @ null.vectors
    rigid = np.column_stack([_stack_rigid(coupled, shape) for shape in shapes.T])
    _, triangular, pivots = scipy.linalg.qr(rigid.T, mode="economic", pivoting=True)
    rank = int(
        np.count_nonzero(
            np.abs(triangular.diagonal())
            > RANK_TOLERANCE * max(abs(triangular[0, 0]), np.finfo(float).tiny)
        )
    )
    leaders = np.sort(pivots[:rank])
    combined = shapes @ np.linalg.pinv(rigid[leaders]) if rank else shapes[:, :0]
    motions = [_describe(coupled, combined[:, i], int(leader)) for i, leader in enumerate(leaders)]
    if rank < null.dimension:
        labels = sorted({coupled.system.labels[int(dof)] for dof in null.pinned})
        motions += [
            FreeMotion((), f"a motion without any body ({', '.join(labels)})", shapes[:, i])
            for i in range(rank, null.dimension)
        ]
    return tuple(motions)


def solve_machine_static(coupled: CoupledMachine, loads: FloatArray) -> BalancedResult:
    """Return the static displacements of a coupled machine under loads that do no work on its free
    motions.

    Args:
        loads: ``(n,)`` or ``(n, m)`` generalised loads.

    Raises:
        ModelError: A load does work on a free motion; every free motion is named with the bodies
            that move.
        AccuracyError: The residual is too large.
    """
    result = solve_balanced(coupled.system, loads[:, None] if loads.ndim == 1 else loads)
    if not result.balanced.all():
        raise free_motion_error(coupled)
    return replace(result, displacements=result.displacements.reshape(loads.shape))


def warn_of_free_motions(motions: Sequence[FreeMotion]) -> str:
    """Return the warning of motions that nothing constrains where the analyses go on: one text,
    whoever finds them, so that it is said once.
    """
    return (
        f"nothing holds {'; '.join(str(motion) for motion in motions)}: that has no frequency, and a static load that does work on it "
        "has no answer (free); hold it by a joint if it is not meant"
    )


def free_motion_error(coupled: CoupledMachine) -> ModelError:
    """Return the error of a load that does work on free motions, which are named."""
    motions = find_free_motions(coupled)
    return ModelError(
        f"{len(motions)} rigid motion(s) are free and the loads do work on them, so there is no static answer: "
        f"{'; '.join(str(motion) for motion in motions)}. Hold them by a joint or a support"
    )


def _stack_rigid(coupled: CoupledMachine, shape: FloatArray) -> FloatArray:
    """Return the rigid motions ``(6 n_components,)`` of all components, rotations times the
    machine's length.
    """
    scale = np.repeat([1.0, coupled.layout.length], 3)
    return np.concatenate([scale * motion.rigid for motion in split_motions(coupled, shape)])


def _describe(coupled: CoupledMachine, shape: FloatArray, leader: int) -> FreeMotion:
    stacked = np.abs(_stack_rigid(coupled, shape)).reshape(-1, 6).max(axis=1)
    bodies = tuple(
        name
        for name, size in zip(coupled.offsets, stacked, strict=True)
        if size > MOVING_SHARE * stacked.max()
    )
    return FreeMotion(bodies, MOTION_NAMES[leader % 6], shape)

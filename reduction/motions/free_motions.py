"""Motions of a machine that nothing holds: which bodies move, and how."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import qr

from headstock.geometry.frames import FloatArray
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.motions.body_motions import MOTION_NAMES, join_names, split_motions
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.static_response import BalancedResult, solve_balanced
from headstock.solvers.linear.symmetric_matrices import find_null_space

MOVING_SHARE = 1e-6
RANK_TOLERANCE = 1e-9


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
    """Independent motions that meet no stiffness, each as simple as can be: one body leads, the others of the set do not."""
    null = find_null_space(coupled.system.stiffness)
    if null.dimension == 0:
        return ()
    shapes = coupled.basis @ null.vectors
    rigid = np.column_stack([_stack_rigid(coupled, shape) for shape in shapes.T])
    _, triangular, pivots = qr(rigid.T, mode="economic", pivoting=True)
    rank = int(np.count_nonzero(np.abs(triangular.diagonal()) > RANK_TOLERANCE * max(abs(triangular[0, 0]), np.finfo(float).tiny)))
    leaders = np.sort(pivots[:rank])
    combined = shapes @ np.linalg.pinv(rigid[leaders]) if rank else shapes[:, :0]
    motions = [_describe(coupled, combined[:, i], int(leader)) for i, leader in enumerate(leaders)]
    if rank < null.dimension:
        labels = sorted({coupled.system.labels[int(dof)] for dof in null.pinned})
        motions += [
            FreeMotion((), f"a motion without any body ({', '.join(labels)})", shapes[:, i]) for i in range(rank, null.dimension)
        ]
    return tuple(motions)


def solve_machine_static(coupled: CoupledMachine, loads: FloatArray) -> BalancedResult:
    """Static displacements of a coupled machine under loads that do no work on its free motions.

    Args:
        coupled: The machine.
        loads: ``(n,)`` or ``(n, m)`` generalised loads.

    Raises:
        ModelError: A load does work on a free motion; every free motion is named with the bodies that move.
        AccuracyError: The residual is too large.
    """
    found = solve_balanced(coupled.system, loads[:, None] if loads.ndim == 1 else loads)
    if not found.balanced.all():
        raise free_motion_error(coupled)
    return replace(found, displacements=found.displacements.reshape(loads.shape))


def warn_of_free_motions(motions: Sequence[FreeMotion]) -> str:
    """What to say of motions that nothing holds where the analyses go on: one text, whoever finds them, so that it is said once."""
    return (
        f"nothing holds {'; '.join(str(motion) for motion in motions)}: that has no frequency, and a static load that does work on it "
        "has no answer (free); hold it by a joint if it is not meant"
    )


def free_motion_error(coupled: CoupledMachine) -> ModelError:
    """What to say where a load does work on free motions, which are named."""
    motions = find_free_motions(coupled)
    return ModelError(
        f"{len(motions)} rigid motion(s) are free and the loads do work on them, so there is no static answer: "
        f"{'; '.join(str(motion) for motion in motions)}. Hold them by a joint or a support"
    )


def _stack_rigid(coupled: CoupledMachine, shape: FloatArray) -> FloatArray:
    """Rigid motions ``(6 n_components,)`` of all components, rotations times the machine's length."""
    scale = np.repeat([1.0, coupled.layout.length], 3)
    return np.concatenate([scale * motion.rigid for motion in split_motions(coupled, shape)])


def _describe(coupled: CoupledMachine, shape: FloatArray, leader: int) -> FreeMotion:
    stacked = np.abs(_stack_rigid(coupled, shape)).reshape(-1, 6).max(axis=1)
    bodies = tuple(name for name, size in zip(coupled.offsets, stacked, strict=True) if size > MOVING_SHARE * stacked.max())
    return FreeMotion(bodies, MOTION_NAMES[leader % 6], shape)

"""What each component of a machine does in a motion: how it moves as a rigid body and what is left as deformation."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray, rotate_dofs
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.dof_layout import turn_dofs
from headstock.reduction.superelement_checks import characteristic_length, dof_scale, rigid_motions

MOTION_NAMES = ("X translation", "Y translation", "Z translation", "A rotation", "B rotation", "C rotation")


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """The motion of one component.

    Attributes:
        component: Its name.
        rigid: ``(6,)`` best rigid motion at the centre of mass, machine axes.
        deformation: ``(n_c,)`` what is left of its dofs, machine axes.
        weights: ``(6,)`` size of each rigid motion: by kinetic energy, or with a length for rotations where nothing has mass.
    """

    component: str
    rigid: FloatArray
    deformation: FloatArray
    weights: FloatArray

    @property
    def main(self) -> int:
        """The dominating one of the six rigid motions; the first of equals."""
        return int(np.argmax(np.round(self.weights / max(float(self.weights.max()), np.finfo(float).tiny), 6)))


def center_of_mass(coupled: CoupledMachine, name: str) -> FloatArray:
    """Centre of mass ``(3,)`` of a component in the machine frame [m]."""
    placement = coupled.placements[name]
    return np.asarray(placement.origin + placement.rotation @ coupled.layout.superelements[name].center_of_mass)


def rigid_dofs(coupled: CoupledMachine, name: str, point: FloatArray) -> FloatArray:
    """Dofs ``(n_c, 6)`` of a component when it moves rigidly, six motions at a point, machine axes."""
    superelement, placement = coupled.layout.superelements[name], coupled.placements[name]
    own = rigid_motions(superelement, placement.rotation.T @ (point - placement.origin)) @ rotate_dofs(placement.rotation.T)
    return np.asarray(turn_dofs(superelement, placement).T @ own)


def body_motion(coupled: CoupledMachine, name: str, stacked: FloatArray) -> BodyMotion:
    """Split a component's part of a stacked motion ``(n_all,)`` into rigid motion and deformation.

    The rigid part is the one nearest in the norm of the mass matrix (of the boundary dofs where the component has no mass).
    """
    superelement = coupled.layout.superelements[name]
    own = stacked[coupled.offsets[name]]
    motions = rigid_dofs(coupled, name, center_of_mass(coupled, name))
    metric = coupled.matrices.masses[name]
    if not metric.any():
        inverse = 1.0 / dof_scale(superelement) ** 2
        inverse[superelement.boundary_size :] = 0.0
        metric = np.diag(inverse)
    gram = motions.T @ metric @ motions
    length = characteristic_length(superelement)
    scale = np.repeat([1.0, 1.0 / length], 3)
    solved = np.linalg.lstsq(gram * scale * scale[:, None], scale * (motions.T @ metric @ own), rcond=1e-12)[0]
    rigid = scale * solved
    return BodyMotion(name, rigid, own - motions @ rigid, gram.diagonal() * rigid**2)


def split_motions(coupled: CoupledMachine, stacked: FloatArray) -> tuple[BodyMotion, ...]:
    """The motion of every component that has dofs."""
    return tuple(body_motion(coupled, name, stacked) for name in coupled.offsets)


def join_names(names: Sequence[str], limit: int = 4) -> str:
    """``a + pad_1..4``: numbered names of one family together, cut with an ellipsis where there are many."""
    families: dict[str, list[int]] = {}
    for name in names:
        stem, number = split_number(name)
        families.setdefault(stem, []).extend([] if number is None else [number])
    parts = [_join_family(stem, sorted(numbers)) for stem, numbers in families.items()]
    shown = " + ".join(parts[:limit])
    return f"{shown} ..." if len(parts) > limit else shown


def split_number(name: str) -> tuple[str, int | None]:
    """``pad_3`` as ``("pad", 3)``; a name without a number as ``(name, None)``."""
    stem, _, tail = name.rpartition("_")
    if stem and tail.isdecimal() and str(int(tail)) == tail:
        return stem, int(tail)
    return name, None


def _join_family(stem: str, numbers: Sequence[int]) -> str:
    if not numbers:
        return stem
    if len(numbers) > 1 and numbers[-1] - numbers[0] == len(numbers) - 1:
        return f"{stem}_{numbers[0]}..{numbers[-1]}"
    return f"{stem}_{','.join(str(number) for number in numbers)}"

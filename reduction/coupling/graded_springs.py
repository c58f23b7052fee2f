"""Springs sorted into groups of like stiffness, stiffest first."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.reduction.coupling.dof_layout import DOFS_OF_A_BODY, DofLayout, free_deformations, scale_dofs, turn_dofs
from headstock.reduction.coupling.joint_springs import JointSpring, SpringDirection, principal_springs
from headstock.solvers.linear.symmetric_matrices_2 import is_symmetric

GRADING_RATIO = 1e4  # stiffer than this times the softest spring: a coordinate of its own
GRADING_STEP = 1e3  # springs within this factor share a group
STIFF_RATIO = 1e9
ABSURD_RATIO = 1e12
STIFF_COMPONENT_RATIO = 3e6  # of a component to the softest spring: its rounding costs the spring all but nine or ten digits


@dataclass(frozen=True, eq=False)
class SpringGrading:
    """How the springs of a machine differ.

    Attributes:
        groups: Stiff springs, the stiffest group first; empty where all springs are alike.
        soft: The other springs, where there are groups.
        warnings: About ratios no machine has.
        deformations: Rows ``(m, n_all)`` of the deformations of components that are far stiffer still than the softest spring, in
            one block; none where there are no such components.
    """

    groups: tuple[tuple[SpringDirection, ...], ...]
    soft: tuple[SpringDirection, ...]
    warnings: tuple[str, ...]
    deformations: tuple[FloatArray, ...] = ()

    def group_rows(self, springs: Sequence[JointSpring]) -> list[FloatArray]:
        """Rows ``(m_g, n_all)`` of each group, deformations of components first."""
        rows = {spring.name: spring.rows for spring in springs}
        return [*self.deformations, *(np.array([part.direction @ rows[part.joint] for part in group]) for group in self.groups)]


def grade_springs(springs: Sequence[JointSpring], layout: DofLayout, stiffnesses: Mapping[str, FloatArray]) -> SpringGrading:
    """Sort the springs of all joints by stiffness, rotational ones over the square of a length of the machine.

    Args:
        springs: Joints as placed.
        layout: Components and the characteristic length of the machine.
        stiffnesses: ``(n, n)`` of each component in machine axes.
    """
    if not all(is_symmetric(spring.stiffness) for spring in springs):
        return SpringGrading((), (), ())
    length = layout.length
    parts = [part for spring in springs for part in principal_springs(spring, length) if _acts(spring, part)]
    parts.sort(key=lambda part: -abs(part.level))
    if not parts:
        return SpringGrading((), (), ())
    softest = parts[-1]
    deformations = _stiff_deformations(layout, stiffnesses, abs(softest.level))
    if abs(parts[0].level) <= GRADING_RATIO * abs(softest.level):
        return SpringGrading((), (), (), deformations)
    groups: list[list[SpringDirection]] = []
    for part in parts:
        if abs(part.level) <= GRADING_RATIO * abs(softest.level):
            break
        if not groups or abs(part.level) * GRADING_STEP < abs(groups[-1][0].level):
            groups.append([])
        groups[-1].append(part)
    soft = tuple(parts[sum(len(group) for group in groups) :])
    return SpringGrading(tuple(tuple(group) for group in groups), soft, tuple(_ratio_warnings(parts, softest)), deformations)


def _stiff_deformations(layout: DofLayout, stiffnesses: Mapping[str, FloatArray], softest: float) -> tuple[FloatArray, ...]:
    """Rows of the boundary dofs of far stiffer components, less the rigid motion of the first node of each.

    The soft springs of a body must not be what is left of the difference of its own large stiffnesses.
    """
    squares, blocks = scale_dofs(layout) ** 2, []
    for name, element in layout.superelements.items():
        own = layout.offsets[name]
        boundary = element.boundary_size
        level = float(np.abs(stiffnesses[name].diagonal() * squares[own])[:boundary].max(initial=0.0))
        if element.supported or boundary <= DOFS_OF_A_BODY or not level > STIFF_COMPONENT_RATIO * softest:
            continue
        rows = np.zeros((boundary - DOFS_OF_A_BODY, layout.size))
        rows[:, own] = free_deformations(element)[: len(rows)] @ turn_dofs(element, layout.placements[name])
        blocks.append(rows)
    return (np.vstack(blocks),) if blocks else ()


def _acts(spring: JointSpring, part: SpringDirection) -> bool:
    """Whether a spring is stretched by any motion at all; one across a single rigid body is not."""
    return bool(np.any(part.direction @ spring.rows))


def _ratio_warnings(parts: Sequence[SpringDirection], softest: SpringDirection) -> list[str]:
    warnings = []
    for part in parts:
        ratio = abs(part.level / softest.level)
        if ratio <= STIFF_RATIO:
            break
        text = (
            f"joint {part.joint}, {part.dof}: {part.stiffness:.3g} is {ratio:.2g} times as stiff as "
            f"joint {softest.joint}, {softest.dof} ({softest.stiffness:.3g})"
        )
        remedy = "check the units of both" if ratio > ABSURD_RATIO else "it acts as rigid; hold the dof instead if that is meant"
        warnings.append(f"{text}; {remedy}")
    return warnings

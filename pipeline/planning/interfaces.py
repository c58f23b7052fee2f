"""Interfaces whose kind is a choice, and joints that make two elastic bodies one over an area: there
six motions of an interface are a model, and deformation shapes a better one.
"""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

from headstock.geometry.machine.joints import JointEnd
from headstock.geometry.machine.machine import Machine
from headstock.geometry.parts.components import Component, CouplingKind
from headstock.geometry.parts.patches import patch_outline
from headstock.geometry.parts.solids import SuperelementFile

DIRECTIONS_OF_A_BODY = 6
CURVED = ("outer", "inner")


def has_choice(component: Component) -> bool:
    """Tell whether the coupling of an interface of this component is a choice: it is meshed, and not all
    its interfaces are rails.
    """
    meshed = component.fidelity == "elastic" and not isinstance(component.solid, SuperelementFile)
    return meshed and any(interface.rail is None for interface in component.interfaces.values())


def recouple(component: Component, kind: CouplingKind) -> Component:
    """The component with one kind of coupling at all its fixed interfaces."""
    interfaces = {
        name: interface
        if interface.rail is not None
        else dataclasses.replace(interface, coupling=kind)
        for name, interface in component.interfaces.items()
    }
    return dataclasses.replace(component, interfaces=interfaces)


@dataclass(frozen=True)
class GluedJoint:
    """A rigid joint between interfaces of two elastic components, each one patch on a face.

    Attributes:
        ends: ``(component, interface)`` of both sides.
    """

    name: str
    ends: tuple[tuple[str, str], tuple[str, str]]

    def __str__(self) -> str:
        return " and ".join(f"{component}.{interface}" for component, interface in self.ends)


def find_glued_joints(machine: Machine, components: Mapping[str, Component]) -> list[GluedJoint]:
    """The joints of a machine that hold every motion between flat areas of two elastic bodies."""
    found = []
    for joint in machine.joints.values():
        ends = [_glued_end(components, end) for end in joint.ends]
        if len(joint.fixed) == DIRECTIONS_OF_A_BODY and ends[0] is not None and ends[1] is not None:
            found.append(GluedJoint(joint.name, (ends[0], ends[1])))
    return found


def _glued_end(components: Mapping[str, Component], end: JointEnd) -> tuple[str, str] | None:
    component = components.get(end.component or "")
    if component is None or end.interface is None or not has_choice(component):
        return None
    interface = component.interfaces.get(end.interface)
    if interface is None or interface.rail is not None or len(interface.patches) != 1:
        return None
    return None if interface.patches[0].face in CURVED else (component.name, interface.name)


def find_reach(component: Component, name: str, area: float) -> float:
    """Return how far the area of an interface reaches from its middle [m]; of areas on faces without a
    known outline the radius of a circle, which is the least it can be.

    Args:
        name: Of the interface, one patch.
        area: Of the interface [m^2].
    """
    (patch,) = component.interfaces[name].patches
    outline = patch_outline(component.solid, patch)
    return math.sqrt(area / math.pi) if outline is None else outline.reach


def give_shapes(component: Component, shapes: Mapping[str, int], kind: CouplingKind) -> Component:
    """The component with deformation shapes at some interfaces, in one form.

    Args:
        shapes: Interface to the most shapes it gets; others of the same patches get as many, since
            they share them.
        kind: ``rigid`` for the strong form, ``average`` for the weak one.
    """
    wanted = {component.interfaces[name].patches: count for name, count in shapes.items()}
    return dataclasses.replace(
        component,
        interfaces={
            name: dataclasses.replace(entry, coupling=kind, flexible=wanted[entry.patches])
            if entry.patches in wanted and entry.rail is None
            else entry
            for name, entry in component.interfaces.items()
        },
    )

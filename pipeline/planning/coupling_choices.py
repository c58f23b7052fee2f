"""Where the kind of coupling of an interface is a choice, and components with another choice."""

import dataclasses
from typing import Literal

from headstock.geometry.parts.components import Component
from headstock.geometry.parts.solids import SuperelementFile

CouplingKind = Literal["average", "rigid"]


def has_choice(component: Component) -> bool:
    """Whether the coupling of an interface of this component is a choice: it is meshed, and not all its interfaces are rails."""
    meshed = component.fidelity == "elastic" and not isinstance(component.solid, SuperelementFile)
    return meshed and any(interface.rail is None for interface in component.interfaces.values())


def recouple(component: Component, kind: CouplingKind) -> Component:
    """The component with one kind of coupling at all its fixed interfaces."""
    interfaces = {
        name: interface if interface.rail is not None else dataclasses.replace(interface, coupling=kind)
        for name, interface in component.interfaces.items()
    }
    return dataclasses.replace(component, interfaces=interfaces)

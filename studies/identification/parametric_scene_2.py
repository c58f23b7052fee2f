"""A variant of a scene whose numbers follow parameters: only the entries a parameter touches are built anew."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from headstock.geometry.machine.machine import Machine
from headstock.reduction.superelement import Superelement
from headstock.scene.reading.keys import find_keys, read_number
from headstock.scene.reading.positions import KeyPath
from headstock.scene.scene import Scene
from headstock.studies.identification.parametric_scene import KeyLaw, ParametricComponent, ParametricJoint, ParametricShape, moves
from headstock.studies.identification.targets import KeyRule, Parameter


@dataclass(frozen=True, eq=False)
class BuiltScene:
    """A machine with the superelements of all of its components."""

    machine: Machine
    superelements: dict[str, Superelement]


@dataclass(frozen=True, eq=False)
class Touched:
    """What a parameter changes.

    Attributes:
        components: By name.
        joints: By name: their stiffness or their own place.
        stiffness_only: Nothing but stiffnesses of joints, none of them in series with a screw.
        matrices: The superelement of a component changes too, not only places.
    """

    components: tuple[str, ...]
    joints: tuple[str, ...]
    stiffness_only: bool
    matrices: bool


@dataclass(frozen=True, eq=False)
class ParametricScene:
    """One variant of a scene whose numbers follow parameters.

    Attributes:
        scene: As written.
        superelements: Of the scene as written.
        laws: Of the keys that follow a parameter.
        components: Those that follow a parameter.
        joints: Those that follow a parameter.
        touched: By parameter.
    """

    scene: Scene
    superelements: dict[str, Superelement]
    laws: tuple[KeyLaw, ...]
    components: dict[str, ParametricComponent]
    joints: dict[str, ParametricJoint]
    touched: dict[str, Touched]

    def build(self, values: Mapping[str, float]) -> BuiltScene:
        """The machine and its superelements for given parameter values.

        Raises:
            ParameterValueError: The scene cannot be built with them.
        """
        components, superelements = dict(self.scene.machine.components), dict(self.superelements)
        for name, component in self.components.items():
            components[name], superelements[name] = component.build(values)
        joints = self.scene.machine.joints | {name: joint.build(values) for name, joint in self.joints.items()}
        return BuiltScene(dataclasses.replace(self.scene.machine, components=components, joints=joints), superelements)


def make_parametric(
    scene: Scene, superelements: dict[str, Superelement], parameters: Sequence[Parameter], others: Iterable[ParametricScene] = ()
) -> ParametricScene:
    """Tie the numbers of a variant to parameters; keys the variant does not hold as numbers are left out.

    Args:
        scene: The variant.
        superelements: Of its components as written.
        parameters: Their rules name keys of the scene.
        others: Other variants; a component that is the same there is built once for all.
    """
    laws = find_laws(scene.raw, parameters)
    by_component: dict[str, list[KeyLaw]] = {}
    by_joint: dict[str, list[KeyLaw]] = {}
    for law in laws:
        section, name = str(law.key[0]), str(law.key[1])
        if section == "joints":
            by_joint.setdefault(name, []).append(law)
        else:
            for owner in [name] if section == "components" else _made_of(scene.raw, name):
                by_component.setdefault(owner, []).append(law)
    shapes = [component.shape for other in others for component in other.components.values()]
    components = {}
    for name, own in by_component.items():
        shape = _share_shape(ParametricShape(scene, name, superelements[name], tuple(law for law in own if not moves(law))), shapes)
        components[name] = ParametricComponent(scene.machine.components[name], shape, tuple(own))
    joints = {name: ParametricJoint(scene.machine.joints[name], tuple(own)) for name, own in by_joint.items()}
    touched = {parameter.name: _find_touched(parameter.name, components, joints) for parameter in parameters}
    return ParametricScene(scene, superelements, laws, components, joints, touched)


def find_laws(raw: Mapping[str, Any], parameters: Iterable[Parameter]) -> tuple[KeyLaw, ...]:
    """Laws of the keys of a parsed scene that follow parameters, where they hold numbers."""
    rules: dict[KeyPath, list[tuple[Parameter, KeyRule]]] = {}
    for parameter in parameters:
        for rule in parameter.rules:
            rules.setdefault(rule.key, []).append((parameter, rule))
    laws = []
    for key, found in rules.items():
        if holds_number(raw, key):
            quantity = read_number(raw, key)
            laws.append(KeyLaw(key, quantity.value, quantity.dimension, tuple(found)))
    return tuple(laws)


def holds_number(raw: Mapping[str, Any], key: KeyPath) -> bool:
    """Whether a parsed scene holds a number at a key."""
    if not find_keys(raw, key):
        return False
    try:
        read_number(raw, key)
    except ValueError:
        return False
    return True


def _share_shape(shape: ParametricShape, known: list[ParametricShape]) -> ParametricShape:
    """One that is made alike where there is one: it is built once for all."""
    content = shape.content()
    for other in known:
        if shape.laws and other.content() == content:
            return other
    known.append(shape)
    return shape


def _made_of(raw: Mapping[str, Any], material: str) -> list[str]:
    return [name for name, entry in raw["components"].items() if entry.get("material") == material]


def _find_touched(parameter: str, components: dict[str, ParametricComponent], joints: dict[str, ParametricJoint]) -> Touched:
    mine = {name: _laws_of(parameter, entry.laws) for name, entry in components.items()}
    moved = {name: _laws_of(parameter, entry.laws) for name, entry in joints.items()}
    found = tuple(name for name, laws in mine.items() if laws)
    return Touched(
        components=found,
        joints=tuple(name for name, laws in moved.items() if laws),
        stiffness_only=not found
        and all(law.key[2] == "stiffness" for laws in moved.values() for law in laws)
        and all(joints[name].written.screw is None for name, laws in moved.items() if laws),
        matrices=any(not moves(law) for laws in mine.values() for law in laws),
    )


def _laws_of(parameter: str, laws: Iterable[KeyLaw]) -> list[KeyLaw]:
    return [law for law in laws if any(other.name == parameter for other, _ in law.rules)]

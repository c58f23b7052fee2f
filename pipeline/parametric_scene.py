"""A scene whose numbers follow parameters: only the entries a parameter touches are built anew."""

import dataclasses
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pydantic import ValidationError

from headstock.geometry.components import Component
from headstock.geometry.joints import Joint
from headstock.geometry.machines import Machine
from headstock.meshing.component_meshing import describe_component
from headstock.pipeline.component_builder import NO_MATERIAL, build_component, build_material, build_solid
from headstock.pipeline.identification_targets import KeyRule, Parameter
from headstock.pipeline.joint_kinds import build_joint, find_joint_faults
from headstock.pipeline.patch_checks import find_patch_fault
from headstock.pipeline.scene import Scene
from headstock.pipeline.scene_errors import show_key
from headstock.pipeline.scene_keys import NUMBER, find_keys, read_number, replace_numbers
from headstock.pipeline.schema_components import ComponentTable, MaterialTable
from headstock.pipeline.schema_connections import JointTable
from headstock.pipeline.toml_positions import KeyPath
from headstock.pipeline.units import Dimension, Quantity
from headstock.reduction.rigid_reduction import reduce_rigid
from headstock.reduction.segmented_reduction import reduce_segmented
from headstock.reduction.superelement import Superelement
from headstock.solvers.errors import ModelError

REMEMBERED = 256  # builds of one entry that are kept


class ParameterValueError(ModelError):
    """A value of a parameter with which the scene cannot be built."""


@dataclass(frozen=True)
class KeyLaw:
    """How one number of a scene follows the parameters.

    Attributes:
        key: Its key.
        written: Its value in the scene, SI.
        dimension: What it measures.
        rules: Parameter and rule, in the order of the file.
    """

    key: KeyPath
    written: float
    dimension: Dimension
    rules: tuple[tuple[Parameter, KeyRule], ...]

    def value(self, values: Mapping[str, float]) -> float:
        """The number for given parameter values, SI: what sets it, times what multiplies it, plus what shifts it."""
        result, shift = self.written, 0.0
        for parameter, rule in self.rules:
            p = values[parameter.name]
            if rule.kind == "set":
                result = rule.factor * p + rule.offset
        for parameter, rule in self.rules:
            p = values[parameter.name]
            if rule.kind == "multiply":
                result *= (p / parameter.reference) ** rule.factor
            elif rule.kind == "shift":
                shift += rule.factor * (p - parameter.reference)
        return result + shift


@dataclass(frozen=True, eq=False)
class BuiltEntries:
    """A machine with some entries built anew, and the superelements of all of its components."""

    machine: Machine
    superelements: dict[str, Superelement]


@dataclass(eq=False)
class ParametricScene:
    """One variant of a scene whose numbers follow parameters.

    Attributes:
        scene: As written.
        superelements: Of the scene as written.
        laws: Of the keys that follow a parameter.
        touched: Parameter to the names of the components and of the joints it changes.
    """

    scene: Scene
    superelements: dict[str, Superelement]
    laws: tuple[KeyLaw, ...]
    touched: dict[str, tuple[tuple[str, ...], tuple[str, ...]]]
    _entry_laws: dict[tuple[str, str], tuple[KeyLaw, ...]] = field(default_factory=dict)
    _known: dict[tuple[str, str], OrderedDict[tuple[float, ...], Any]] = field(default_factory=dict)

    def build(self, values: Mapping[str, float]) -> BuiltEntries:
        """The machine and its superelements for given parameter values.

        Raises:
            ParameterValueError: The scene cannot be built with them.
        """
        components, joints = dict(self.scene.machine.components), dict(self.scene.machine.joints)
        superelements = dict(self.superelements)
        for section, name in self._entry_laws:
            if section == "components":
                components[name], superelements[name] = self._remember(section, name, values, self._build_component)
            else:
                joints[name] = self._remember(section, name, values, self._build_joint)
        machine = dataclasses.replace(self.scene.machine, components=components, joints=joints)
        return BuiltEntries(machine, superelements)

    def _remember[T](
        self, section: str, name: str, values: Mapping[str, float], build: Callable[[str, Mapping[KeyPath, float]], T]
    ) -> T:
        laws = self._entry_laws[section, name]
        numbers = tuple(law.value(values) for law in laws)
        known = self._known.setdefault((section, name), OrderedDict())
        if numbers not in known:
            quantities = {law.key: number for law, number in zip(laws, numbers, strict=True)}
            try:
                known[numbers] = build(name, quantities)
            except (ValidationError, ValueError) as error:
                raise ParameterValueError(f"{section}.{name}: {_explain(error)}") from error
            if len(known) > REMEMBERED:
                known.popitem(last=False)
        found: T = known[numbers]
        return found

    def _build_joint(self, name: str, numbers: Mapping[KeyPath, float]) -> Joint:
        table = JointTable.model_validate(self._entry("joints", name, numbers))
        for fault in find_joint_faults(table):
            raise ValueError(f"{'.'.join(fault.key)}: {fault.message}")
        return build_joint(name, table)

    def _build_component(self, name: str, numbers: Mapping[KeyPath, float]) -> tuple[Component, Superelement]:
        table = ComponentTable.model_validate(self._entry("components", name, numbers))
        solid = build_solid(table.solid, self.scene.path.parent)
        if table.material is None:
            material = NO_MATERIAL
        else:
            entry = self._entry("materials", table.material, numbers)
            material = build_material(table.material, MaterialTable.model_validate(entry))
        written = self.scene.machine.components[name]
        stations = {key: interface.rail.stations for key, interface in written.interfaces.items() if interface.rail is not None}
        component = build_component(name, table, solid, material, free=False, stations=stations)
        component = dataclasses.replace(component, free=written.free, reduction=written.reduction)
        if component.fidelity == "elastic":
            return component, _rescale(self.superelements[name], written, component)
        for key, interface in table.interfaces.items():
            for patch in interface.patch_tables():
                if fault := find_patch_fault(patch, solid):
                    raise ValueError(f"interfaces.{key}: {fault}")
        reduce = reduce_rigid if component.fidelity == "rigid" else reduce_segmented
        loads = tuple(load for load in self.scene.machine.loads.values() if load.component == name)
        return component, reduce(component, describe_component(component), loads)

    def _entry(self, section: str, name: str, numbers: Mapping[KeyPath, float]) -> Any:
        dimensions = {law.key: law.dimension for law in self.laws}
        own = {
            key[2:]: number if dimensions[key] == NUMBER else Quantity(number, dimensions[key])
            for key, number in numbers.items()
            if key[:2] == (section, name)
        }
        return replace_numbers(self.scene.raw[section][name], own)


def make_parametric(scene: Scene, superelements: dict[str, Superelement], parameters: Iterable[Parameter]) -> ParametricScene:
    """Tie the numbers of a variant to parameters; keys the variant does not hold as numbers are left out.

    Args:
        scene: The variant.
        superelements: Of its components as written.
        parameters: Their rules name keys of the scene.
    """
    laws = find_laws(scene.raw, parameters)
    entries: dict[tuple[str, str], list[KeyLaw]] = {}
    touched: dict[str, tuple[set[str], set[str]]] = {parameter.name: (set(), set()) for parameter in parameters}
    for law in laws:
        section, name = str(law.key[0]), str(law.key[1])
        owners = [(section, name)]
        if section == "materials":
            owners = [("components", other) for other, table in scene.raw["components"].items() if table.get("material") == name]
        for owner in owners:
            entries.setdefault(owner, []).append(law)
            for parameter, _ in law.rules:
                touched[parameter.name][0 if owner[0] == "components" else 1].add(owner[1])
    return ParametricScene(
        scene,
        superelements,
        laws,
        {name: (tuple(sorted(parts)), tuple(sorted(joints))) for name, (parts, joints) in touched.items()},
        {owner: tuple(found) for owner, found in entries.items()},
    )


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


def _rescale(superelement: Superelement, before: Component, after: Component) -> Superelement:
    """An elastic superelement for another modulus, density or mass: shapes and modal dofs stay as they are, which is exact."""
    stiffer = 1.0
    if after.material.youngs_modulus != before.material.youngs_modulus:
        stiffer = after.material.youngs_modulus / before.material.youngs_modulus
    if after.mass is not None and before.mass is not None:
        heavier = after.mass / before.mass
    else:
        heavier = 1.0 if after.mass is not None else after.material.density / (before.material.density or 1.0)
        heavier = heavier if before.material.density else 1.0
    if stiffer == 1.0 and heavier == 1.0:
        return superelement
    return dataclasses.replace(
        superelement,
        stiffness=np.asarray(stiffer * superelement.stiffness),
        mass=np.asarray(heavier * superelement.mass),
        mass_kg=heavier * superelement.mass_kg,
        inertia=np.asarray(heavier * superelement.inertia),
        modal_frequencies_hz=np.asarray(np.sqrt(stiffer / heavier) * superelement.modal_frequencies_hz),
        cutoff_hz=float(np.sqrt(stiffer / heavier) * superelement.cutoff_hz),
    )


def _explain(error: Exception) -> str:
    if isinstance(error, ValidationError):
        detail = error.errors(include_url=False)[0]
        return f"{show_key(tuple(part for part in detail['loc'] if part != '[key]'))} {detail['msg']}"
    return str(error)

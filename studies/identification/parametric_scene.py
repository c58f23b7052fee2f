"""A scene whose numbers follow parameters: only components and joints that a parameter touches are
built anew.
"""

import dataclasses
import itertools
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.linalg
from pydantic import ValidationError
from scipy.optimize import linear_sum_assignment

from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import FloatArray, Frame
from headstock.geometry.machine.joints import ContactLayer, Joint
from headstock.geometry.machine.machine import Machine, Sensor
from headstock.geometry.parts.components import (
    Component,
    Load,
    ReductionSettings,
    with_loaded_areas,
)
from headstock.meshing.components.meshing import describe_component
from headstock.pipeline.stages.run_state import MachineParts
from headstock.reduction.components.polynomial import reduce_polynomial
from headstock.reduction.components.rigid import reduce_rigid
from headstock.reduction.components.segmented import reduce_segmented
from headstock.reduction.components.sensors import carry_masses, drop_masses
from headstock.reduction.requests import ReductionRequest, mode_target
from headstock.reduction.scaled_material import scale_material
from headstock.reduction.superelement import Superelement
from headstock.scene.building.components import (
    NO_MATERIAL,
    build_component,
    build_material,
    build_solid,
    find_patch_fault,
)
from headstock.scene.building.joints import KINDS
from headstock.scene.expansion.parameters import PARAMETERS
from headstock.scene.reading.findings import KeyPath, show_key
from headstock.scene.reading.keys import NUMBER, ReadValue, read_entries, replace_numbers
from headstock.scene.reading.units import RATIO, Quantity
from headstock.scene.scene import Scene
from headstock.scene.schema.components import ComponentTable, MaterialTable
from headstock.studies.identification.key_laws import (
    KeyLaw,
    ParameterValueError,
    find_laws,
    remember,
)
from headstock.studies.identification.targets import Parameter

# neighbours nearer than this share of their frequency are turned together: two bending modes of a
# square section are any two of their plane
CLOSE = 0.02
# of joints, whose matrices they change in proportion
SPRING_KEYS = ("stiffness", "damping", "loss_factor")
# of a patch that a layer covers: differences at the whole patch reach beyond it
WHOLE = 1.01
# how far apart in ln f two modes cost as much as no likeness at all
FAR = 0.5


@dataclass(eq=False)
class _ParametricJoint:
    """A joint whose stiffness, damping and place follow parameters."""

    written: Joint
    laws: tuple[KeyLaw, ...]

    def build(self, values: Mapping[str, float]) -> Joint:
        """The joint for given parameter values.

        Raises:
            ParameterValueError: A stiffness or damping is negative.
        """
        written = self.written
        matrices: dict[str, Any] = {
            name: getattr(written, name).copy() for name in ("stiffness", "damping")
        }
        point = None if written.point is None else written.point.copy()
        changed: dict[str, Any] = {}
        layer = {} if written.layer is None else dataclasses.asdict(written.layer)
        for law in self.laws:
            number, what = law.value(values), str(law.key[2])
            if what == "at" and point is not None:
                point[int(law.key[3])] = number
                continue
            if number < 0.0 <= law.written:
                raise ParameterValueError(
                    f"{show_key(law.key)} is {number:g} in SI units, below zero"
                )
            if what in matrices:
                for dof in self.dofs(law):
                    matrices[what][dof, dof] = number
            elif what == "stiffness_per_area":
                if law.key[3] == "covers" and not 0.0 < number <= WHOLE:
                    raise ParameterValueError(
                        f"{show_key(law.key)} is {number:g}, not within 0 to 1"
                    )
                layer[str(law.key[3])] = number
            elif what == "loss_factor":
                changed[what] = number
        if layer:
            changed["layer"] = ContactLayer(**layer)
        return dataclasses.replace(written, point=point, **matrices, **changed)

    def dofs(self, law: KeyLaw) -> tuple[int, ...]:
        """Joint dofs that the stiffness or damping of a law acts on."""
        return KINDS[self.written.kind].keys[str(law.key[3])]


@dataclass(eq=False)
class _ParametricShape:
    """What a component is made of: solid, interfaces, mass and material, wherever it stands. An
    elastic one whose shape follows a parameter is meshed and reduced anew.

    Attributes:
        name: Component it is read from; others of the same content share it.
        laws: Of its keys and of those of its material, places left out.
        reduce: Meshes and reduces a changed component.
    """

    scene: Scene
    name: str
    superelement: Superelement
    laws: tuple[KeyLaw, ...]
    reduce: Callable[[Component], Superelement]
    _known: OrderedDict[tuple[float, ...], tuple[Component, Superelement]] = field(
        default_factory=OrderedDict
    )

    def build(self, values: Mapping[str, float]) -> tuple[Component, Superelement]:
        """A component where the scene puts this one, and its superelement.

        Raises:
            ParameterValueError: It cannot be built with these values.
        """
        numbers = tuple(law.value(values) for law in self.laws)
        try:
            return remember(self._known, numbers, lambda: self._make(numbers))
        except (ValidationError, ValueError, HeadstockError) as error:
            raise ParameterValueError(f"components.{self.name}: {_explain(error)}") from error

    def content(self) -> tuple[object, ...]:
        """Return what decides what is built, name and place left out; to be compared only."""
        entry = {
            key: value
            for key, value in read_entries(self.scene.raw, "components")[self.name].items()
            if key != "at"
        }
        material = read_entries(self.scene.raw, "materials").get(str(entry.get("material")))
        laws = [
            (law.key[2:] if law.key[0] == "components" else law.key, law.content())
            for law in self.laws
        ]
        loads = [dataclasses.replace(load, component="") for load in self._loads()]
        sensors = [dataclasses.replace(sensor, component="") for sensor in self._sensors()]
        rails = {
            key: item.rail
            for key, item in self.scene.machine.components[self.name].interfaces.items()
        }
        return entry, material, laws, loads, sensors, rails, self.scene.path

    def _make(self, numbers: tuple[float, ...]) -> tuple[Component, Superelement]:
        written = self.scene.machine.components[self.name]
        if not self.laws:
            return written, self.superelement
        table = ComponentTable.model_validate(self._entry("components", self.name, numbers))
        solid = build_solid(table.solid, self.scene.path.parent)
        material = NO_MATERIAL
        if table.material is not None:
            entry = self._entry("materials", table.material, numbers)
            material = build_material(table.material, MaterialTable.model_validate(entry))
        control_points = {
            key: item.rail.control_points
            for key, item in written.interfaces.items()
            if item.rail is not None
        }
        component = build_component(
            self.name,
            table,
            solid,
            material,
            sizes=written.mesh.sizes,
            free=written.free,
            control_points=control_points,
        )
        component = dataclasses.replace(component, reduction=written.reduction)
        if component.fidelity == "elastic" and not any(map(_reshapes, self.laws)):
            return component, self._rescale(written, component)
        for key, interface in table.interfaces.items():
            for patch in interface.patch_tables():
                if fault := find_patch_fault(patch, solid):
                    raise ValueError(f"interfaces.{key}: {fault}")
        if component.fidelity == "elastic":
            known = self.superelement
            # without those of forces at sensors, which lie beyond and come anyway
            count = int((known.modal_frequencies_hz < known.cutoff_hz).sum())
            settings = ReductionSettings(modes=count)
            made = self.reduce(dataclasses.replace(component, reduction=settings))
            return component, _match_modal_dofs(self.superelement, made)
        loads, sensors = self._loads(), self._sensors()
        properties = describe_component(with_loaded_areas(component, loads))
        if component.fidelity == "polynomial":
            request = ReductionRequest(modes=mode_target(component))
            reduced = reduce_polynomial(component, properties, loads, sensors, request=request)
        else:
            reduce = reduce_rigid if component.fidelity == "rigid" else reduce_segmented
            reduced = reduce(component, properties, loads, sensors)
        return component, carry_masses(reduced, sensors)

    def _rescale(self, before: Component, after: Component) -> Superelement:
        """The elastic superelement for another modulus, density or mass; point masses stay."""
        stiffer = _ratio(after.material.youngs_modulus, before.material.youngs_modulus)
        heavier = (
            _ratio(after.mass, before.mass)
            if after.mass is not None
            else _ratio(after.material.density, before.material.density)
        )
        if stiffer == 1.0 and heavier == 1.0:
            return self.superelement
        sensors = self._sensors()
        bare = drop_masses(self.superelement, sensors)
        bodies = [load.name for load in self._loads() if load.kind == "body"]
        # what is seen at probes takes no part in a fit
        bare = dataclasses.replace(bare, probes={})
        scaled = scale_material(bare, stiffer=stiffer, heavier=heavier, body_loads=bodies)
        return carry_masses(scaled, sensors)

    def _entry(self, section: str, name: str, numbers: tuple[float, ...]) -> ReadValue:
        by_key: dict[KeyPath, float | Quantity] = {
            law.key[2:]: number
            if law.dimension in (NUMBER, RATIO)
            else Quantity(number, law.dimension)
            for law, number in zip(self.laws, numbers, strict=True)
            if law.key[:2] == (section, name)
        }
        return replace_numbers(read_entries(self.scene.raw, section)[name], by_key)

    def _sensors(self) -> tuple[Sensor, ...]:
        sensors = self.scene.machine.sensors.values()
        return tuple(sensor for sensor in sensors if sensor.component == self.name)

    def _loads(self) -> tuple[Load, ...]:
        return tuple(
            load for load in self.scene.machine.loads.values() if load.component == self.name
        )


@dataclass(frozen=True, eq=False)
class _ParametricComponent:
    """A component whose shape and place follow parameters.

    Attributes:
        shape: What it is made of; shared with components that are made alike.
    """

    written: Component
    shape: _ParametricShape
    laws: tuple[KeyLaw, ...]

    def build(self, values: Mapping[str, float]) -> tuple[Component, Superelement]:
        """The component and its superelement for given parameter values.

        Raises:
            ParameterValueError: It cannot be built with them.
        """
        made, superelement = self.shape.build(values)
        origin = self.written.placement.origin.copy()
        for law in self.laws:
            if moves(law):
                origin[int(law.key[3])] = law.value(values)
        name = self.written.name
        component = dataclasses.replace(
            made, name=name, placement=Frame(origin, made.placement.rotation)
        )
        return component, superelement if superelement.name == name else dataclasses.replace(
            superelement, name=name
        )


def moves(law: KeyLaw) -> bool:
    """Tell whether a law is of a component's place and of nothing else."""
    return law.key[0] == "components" and law.key[2] == "at"


def _reshapes(law: KeyLaw) -> bool:
    """Whether an elastic component has to be meshed or reduced anew for another value."""
    return law.key[2] in ("solid", "interfaces", "mesh", "nu")


def _ratio(after: float | None, before: float | None) -> float:
    return after / before if after and before else 1.0


def _explain(error: Exception) -> str:
    if isinstance(error, ValidationError):
        detail = error.errors(include_url=False)[0]
        return (
            f"{show_key(tuple(part for part in detail['loc'] if part != '[key]'))} {detail['msg']}"
        )
    return str(error)


@dataclass(frozen=True, eq=False)
class _BuiltScene:
    """A machine with the superelements of all of its components."""

    machine: Machine
    superelements: dict[str, Superelement]


@dataclass(frozen=True, eq=False)
class _Touched:
    """What a parameter changes.

    Attributes:
        joints: By name: their stiffness or their own place.
        springs_only: Nothing but springs and dampers of joints, none of them in series with a screw.
        matrices: The superelement of a component changes too, not only places.
        meshed: Elastic components that are meshed and reduced anew.
    """

    components: tuple[str, ...]
    joints: tuple[str, ...]
    springs_only: bool
    matrices: bool
    meshed: tuple[str, ...] = ()

    @property
    def any(self) -> bool:
        """The parameter changes anything."""
        return bool(self.components or self.joints)


@dataclass(frozen=True, eq=False)
class ParametricScene:
    """One variant of a scene whose numbers follow parameters.

    Attributes:
        laws: Of the keys that follow a parameter.
        components: Those that follow a parameter.
        joints: Those that follow a parameter.
        parts: The machine as it was reduced, for what its meshes leave out; None where nobody asks.
    """

    scene: Scene
    superelements: dict[str, Superelement]
    laws: tuple[KeyLaw, ...]
    components: dict[str, _ParametricComponent]
    joints: dict[str, _ParametricJoint]
    touched: dict[str, _Touched]
    parts: MachineParts | None = None

    def reduce_to(self, values: Mapping[str, float]) -> MachineParts | None:
        """Return the machine as reduced, for given parameter values."""
        if self.parts is None:
            return None
        built, plan = self.build(values), self.parts.plan
        reduced = {
            name: dataclasses.replace(item, superelement=built.superelements[name])
            for name, item in self.parts.reduced.items()
        }
        components = {name: built.machine.components[name] for name in plan.components}
        return MachineParts(
            dataclasses.replace(self.scene, machine=built.machine),
            dataclasses.replace(plan, components=components),
            reduced,
        )

    def build(self, values: Mapping[str, float]) -> _BuiltScene:
        """The machine and its superelements for given parameter values.

        Raises:
            ParameterValueError: The scene cannot be built with them.
        """
        components, superelements = dict(self.scene.machine.components), dict(self.superelements)
        for name, component in self.components.items():
            components[name], superelements[name] = component.build(values)
        joints = self.scene.machine.joints | {
            name: joint.build(values) for name, joint in self.joints.items()
        }
        return _BuiltScene(
            dataclasses.replace(self.scene.machine, components=components, joints=joints),
            superelements,
        )


def make_parametric(
    scene: Scene,
    superelements: dict[str, Superelement],
    parameters: Sequence[Parameter],
    others: Iterable[ParametricScene] = (),
    *,
    reduce: Callable[[Component], Superelement],
) -> ParametricScene:
    """Tie the numbers of a variant to parameters; keys the variant does not hold as numbers are
    left out.

    Args:
        parameters: Their rules name keys of the scene.
        others: Other variants; a component that is the same there is built once for all.
        reduce: Meshes and reduces a component of the variant whose shape has changed.
    """
    laws = find_laws(scene, parameters)
    by_component: dict[str, list[KeyLaw]] = {}
    by_joint: dict[str, list[KeyLaw]] = {}
    written = read_entries(scene.raw, "components")
    for law in laws:
        section, name = str(law.key[0]), str(law.key[1])
        if section == "joints":
            by_joint.setdefault(name, []).append(law)
        elif section != PARAMETERS:
            for owner, entry in written.items():
                if owner == name if section == "components" else entry.get("material") == name:
                    by_component.setdefault(owner, []).append(law)
    shapes = [component.shape for other in others for component in other.components.values()]
    components = {}
    for name, own_laws in by_component.items():
        shape = _share_shape(
            _ParametricShape(
                scene,
                name,
                superelements[name],
                tuple(law for law in own_laws if not moves(law)),
                reduce,
            ),
            shapes,
        )
        components[name] = _ParametricComponent(
            scene.machine.components[name], shape, tuple(own_laws)
        )
    joints = {
        name: _ParametricJoint(scene.machine.joints[name], tuple(own_laws))
        for name, own_laws in by_joint.items()
    }
    touched = {
        parameter.name: _find_touched(parameter.name, components, joints)
        for parameter in parameters
    }
    return ParametricScene(scene, superelements, laws, components, joints, touched)


def _share_shape(shape: _ParametricShape, known: list[_ParametricShape]) -> _ParametricShape:
    """One that is made alike where there is one: it is built once for all."""
    content = shape.content()
    for other in known:
        if shape.laws and other.content() == content:
            return other
    known.append(shape)
    return shape


def _find_touched(
    parameter: str, components: dict[str, _ParametricComponent], joints: dict[str, _ParametricJoint]
) -> _Touched:
    parts, links = _find_followers(parameter, components), _find_followers(parameter, joints)
    elastic = [name for name in parts if components[name].written.fidelity == "elastic"]
    return _Touched(
        components=tuple(parts),
        joints=tuple(links),
        springs_only=not parts
        and all(law.key[2] in SPRING_KEYS for law in itertools.chain(*links.values()))
        # the stiffness of screws and layers is not in the six directions of a joint
        and all(not (joints[name].written.screw or joints[name].written.layer) for name in links),
        matrices=not all(map(moves, itertools.chain(*parts.values()))),
        meshed=tuple(name for name in elastic if any(map(_reshapes, parts[name]))),
    )


def _find_followers(
    parameter: str, entries: Mapping[str, _ParametricComponent] | Mapping[str, _ParametricJoint]
) -> dict[str, list[KeyLaw]]:
    """Return the laws of what depends on a parameter, by name."""
    laws = {
        name: [law for law in entry.laws if law.depends_on(parameter)]
        for name, entry in entries.items()
    }
    return {name: follow for name, follow in laws.items() if follow}


def _match_modal_dofs(before: Superelement, after: Superelement) -> Superelement:
    """Return a component that was meshed and reduced anew with its modal dofs in the order and with
    the signs they had before: only then have differences of its matrices a meaning.

    Modes are compared by how they are coupled to the boundary through the mass matrix.

    Args:
        after: Of the changed component; as many boundary and modal dofs.
    """
    size, count = before.boundary_size, min(before.modal_count, after.modal_count)
    if count == 0 or before.modal_count != after.modal_count:
        return after
    wanted, reduced = (
        _couplings(part.mass[size:, :size], before.node_size) for part in (before, after)
    )
    logs = [np.log(part.modal_frequencies_hz) for part in (before, after)]
    alike = np.abs(wanted @ reduced.T) / np.outer(_sizes(wanted), _sizes(reduced))
    order = linear_sum_assignment(alike - np.abs(np.subtract.outer(*logs)) / FAR, maximize=True)[1]
    turned = np.zeros((count, count))
    start = 0
    for end in range(1, count + 1):
        if end == count or logs[0][end] - logs[0][end - 1] > CLOSE:
            group = slice(start, end)
            left, _, right = np.linalg.svd(wanted[group] @ reduced[order[group]].T)
            turned[group, order[group]] = left @ right
            start = end
    turn = scipy.linalg.block_diag(np.eye(size), turned)
    return dataclasses.replace(
        after,
        stiffness=turn @ after.stiffness @ turn.T,
        mass=turn @ after.mass @ turn.T,
        damping=None if after.damping is None else turn @ after.damping @ turn.T,
        constraints=after.constraints @ turn.T,
        recovery=None,
        sensors={
            name: dataclasses.replace(rows, motion=rows.motion @ turn.T)
            for name, rows in after.sensors.items()
        },
        modal_frequencies_hz=after.modal_frequencies_hz[order],
    )


def _couplings(mass: FloatArray, nodes: int) -> FloatArray:
    """Coupling of each mode ``(m, b)`` to the boundary; rotations at the scale of translations."""
    scaled = mass.copy()
    turns = np.arange(nodes) % 6 > 2
    sizes = [float(np.linalg.norm(mass[:, :nodes][:, part])) for part in (~turns, turns)]
    if min(sizes) > 0.0:
        scaled[:, :nodes][:, turns] *= sizes[0] / sizes[1]
    return scaled


def _sizes(couplings: FloatArray) -> FloatArray:
    """Length of each row, far above the noise of a mode that no boundary drives."""
    sizes = np.linalg.norm(couplings, axis=1)
    return np.maximum(sizes, 1e-6 * sizes.max(initial=np.finfo(float).tiny))

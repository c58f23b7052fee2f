"""What each kind of joint holds, frees and springs, and the 6x6 matrices its scene keys stand
for.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from headstock.geometry.frames import DOF_NAMES, FloatArray, frame_axes
from headstock.geometry.machine.joints import ContactLayer, Joint, JointEnd, ScrewShaft
from headstock.geometry.parts.patches import Outline, patch_outline
from headstock.scene.building.components import build_patch
from headstock.scene.building.draft import Draft, is_known_end
from headstock.scene.reading.findings import KeyPath
from headstock.scene.reading.units import (
    DAMPING,
    ROTATIONAL_DAMPING,
    ROTATIONAL_STIFFNESS,
    STIFFNESS,
    Quantity,
)
from headstock.scene.schema.components import find_poisson_fault
from headstock.scene.schema.joints import JointTable, ScrewTable
from headstock.scene.schema.scene import SceneTable

RIGID = "rigid"
EVERY_DOF = (0, 1, 2, 3, 4, 5)
SAME_SIZE = 1e-6
# Young's modulus [Pa] and Poisson's ratio of a screw whose table gives none
SCREW_STEEL = (
    210e9,
    0.3,
)
_DIMENSIONS = {
    ("stiffness", False): STIFFNESS,
    ("stiffness", True): ROTATIONAL_STIFFNESS,
    ("damping", False): DAMPING,
    ("damping", True): ROTATIONAL_DAMPING,
}


@dataclass(frozen=True)
class _JointKindRule:
    """One kind of joint.

    Attributes:
        keys: Scene key to the joint dofs (0..5) it stands for; each dof belongs to one key.
        required: Keys without which the joint means nothing.
        axis_is: Joint axis that the scene's ``axis`` gives: ``x`` or ``z``.
        needs_axis: The scene must give ``axis``.
        needs_normal: The scene must give ``normal``.
    """

    keys: Mapping[str, tuple[int, ...]]
    required: tuple[str, ...] = ()
    fixed: tuple[int, ...] = ()
    axis_is: str = "x"
    needs_axis: bool = False
    needs_normal: bool = False


_DOFS: dict[str, tuple[int, ...]] = {name: (index,) for index, name in enumerate(DOF_NAMES)}


def _ideal(*free: str, needs_axis: bool = True, needs_normal: bool = False) -> _JointKindRule:
    keys = {name: _DOFS[name] for name in free}
    fixed = tuple(index for index, name in enumerate(DOF_NAMES) if name not in free)
    return _JointKindRule(keys, fixed=fixed, needs_axis=needs_axis, needs_normal=needs_normal)


KINDS: dict[str, _JointKindRule] = {
    "rigid": _ideal(needs_axis=False),
    "spring": _JointKindRule(_DOFS),
    "linear_guide": _JointKindRule(
        {"lateral": (1,), "normal": (2,), "roll": (3,), "pitch": (4,), "yaw": (5,)},
        ("lateral", "normal"),
        needs_axis=True,
    ),
    "ball_screw": _JointKindRule({"axial": (0,), "torsion": (3,)}, ("axial",), needs_axis=True),
    "bearing": _JointKindRule(
        {"axial": (0,), "radial": (1, 2), "torsion": (3,), "tilt": (4, 5)},
        ("radial",),
        needs_axis=True,
    ),
    "bolted": _JointKindRule(
        {"shear": (0, 1), "normal": (2,), "tilt": (3, 4), "torsion": (5,)},
        ("normal", "shear"),
        axis_is="z",
    ),
    "mount": _JointKindRule(
        {"horizontal": (0, 1), "vertical": (2,), "tilt": (3, 4), "torsion": (5,)},
        ("vertical", "horizontal"),
        axis_is="z",
    ),
    "revolute": _ideal("rx"),
    "universal": _ideal("rx", "rz", needs_normal=True),
    "spherical": _ideal("rx", "ry", "rz", needs_axis=False),
    "prismatic": _ideal("x"),
}


class _JointFault(NamedTuple):
    """A problem of a joint's table: the key below it and what to write."""

    key: tuple[str, ...]
    message: str


type _Faults = Iterator[tuple[tuple[str, ...], str]]


def check_joints(draft: Draft) -> None:
    """Report what is wrong with joints: their ends, their names and what their kind asks for."""
    for name, joint in draft.table.joints.items():
        key: KeyPath = ("joints", name, "between")
        for index, end in enumerate(joint.between):
            draft.check_end((*key, index), end)
        for part in ("second_end", "floating_end") if joint.screw is not None else ():
            if (named := getattr(joint.screw, part)) is not None:
                draft.check_end(("joints", name, "screw", part), named)
        first, second = joint.between
        if first.component == second.component:
            what = f"component {first.component!r}" if first.component else "ground"
            draft.add(
                key,
                f"joint {name!r} has both ends on {what}: it has no effect; name two different components",
            )
        if name in draft.sections.get("components", ()):
            draft.add(
                ("joints", name),
                f"a component is called {name!r} too; results name both, so choose another name",
            )
        if joint.stiffness_per_area is not None:
            for end in joint.between:
                _check_layer_end((*key[:2], "stiffness_per_area"), end, draft)
        if KINDS[joint.kind].fixed == EVERY_DOF or joint.stiffness_per_area is not None:
            _check_areas(name, joint, draft)
        for fault in find_joint_faults(joint):
            draft.add(("joints", name, *fault.key), fault.message)


def _check_layer_end(key: KeyPath, end: JointEnd, draft: Draft) -> None:
    """Elastic bodies need deformation shapes there, without which nothing says how they deform."""
    component, interface = draft.table.interface_at(end) or (None, None)
    if component is None or interface is None or component.fidelity != "elastic":
        return
    if component.solid.superelement is None and not interface.flexible:
        draft.add(
            key,
            f"needs the deformation shapes of {end}; write coupling = {{ flexible = 24 }} there",
        )


def _check_areas(name: str, joint: JointTable, draft: Draft) -> None:
    """Two flexible interfaces that share their shapes have areas of one size, as far as they are
    known before anything is meshed.
    """
    areas: dict[str, Outline] = {}
    for end in joint.between:
        component, interface = draft.table.interface_at(end) or (None, None)
        solid = draft.solids.get(end.component or "")
        if component is None or interface is None or solid is None or not interface.flexible:
            continue
        tables = interface.patch_tables()
        outline = patch_outline(solid, build_patch(tables[0], solid)) if len(tables) == 1 else None
        if component.fidelity == "elastic" and outline is not None:
            areas[str(end)] = outline
    if len(areas) == 2 and not _have_one_size(*areas.values()):
        words = " and ".join(f"{end} is {outline}" for end, outline in areas.items())
        draft.add(
            ("joints", name, "between"),
            f'shares deformation shapes, but {words}; write a rect or disk of one size for both, or coupling = "rigid" for one',
        )


def _have_one_size(one: Outline, other: Outline) -> bool:
    if (one.hole is None) != (other.hole is None):
        return False
    sides = [np.sort(outline.half_lengths) for outline in (one, other)]
    holes = [outline.hole or 0.0 for outline in (one, other)]
    return bool(np.ptp(np.log(sides), axis=0).max() <= SAME_SIZE and np.ptp(holes) <= SAME_SIZE)


def sound_joints(scene: SceneTable) -> dict[str, JointTable]:
    """Joints whose two ends are known and differ."""
    return {
        name: joint
        for name, joint in scene.joints.items()
        if all(is_known_end(end, scene) for end in joint.between)
        and joint.between[0].component != joint.between[1].component
    }


def find_joint_faults(table: JointTable) -> list[_JointFault]:
    """Everything that is wrong with a joint apart from its ends."""
    parts = (_direction_faults, _spring_faults, _layer_faults, _screw_faults, _value_faults)
    return [_JointFault(*fault) for find in parts for fault in find(table)]


def _direction_faults(table: JointTable) -> _Faults:
    rule = KINDS[table.kind]
    if rule.needs_axis and table.axis is None:
        yield (), f'a {table.kind} needs its axis; write axis = "x"'
    if rule.needs_normal and table.normal is None:
        yield (), f'a {table.kind} needs its second axis; write normal = "z"'
    try:
        _joint_rotation(table)
    except ValueError:
        yield (
            ("normal",),
            "is parallel to axis; write the direction across the face that the joint lies on",
        )


def _spring_faults(table: JointTable) -> _Faults:
    layer = table.stiffness_per_area is not None
    for key in KINDS[table.kind].required if not layer else ():
        if key not in table.stiffness:
            text = f'a {table.kind} needs {key}; write stiffness = {{ {key} = "100 N/um" }}'
            yield ("stiffness",), text
    if table.kind == "spring" and not table.stiffness and not table.damping:
        text = 'a spring needs a stiffness; write stiffness = { z = "100 N/um" }'
        yield ("stiffness",), text
    springs = [value for value in table.stiffness.values() if isinstance(value, Quantity)]
    if table.loss_factor and not springs and not layer:
        text = "a loss factor is a share of a stiffness, and there is none; remove it or write a stiffness"
        yield ("loss_factor",), text


def _layer_faults(table: JointTable) -> _Faults:
    if table.stiffness_per_area is None:
        return
    if table.kind != "bolted":
        text = f'a {table.kind} has no contact layer; remove it, or write kind = "bolted"'
        yield ("stiffness_per_area",), text
    elif table.stiffness:
        text = "is the stiffness of the whole joint; remove it or stiffness_per_area"
        yield ("stiffness",), text


def _screw_faults(table: JointTable) -> _Faults:
    nut, bearing = (end.component for end in table.between)
    if table.screw is None:
        return
    if table.kind != "ball_screw":
        text = f'a {table.kind} has no screw; remove it, or write kind = "ball_screw"'
        yield ("screw",), text
    if table.stiffness.get("axial") == RIGID:
        text = 'the nut of a screw with a shaft has a compliance of its own; write its stiffness, such as axial = "500 N/um"'
        yield ("stiffness", "axial"), text
    if bearing is None:
        text = "the second end is the interface that carries the screw's fixed bearing, not ground"
        yield ("between",), text
    if table.screw.second_end is not None and table.screw.second_end.component == nut:
        text = "is on the component of the first end, which is the nut's; name the nut's interface first and the bearing's second"
        yield ("screw", "second_end"), text
    if table.length is not None:
        text = "the nut has a shaft of its own, so it slides on no rail; remove length or screw"
        yield ("length",), text
    if table.screw.nu is not None and (fault := find_poisson_fault(table.screw.nu)):
        yield ("screw", "nu"), fault


def _value_faults(table: JointTable) -> _Faults:
    keys = KINDS[table.kind].keys
    values = [("stiffness", *item) for item in table.stiffness.items()]
    for part, key, value in [*values, *(("damping", *item) for item in table.damping.items())]:
        if key not in keys:
            remedy = f"keys: {', '.join(keys)}" if keys else 'write kind = "spring"'
            yield (part, key), f"a joint of kind {table.kind!r} has no {part} {key!r}; {remedy}"
        elif isinstance(value, Quantity):
            if part == "damping" and table.stiffness.get(key) == RIGID:
                text = f"{key} is rigid, so damping there does nothing; remove one of them"
                yield (part, key), text
            wanted = _DIMENSIONS[part, keys[key][0] >= 3]
            if value.dimension != wanted:
                text = f'is a {value.dimension.name} but {key} needs a {wanted.name}; write for example "{wanted.example}"'
                yield (part, key), text
            elif value.value < 0.0 and not table.allow_negative:
                text = "is negative; if that is meant, write allow_negative = true in the joint"
                yield (part, key), text


def _joint_rotation(table: JointTable) -> FloatArray:
    """Joint axes ``(3, 3)`` in the machine frame from the scene's ``axis`` and ``normal``.

    Raises:
        ValueError: The two directions are parallel.
    """
    axis = None if table.axis is None else np.array(table.axis)
    normal = None if table.normal is None else np.array(table.normal)
    if KINDS[table.kind].axis_is == "z":
        if axis is None:
            axis = np.array([0.0, 0.0, 1.0])
        # columns: axis, second, third: a right-handed turn puts the axis last
        side = frame_axes(axis, normal)
        if normal is None:
            return np.column_stack([side[:, 1], side[:, 2], side[:, 0]])
        return frame_axes(normal - (normal @ axis) * axis, axis)
    if axis is None:
        if normal is None:
            return np.eye(3)
        axis = np.array([1.0, 0.0, 0.0])
    return frame_axes(axis, normal)


def build_joint(name: str, table: JointTable) -> Joint:
    """The joint a faultless table stands for."""
    rule = KINDS[table.kind]
    stiffness, damping = np.zeros((6, 6)), np.zeros((6, 6))
    fixed = set(rule.fixed)
    for key, value in table.stiffness.items():
        for dof in rule.keys[key]:
            if isinstance(value, Quantity):
                stiffness[dof, dof] = value.value
            else:
                fixed.add(dof)
    for key, quantity in table.damping.items():
        for dof in rule.keys[key]:
            damping[dof, dof] = 0.0 if dof in fixed else quantity.value
    first, second = table.between
    return table.fill(
        Joint,
        name=name,
        ends=(first, second),
        rotation=_joint_rotation(table),
        fixed=tuple(sorted(fixed)),
        stiffness=stiffness,
        damping=damping,
        point=None if table.at is None else np.array(table.at),
        screw=None if table.screw is None else _build_shaft(table.screw),
        errors=None,  # where the effect guide_errors is on, the loader adds them
        second_axis=np.array(table.normal)
        if table.kind == "universal" and table.normal is not None
        else None,
        layer=None
        if table.stiffness_per_area is None
        else table.stiffness_per_area.fill(ContactLayer),
    )


def _build_shaft(table: ScrewTable) -> ScrewShaft:
    """The shaft of a ball screw, of steel unless the table says otherwise."""
    modulus = SCREW_STEEL[0] if table.E is None else table.E
    shear = modulus / (2.0 * (1.0 + (SCREW_STEEL[1] if table.nu is None else table.nu)))
    return ScrewShaft(
        axial=modulus * math.pi / 4.0 * (table.diameter**2 - table.bore**2),
        torsional=shear * math.pi / 32.0 * (table.diameter**4 - table.bore**4),
        lead=table.lead or 0.0,
        bearing=table.bearing or math.inf,
        coupling=table.coupling or math.inf,
        floating_end=table.floating_end,
        second_end=table.second_end,
        second_bearing=table.second_bearing or math.inf,
        length=table.length or math.inf,
    )


def couple_bearings(name: str, joint: Joint) -> Joint | None:
    """The shaft of a screw as a coupling of its two fixed bearings, whatever the nut does; None
    with a single one.
    """
    shaft = joint.screw
    if shaft is None or shaft.second_end is None:
        return None
    stiffness = np.zeros((6, 6))
    stiffness[0, 0] = 1.0 / (
        1.0 / shaft.bearing + shaft.length / shaft.axial + 1.0 / shaft.second_bearing
    )
    return Joint(
        name,
        (joint.ends[1], shaft.second_end),
        "spring",
        rotation=joint.rotation,
        stiffness=stiffness,
    )

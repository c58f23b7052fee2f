"""What each kind of joint holds, frees and springs, and the 6x6 matrices its scene keys stand
for.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from headstock.geometry.frames import DOF_NAMES, FloatArray, frame_axes
from headstock.geometry.machine.joints import ContactLayer, Joint, JointEnd, ScrewShaft
from headstock.geometry.parts.patches import Outline, patch_outline
from headstock.scene.building.components import build_patch
from headstock.scene.building.draft import Draft, check_end, is_known_end
from headstock.scene.reading.findings import Findings
from headstock.scene.reading.positions import KeyPath
from headstock.scene.reading.units import (
    DAMPING,
    ROTATIONAL_DAMPING,
    ROTATIONAL_STIFFNESS,
    STIFFNESS,
    Quantity,
)
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
class JointKindRule:
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


def _ideal(*free: str, needs_axis: bool = True, needs_normal: bool = False) -> JointKindRule:
    keys = {name: _DOFS[name] for name in free}
    fixed = tuple(index for index, name in enumerate(DOF_NAMES) if name not in free)
    return JointKindRule(keys, fixed=fixed, needs_axis=needs_axis, needs_normal=needs_normal)


KINDS: dict[str, JointKindRule] = {
    "rigid": _ideal(needs_axis=False),
    "spring": JointKindRule(_DOFS),
    "linear_guide": JointKindRule(
        {"lateral": (1,), "normal": (2,), "roll": (3,), "pitch": (4,), "yaw": (5,)},
        ("lateral", "normal"),
        needs_axis=True,
    ),
    "ball_screw": JointKindRule({"axial": (0,), "torsion": (3,)}, ("axial",), needs_axis=True),
    "bearing": JointKindRule(
        {"axial": (0,), "radial": (1, 2), "torsion": (3,), "tilt": (4, 5)},
        ("radial",),
        needs_axis=True,
    ),
    "bolted": JointKindRule(
        {"shear": (0, 1), "normal": (2,), "tilt": (3, 4), "torsion": (5,)},
        ("normal", "shear"),
        axis_is="z",
    ),
    "mount": JointKindRule(
        {"horizontal": (0, 1), "vertical": (2,), "tilt": (3, 4), "torsion": (5,)},
        ("vertical", "horizontal"),
        axis_is="z",
    ),
    "revolute": _ideal("rx"),
    "universal": _ideal("rx", "rz", needs_normal=True),
    "spherical": _ideal("rx", "ry", "rz", needs_axis=False),
    "prismatic": _ideal("x"),
}


@dataclass(frozen=True)
class JointFault:
    """A problem of a joint's table: the key below it and what to write."""

    key: tuple[str, ...]
    message: str


@dataclass
class _Faults:
    found: list[JointFault] = field(default_factory=list)

    def add(self, message: str, *key: str) -> None:
        self.found.append(JointFault(key, message))


def check_joints(draft: Draft, findings: Findings) -> None:
    """Report what is wrong with joints: their ends, their names and what their kind asks for."""
    for name, joint in draft.table.joints.items():
        key: KeyPath = ("joints", name, "between")
        for index, end in enumerate(joint.between):
            check_end((*key, index), end, draft, findings)
        for part in ("second_end", "floating_end") if joint.screw is not None else ():
            if (named := getattr(joint.screw, part)) is not None:
                check_end(("joints", name, "screw", part), named, draft, findings)
        first, second = joint.between
        if first.component == second.component:
            what = f"component {first.component!r}" if first.component else "ground"
            findings.add(
                key,
                f"joint {name!r} has both ends on {what}: it has no effect; name two different components",
            )
        if name in draft.sections.get("components", ()):
            findings.add(
                ("joints", name),
                f"a component is called {name!r} too; results name both, so choose another name",
            )
        if joint.stiffness_per_area is not None:
            for end in joint.between:
                _check_layer_end((*key[:2], "stiffness_per_area"), end, draft, findings)
        if KINDS[joint.kind].fixed == EVERY_DOF or joint.stiffness_per_area is not None:
            _check_areas(name, joint, draft, findings)
        for fault in find_joint_faults(joint):
            findings.add(("joints", name, *fault.key), fault.message)


def _check_layer_end(key: KeyPath, end: JointEnd, draft: Draft, findings: Findings) -> None:
    """Elastic bodies need deformation shapes there, without which nothing says how they deform."""
    component = draft.table.components.get(end.component or "")
    entry = None if component is None else component.interfaces.get(end.interface or "")
    if component is None or entry is None or component.fidelity != "elastic":
        return
    if component.solid.superelement is None and not entry.flexible:
        findings.add(
            key,
            f"needs the deformation shapes of {end}; write coupling = {{ flexible = 24 }} there",
        )


def _check_areas(name: str, joint: JointTable, draft: Draft, findings: Findings) -> None:
    """Two flexible interfaces that share their shapes have areas of one size, as far as they are
    known before anything is meshed.
    """
    areas: dict[str, Outline] = {}
    for end in joint.between:
        component = draft.table.components.get(end.component or "")
        entry = None if component is None else component.interfaces.get(end.interface or "")
        solid = draft.solids.get(end.component or "")
        if component is None or entry is None or solid is None or not entry.flexible:
            continue
        tables = entry.patch_tables()
        outline = patch_outline(solid, build_patch(tables[0], solid)) if len(tables) == 1 else None
        if component.fidelity == "elastic" and outline is not None:
            areas[str(end)] = outline
    if len(areas) == 2 and not _have_one_size(*areas.values()):
        words = " and ".join(f"{end} is {outline}" for end, outline in areas.items())
        findings.add(
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


def find_joint_faults(table: JointTable) -> list[JointFault]:
    """Everything that is wrong with a joint apart from its ends."""
    rule, faults = KINDS[table.kind], _Faults()
    if rule.needs_axis and table.axis is None:
        faults.add(f'a {table.kind} needs its axis; write axis = "x"')
    if rule.needs_normal and table.normal is None:
        faults.add(f'a {table.kind} needs its second axis; write normal = "z"')
    try:
        joint_rotation(table)
    except ValueError:
        faults.add("axis and normal are parallel; write two different directions", "normal")
    if table.stiffness_per_area is not None:
        _check_layer(table, faults)
    for key in rule.required if table.stiffness_per_area is None else ():
        if key not in table.stiffness:
            faults.add(
                f'a {table.kind} needs {key}; write stiffness = {{ {key} = "100 N/um" }}',
                "stiffness",
            )
    if table.kind == "spring" and not table.stiffness and not table.damping:
        faults.add('a spring needs a stiffness; write stiffness = { z = "100 N/um" }', "stiffness")
    if table.screw is not None:
        _check_screw(table, faults)
    springs = [value for value in table.stiffness.values() if isinstance(value, Quantity)]
    if table.loss_factor and not springs and table.stiffness_per_area is None:
        faults.add(
            "a loss factor is a share of a stiffness, and there is none; remove it or write a stiffness",
            "loss_factor",
        )
    for part, values in (("stiffness", table.stiffness), ("damping", table.damping)):
        for key, value in values.items():
            _check_value(table, rule, part, key, value, faults)
    return faults.found


def _check_layer(table: JointTable, faults: _Faults) -> None:
    if table.kind != "bolted":
        faults.add(
            f'a {table.kind} has no contact layer; remove it, or write kind = "bolted"',
            "stiffness_per_area",
        )
    elif table.stiffness:
        faults.add(
            "is the stiffness of the whole joint; remove it or stiffness_per_area", "stiffness"
        )


def _check_screw(table: JointTable, faults: _Faults) -> None:
    if table.kind != "ball_screw":
        faults.add(f'a {table.kind} has no screw; remove it, or write kind = "ball_screw"', "screw")
    if table.stiffness.get("axial") == RIGID:
        faults.add(
            'the nut of a screw with a shaft has a compliance of its own; write its stiffness, such as axial = "500 N/um"',
            "stiffness",
            "axial",
        )
    if table.between[1].component is None:
        faults.add(
            "the second end is the interface that carries the screw's fixed bearing, not ground",
            "between",
        )
    far = None if table.screw is None else table.screw.second_end
    if far is not None and far.component == table.between[0].component:
        text = "is on the component of the first end, which is the nut's; name the nut's interface first and the bearing's second"
        faults.add(text, "screw", "second_end")
    if table.length is not None:
        faults.add(
            "the nut has a shaft of its own, so it slides on no rail; remove length or screw",
            "length",
        )
    nu = None if table.screw is None else table.screw.nu
    if nu is not None and not -1.0 < nu < 0.5:
        faults.add(
            f"is {nu:g} but a Poisson ratio lies above -1 and below 0.5; write for example 0.3",
            "screw",
            "nu",
        )


def _check_value(
    table: JointTable,
    rule: JointKindRule,
    part: str,
    key: str,
    value: Quantity | str,
    faults: _Faults,
) -> None:
    if key not in rule.keys:
        known = f"keys: {', '.join(rule.keys)}" if rule.keys else 'write kind = "spring"'
        faults.add(f"a joint of kind {table.kind!r} has no {part} {key!r}; {known}", part, key)
        return
    if isinstance(value, str):
        return
    if part == "damping" and table.stiffness.get(key) == RIGID:
        faults.add(f"{key} is rigid, so damping there does nothing; remove one of them", part, key)
    rotational = rule.keys[key][0] >= 3
    if rotational != value.dimension.name.startswith("rotational"):
        dimension = _DIMENSIONS[part, rotational]
        text = f'is a {value.dimension.name} but {key} needs a {dimension.name}; write for example "{dimension.example}"'
        faults.add(text, part, key)
    elif value.value < 0.0 and not table.allow_negative:
        faults.add(
            "is negative; if that is meant, write allow_negative = true in the joint", part, key
        )


def joint_rotation(table: JointTable) -> FloatArray:
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
        return (
            np.column_stack([side[:, 1], side[:, 2], side[:, 0]])
            if normal is None
            else frame_axes(_across(axis, normal), axis)
        )
    if axis is None:
        if normal is None:
            return np.eye(3)
        axis = np.array([1.0, 0.0, 0.0])
    return frame_axes(axis, normal)


def _across(axis: FloatArray, direction: FloatArray) -> FloatArray:
    return np.asarray(direction - (direction @ axis) * axis)


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
        rotation=joint_rotation(table),
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
        else ContactLayer(table.stiffness_per_area.normal, table.stiffness_per_area.shear),
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

"""Drives and effects: built from their tables, and what may be wrong with them and in analyses that
they act in.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from headstock.geometry.machine.drives import Drive, GuideFriction, TorqueRipple
from headstock.geometry.mechanisms.exechon import LENGTHS
from headstock.scene.building.controllers import build_control, find_faults
from headstock.scene.building.draft import Draft
from headstock.scene.reading.findings import Findings, KeyPath
from headstock.scene.reading.units import DAMPING
from headstock.scene.schema.drives import DriveTable
from headstock.scene.schema.effects import CONTOUR_EFFECTS, GRAVITY_STIFFENING, find_effect_fault
from headstock.scene.schema.scene import SceneTable

DRIVE_CONTROL = "drive_control"
FRICTION = "friction"
SCREW_INERTIA = "screw_inertia"
TORQUE_RIPPLE = "torque_ripple"


def driven_axis(name: str, table: DriveTable) -> str:
    """The axis of a drive: its own name unless it says another."""
    return table.axis or name


@dataclass(frozen=True)
class _Train:
    """From the motor of a drive to what it moves: a linear axis through one of its ball screws, or a leg
    of the mechanism.
    """

    name: str
    table: DriveTable
    scene: SceneTable

    @property
    def axis(self) -> str:
        return driven_axis(self.name, self.table)

    @property
    def is_leg(self) -> bool:
        scene = self.scene
        return scene.mechanism is not None and self.axis in LENGTHS and self.axis not in scene.axes

    @property
    def is_rotary(self) -> bool:
        """Return whether its axis turns."""
        axis = self.scene.axes.get(self.axis)
        return axis is not None and axis.kind == "rotary"

    def joints(self, named: str | None) -> list[str]:
        """Joints across which the drive could act, or that of a name where it is one of them; the
        lumped leg itself, which has none.
        """
        if self.is_leg and self.scene.is_lumped:
            return [""]
        joints = self._list_joints()
        screws = self._ball_screws(joints)
        if not (self.is_leg or self.is_rotary):
            joints = screws
        # a leg may slide in another joint where it has no ball screw
        candidates = screws or joints if self.is_leg else joints
        return candidates if named is None else [joint for joint in joints if joint == named]

    def _list_joints(self) -> list[str]:
        """Return the joints of its axis, or those between both parts of its leg."""
        scene, axis = self.scene, self.scene.axes.get(self.axis)
        if not self.is_leg or scene.mechanism is None:
            return [] if axis is None else list(axis.joint_names())
        carries, number = scene.mechanism.carries, LENGTHS.index(self.axis) + 1
        sides = [set(carries.get(f"{side}_{number}", ())) for side in ("leg", "tip")]
        return [
            joint
            for joint, table in scene.joints.items()
            if all(any(end.component in side for end in table.between) for side in sides)
        ]

    def _ball_screws(self, joints: Iterable[str]) -> list[str]:
        tables = self.scene.joints
        return [one for one in joints if one in tables and tables[one].kind == "ball_screw"]

    def given_lead(self, joint: str) -> tuple[float | None, str]:
        """Lead [m] that is written elsewhere, and where."""
        screw = self.scene.joints[joint].screw if joint else None
        if screw is not None and screw.lead is not None:
            return screw.lead, f"joint {joint} gives the lead of its screw"
        mechanism = self.scene.mechanism if self.is_leg else None
        if mechanism is not None and mechanism.screw_lead is not None:
            return mechanism.screw_lead, "the mechanism gives screw_lead"
        return None, ""

    def check(self, findings: Findings) -> str | None:
        """Report why the drive cannot be built; return its joint, of a lumped leg the leg."""
        key, axis, table = ("drives", self.name), self.scene.axes.get(self.axis), self.table
        if axis is None and not self.is_leg:
            names = [*self.scene.axes, *(LENGTHS if self.scene.mechanism is not None else ())]
            place = (*key, "axis") if table.axis is not None else key
            findings.check_name(place, self.axis, names, "axis", "axes")
            return None
        if axis is not None:
            for name, fault in self._find_unit_faults():
                findings.add((*key, name), fault)
        if self.is_leg and table.scale is not None:
            findings.add(
                (*key, "scale"),
                f"the scale of a leg reads the length of the leg; remove it, and keep encoder = {table.encoder!r}",
            )
        if self.is_leg and self.scene.is_lumped:
            if table.joint is not None:
                findings.add(
                    (*key, "joint"),
                    f"the lumped leg {self.axis} is driven itself, not a joint; remove it",
                )
            self._check_lead(key, "", findings)
            return self.axis
        joints = self.joints(table.joint)
        if len(joints) != 1:
            findings.add((*key, "joint") if table.joint else key, self._explain_choice(joints))
            return None
        self._check_screw(key, joints[0], findings)
        return joints[0]

    def _find_unit_faults(self) -> Iterator[tuple[str, str]]:
        """Yield the keys that do not go with the kind of its axis, and what to write."""
        table, gain = self.table, self.table.velocity_gain
        if not self.is_rotary:
            if table.ratio is not None:
                yield "ratio", f"axis {self.axis} is linear; write the lead of its screw"
            return
        for name in ("lead", "screw_inertia", "scale", "friction"):
            if getattr(table, name) is not None:
                yield name, f"axis {self.axis} is rotary, and its drive has no {name}; remove it"
        if gain is not None and gain.dimension == DAMPING:
            yield (
                "velocity_gain",
                f'axis {self.axis} is rotary; write a torque per speed of the motor, such as "200 N m s/rad"',
            )

    def _explain_choice(self, joints: list[str]) -> str:
        """Why none or several joints are meant, and what to write."""
        axis, named, others = self.axis, self.table.joint, self.joints(None)
        if self.is_rotary:
            return f"axis {axis} turns across the joints {', '.join(others)}; name one of them as joint"
        if self.is_leg:
            wrong = f"joint {named!r:.80} does not let {axis} slide"
            count = f"{'several joints let' if joints else 'no joint lets'} {axis} slide"
            more = f"add one between what leg_{axis[1:]} and what tip_{axis[1:]} carry"
        else:
            wrong = f"joint {named!r:.80} is no ball screw of axis {axis}"
            screws = "several ball screws" if joints else "no ball screw"
            count = f"axis {axis} has {screws} among its joints"
            more = 'add one of kind = "ball_screw"'
        remedy = f"write joint = {' or '.join(map(repr, others))}" if others else more
        return f"{wrong if named else count}; {remedy}"

    def _check_lead(self, key: KeyPath, joint: str, findings: Findings) -> None:
        """Report a lead that is missing, or that something else gives as well."""
        if self.is_rotary:
            return
        _, where = self.given_lead(joint)
        if not where and self.table.lead is None:
            findings.add(key, "'lead' is missing; write it, such as lead = \"10 mm\"")
        if where and self.table.lead is not None:
            findings.add((*key, "lead"), f"{where}; remove it here")

    def _check_screw(self, key: KeyPath, name: str, findings: Findings) -> None:
        joint = self.scene.joints[name]
        if joint.kind == "ball_screw" and joint.stiffness.get("axial") == "rigid":
            findings.add(
                ("joints", name, "stiffness", "axial"),
                f'transmits the force of drive {self.name}, so it cannot be rigid; write a stiffness such as axial = "100 N/um"',
            )
        self._check_lead(key, name, findings)
        if joint.screw is not None and None not in (joint.screw.coupling, self.table.coupling):
            findings.add(
                (*key, "coupling"), f"joint {name} gives the coupling of its screw; remove it here"
            )


def check_drives(draft: Draft) -> None:
    """Report every drive that cannot be built, and every effect or analysis that lacks one."""
    scene = draft.table
    joints: dict[str, str] = {}
    for name, table in scene.drives.items():
        joint = _Train(name, table, scene).check(draft.findings)
        if joint in joints:
            draft.add(
                ("drives", name),
                f"drives joint {joint}, which drive {joints[joint]} drives too; keep one of them",
            )
        if joint is not None:
            joints[joint] = name
        if table.scale is not None:
            draft.check_name(("drives", name, "scale"), table.scale, "points")
        for place, fault in find_faults(table):
            draft.add(("drives", name, *place), fault)
    _check_drive_effects(draft)


def _check_drive_effects(draft: Draft) -> None:
    scene = draft.table
    if DRIVE_CONTROL in scene.active and not scene.drives:
        draft.add(
            ("effects", DRIVE_CONTROL),
            "there is no drive to control; describe one in [drives.NAME]",
        )
    for effect in (TORQUE_RIPPLE, SCREW_INERTIA, FRICTION):
        if effect not in scene.active:
            continue
        if DRIVE_CONTROL not in scene.active:
            draft.add(
                ("effects", effect),
                f"{effect} acts on controlled drives; write drive_control = true too",
            )
        elif not any(table.given((effect,)) for table in scene.drives.values()):
            draft.add(("effects", effect), f"no drive has a {effect}; write it in [drives.NAME]")
    if FRICTION in scene.active and FRICTION not in scene.analyses.effects:
        draft.add(
            ("effects", FRICTION),
            "friction acts along paths and contours and on loads over time under control, and the scene has none;"
            ' add [analyses.path], [analyses.contouring], or [analyses.transient] with motors = "controlled"',
        )


def check_motors(draft: Draft, analysis: str) -> None:
    """Report an analysis with controlled motors where drives are not controlled."""
    if DRIVE_CONTROL not in draft.table.active:
        draft.findings.add_for(
            analysis,
            ("analyses", analysis, "motors"),
            "drives are not controlled; write [effects] drive_control = true",
        )


def check_sampling(draft: Draft, band: float, analysis: str, what: str) -> None:
    """Report drives that sample too slowly to show the band [Hz] of an analysis."""
    for name, table in draft.table.drives.items():
        step = None if table.controller is None else table.controller.step
        key = ("sampling",) if step is None else ("controller", "step")
        cycle = table.sampling or step
        if cycle is not None and 0.5 / cycle < band:
            draft.findings.add_for(
                analysis,
                ("drives", name, *key),
                f"samples at {1.0 / cycle:.4g} Hz, which shows motions up to {0.5 / cycle:.4g} Hz only (Nyquist), and "
                f"[analyses.{analysis}] asks for {band:.4g} Hz; sample faster or lower {what}",
            )


def build_drives(scene: SceneTable) -> dict[str, Drive]:
    """Drives by name, with the effects that are on; none without the effect ``drive_control``."""
    if DRIVE_CONTROL not in scene.active:
        return {}
    return {name: _build_drive(name, table, scene) for name, table in scene.drives.items()}


def _build_drive(name: str, table: DriveTable, scene: SceneTable) -> Drive:
    train = _Train(name, table, scene)
    (joint,) = train.joints(table.joint)
    lead = table.lead or train.given_lead(joint)[0] or 0.0
    if train.is_rotary:
        lead = 2.0 * math.pi / (table.ratio or 1.0)
    friction = table.friction if FRICTION in scene.active else None
    return Drive(
        name=name,
        axis=train.axis,
        joint=joint,
        motor_inertia=table.inertia,
        lead=lead,
        control=build_control(table, lead),
        screw_inertia=(table.screw_inertia or 0.0) if SCREW_INERTIA in scene.active else 0.0,
        coupling=math.inf if table.coupling is None else table.coupling,
        scale=table.scale,
        friction=None
        if friction is None
        else friction.fill(
            GuideFriction,
            breakaway=friction.coulomb if friction.breakaway is None else friction.breakaway,
            viscous=0.0 if friction.viscous is None else friction.viscous.value,
        ),
        acceleration_share=table.feed_forward.acceleration,
        ripple=tuple(
            wave.fill(TorqueRipple)
            for wave in (table.torque_ripple or () if TORQUE_RIPPLE in scene.active else ())
        ),
    )


def check_effects(draft: Draft) -> None:
    """Report effects that cannot be switched on, and those of contours that nothing obeys."""
    scene = draft.table
    for name, value in scene.effects.items():
        if fault := find_effect_fault(name, value):
            draft.add(("effects", name), fault)
    if GRAVITY_STIFFENING in scene.active and "gravity" not in scene.active:
        draft.add(
            ("effects", GRAVITY_STIFFENING), "needs gravity; write [effects] gravity = true as well"
        )
    acting, on_path = scene.analyses.effects, "path" in scene.analyses.requested
    if scene.mechanism is not None:
        # its variants may name effects for contours that they leave out
        acting |= {*CONTOUR_EFFECTS} - ({"regeneration"} if on_path else set())
    for name in set(CONTOUR_EFFECTS) - acting:
        if name in scene.active:
            draft.add(("effects", name), _explain_effect(name, on_path=on_path))


def _explain_effect(name: str, *, on_path: bool) -> str:
    """What to say of an effect that does not act."""
    if name == "coriolis":
        return (
            "needs no switch here: linear axes do not turn what they carry, and what a guide that tilts does to a body that slides along it"
            " is part of every way that follows its poses; remove it"
        )
    if name == "cutting_force":
        return "acts in [analyses.contouring] and along [analyses.path], and this scene has neither; remove it"
    if not on_path:
        return "acts in [analyses.contouring] only, and this scene has none; remove it"
    return (
        "acts along contours, where teeth meet the waves of those before them; give the line of this path as polyline in [analyses.contouring],"
        " or its corners in a CSV file as polyline_file, or remove the effect"
    )

"""Drives and effects: built from their tables, and what may be wrong with them and in analyses that
they act in.
"""

import math

from headstock.geometry.machine.drives import AxisControl, Drive, GuideFriction, TorqueRipple
from headstock.geometry.mechanisms.exechon import LENGTHS
from headstock.scene.building.draft import Draft, check_name
from headstock.scene.reading.findings import Findings, suggest_names
from headstock.scene.reading.positions import KeyPath
from headstock.scene.reading.units import DAMPING
from headstock.scene.schema.drives import DriveTable, FrictionTable
from headstock.scene.schema.effects import CONTOUR_EFFECTS, find_effect_fault
from headstock.scene.schema.scene import SceneTable

DRIVE_CONTROL, FRICTION, SCREW_INERTIA, TORQUE_RIPPLE = (
    "drive_control",
    "friction",
    "screw_inertia",
    "torque_ripple",
)
DEAD_CYCLES = 1.5  # one cycle of computing, and half a cycle during which a force stays


def check_drives(draft: Draft, findings: Findings) -> None:
    """Report every drive that cannot be built, and every effect or analysis that lacks one."""
    scene = draft.table
    joints: dict[str, str] = {}
    for name, table in scene.drives.items():
        joint = _check_joint(name, table, scene, findings)
        if joint in joints:
            findings.add(
                ("drives", name),
                f"drives joint {joint}, which drive {joints[joint]} drives too; keep one of them",
            )
        if joint is not None:
            joints[joint] = name
        if table.scale is not None:
            check_name(("drives", name, "scale"), table.scale, "points", draft, findings)
    _check_effects(scene, findings)


def driven_axis(name: str, table: DriveTable) -> str:
    """The axis of a drive: its own name unless it says another."""
    return table.axis or name


def find_screws(name: str, table: DriveTable, scene: SceneTable) -> list[str]:
    """Ball screws of a drive's axis, or the one it names."""
    axis = scene.axes.get(driven_axis(name, table))
    known = [] if axis is None else [joint for joint in axis.joint_names() if joint in scene.joints]
    screws = [joint for joint in known if scene.joints[joint].kind == "ball_screw"]
    return screws if table.joint is None else [joint for joint in screws if joint == table.joint]


def _find_leg_joints(name: str, table: DriveTable, scene: SceneTable) -> list[str]:
    """Joints across which the leg of a drive slides in a machine of components, ball screws where
    there are any, or the one the drive names.
    """
    if scene.mechanism is None:
        return []
    number = LENGTHS.index(driven_axis(name, table)) + 1
    sides = [
        set(scene.mechanism.carries.get(side, ())) for side in (f"leg_{number}", f"tip_{number}")
    ]
    found = [
        joint
        for joint, own in scene.joints.items()
        if all(any(end.component in side for end in own.between) for side in sides)
    ]
    if table.joint is not None:
        return [joint for joint in found if joint == table.joint]
    screws = [joint for joint in found if scene.joints[joint].kind == "ball_screw"]
    return screws or found


def _drives_leg(name: str, table: DriveTable, scene: SceneTable) -> bool:
    return scene.mechanism is not None and driven_axis(name, table) in LENGTHS


def _check_leg(name: str, table: DriveTable, scene: SceneTable, findings: Findings) -> str | None:
    """What is wrong with the drive of a leg; the joint it acts across, or the leg itself."""
    key: KeyPath = ("drives", name)
    leg = driven_axis(name, table)
    if table.scale is not None:
        findings.add(
            (*key, "scale"),
            f"the scale of a leg reads the length of the leg; remove it, and keep encoder = {table.encoder!r}",
        )
    if scene.is_lumped:
        if table.joint is not None:
            findings.add(
                (*key, "joint"), f"the lumped leg {leg} is driven itself, not a joint; remove it"
            )
        _check_leg_lead(key, table, scene, findings)
        return leg
    joints = _find_leg_joints(name, table, scene)
    if len(joints) != 1:
        others = _find_leg_joints(name, table.model_copy(update={"joint": None}), scene)
        wrong = f"joint {table.joint!r:.80} does not let {leg} slide" if table.joint else ""
        text = wrong or f"{'several joints let' if joints else 'no joint lets'} {leg} slide"
        remedy = (
            f"; write joint = {' or '.join(repr(other) for other in others)}"
            if others
            else f"; add one between what leg_{leg[1:]} and what tip_{leg[1:]} carry"
        )
        findings.add((*key, "joint") if table.joint else key, text + remedy)
        return None
    if scene.joints[joints[0]].kind == "ball_screw":
        _check_screw(key, table, joints[0], scene, findings)
    else:
        _check_leg_lead(key, table, scene, findings)
    return joints[0]


def _check_leg_lead(key: KeyPath, table: DriveTable, scene: SceneTable, findings: Findings) -> None:
    given = scene.mechanism is not None and scene.mechanism.screw_lead is not None
    _check_lead(key, table, "the mechanism gives screw_lead" if given else "", findings)


def _check_lead(key: KeyPath, table: DriveTable, given: str, findings: Findings) -> None:
    """Report a lead that is missing, or that something else gives as well."""
    if not given and table.lead is None:
        findings.add(key, "'lead' is missing; write it, such as lead = \"10 mm\"")
    if given and table.lead is not None:
        findings.add((*key, "lead"), f"{given}; remove it here")


def _check_joint(name: str, table: DriveTable, scene: SceneTable, findings: Findings) -> str | None:
    key: KeyPath = ("drives", name)
    axis_name = driven_axis(name, table)
    axis = scene.axes.get(axis_name)
    if axis is None:
        if _drives_leg(name, table, scene):
            return _check_leg(name, table, scene, findings)
        known = [*scene.axes, *(LENGTHS if scene.mechanism is not None else ())]
        hint = suggest_names(axis_name, known, what="axes")
        place = (*key, "axis") if table.axis is not None else key
        findings.add(place, f"unknown axis {axis_name[:80]!r}; {hint}")
        return None
    if axis.kind != "linear":
        findings.add(
            key, f"axis {axis_name} is rotary; a drive moves a linear axis through a ball screw"
        )
        return None
    screws = find_screws(name, table, scene)
    if len(screws) != 1:
        named = (
            f"joint {table.joint!r:.80} is no ball screw of axis {axis_name}" if table.joint else ""
        )
        text = (
            named
            or f"axis {axis_name} has {'several ball screws' if screws else 'no ball screw'} among its joints"
        )
        others = find_screws(name, table.model_copy(update={"joint": None}), scene)
        remedy = (
            f"; write joint = {' or '.join(repr(other) for other in others)}"
            if others
            else '; add one of kind = "ball_screw"'
        )
        findings.add((*key, "joint") if table.joint else key, text + remedy)
        return None
    _check_screw(key, table, screws[0], scene, findings)
    return screws[0]


def _check_screw(
    key: KeyPath, table: DriveTable, name: str, scene: SceneTable, findings: Findings
) -> None:
    joint = scene.joints[name]
    if joint.stiffness.get("axial") == "rigid":
        findings.add(
            ("joints", name, "stiffness", "axial"),
            f'transmits the force of drive {key[1]}, so it cannot be rigid; write a stiffness such as axial = "100 N/um"',
        )
    screw = joint.screw
    if screw is not None and screw.lead is not None:
        _check_lead(key, table, f"joint {name} gives the lead of its screw", findings)
    elif _drives_leg(str(key[1]), table, scene):
        _check_leg_lead(key, table, scene, findings)
    else:
        _check_lead(key, table, "", findings)
    if screw is not None and screw.coupling is not None and table.coupling is not None:
        findings.add(
            (*key, "coupling"), f"joint {name} gives the coupling of its screw; remove it here"
        )


def _check_effects(scene: SceneTable, findings: Findings) -> None:
    wanted = {effect for effect, value in scene.effects.items() if value is not False}
    if DRIVE_CONTROL in wanted and not scene.drives:
        findings.add(
            ("effects", DRIVE_CONTROL),
            "there is no drive to control; describe one in [drives.NAME]",
        )
    for effect, has in (
        (TORQUE_RIPPLE, any(table.torque_ripple is not None for table in scene.drives.values())),
        (SCREW_INERTIA, any(table.screw_inertia is not None for table in scene.drives.values())),
        (FRICTION, any(table.friction is not None for table in scene.drives.values())),
    ):
        if effect not in wanted:
            continue
        if DRIVE_CONTROL not in wanted:
            findings.add(
                ("effects", effect),
                f"{effect} acts on controlled drives; write drive_control = true too",
            )
        elif not has:
            findings.add(("effects", effect), f"no drive has a {effect}; write it in [drives.NAME]")
    if FRICTION in wanted and FRICTION not in scene.analyses.effects:
        findings.add(
            ("effects", FRICTION),
            "friction acts along paths and contours and on loads over time under control, and the scene has none;"
            ' add [analyses.path], [analyses.contouring], or [analyses.transient] with motors = "controlled"',
        )


def check_motors(scene: SceneTable, analysis: str, findings: Findings) -> None:
    """Report an analysis with controlled motors where drives are not controlled."""
    if scene.effects.get(DRIVE_CONTROL, False) is False:
        findings.add_for(
            analysis,
            ("analyses", analysis, "motors"),
            "drives are not controlled; write [effects] drive_control = true",
        )


def check_sampling(
    scene: SceneTable, band: float, analysis: str, what: str, findings: Findings
) -> None:
    """Report drives that sample too slowly to show the band [Hz] of an analysis."""
    for name, table in scene.drives.items():
        if table.sampling is not None and 0.5 / table.sampling < band:
            findings.add_for(
                analysis,
                ("drives", name, "sampling"),
                f"samples at {1.0 / table.sampling:.4g} Hz, which shows motions up to {0.5 / table.sampling:.4g} Hz only (Nyquist), and "
                f"[analyses.{analysis}] asks for {band:.4g} Hz; sample faster or lower {what}",
            )


def build_drives(scene: SceneTable) -> dict[str, Drive]:
    """Drives by name, with the effects that are on; none without the effect ``drive_control``."""
    on = {effect for effect, value in scene.effects.items() if value is not False}
    if DRIVE_CONTROL not in on:
        return {}
    return {name: _build_drive(name, table, scene, on) for name, table in scene.drives.items()}


def _build_drive(name: str, table: DriveTable, scene: SceneTable, on: set[str]) -> Drive:
    joint, lead = _find_transmission(name, table, scene)
    return Drive(
        name=name,
        axis=driven_axis(name, table),
        joint=joint,
        motor_inertia=table.inertia,
        lead=lead,
        control=_build_control(table, lead),
        screw_inertia=(table.screw_inertia or 0.0) if SCREW_INERTIA in on else 0.0,
        coupling=math.inf if table.coupling is None else table.coupling,
        scale=table.scale,
        friction=None
        if FRICTION not in on or table.friction is None
        else _build_friction(table.friction),
        cycle=table.sampling or 0.0,
        acceleration_share=table.feed_forward.acceleration,
        ripple=tuple(
            wave.fill(TorqueRipple)
            for wave in (table.torque_ripple or () if TORQUE_RIPPLE in on else ())
        ),
    )


def _find_transmission(name: str, table: DriveTable, scene: SceneTable) -> tuple[str, float]:
    """Joint of a drive, none of a lumped leg, and its lead [m]."""
    if _drives_leg(name, table, scene) and scene.mechanism is not None:
        found = [""] if scene.is_lumped else _find_leg_joints(name, table, scene)
        known = scene.mechanism.screw_lead
    else:
        found, known = find_screws(name, table, scene), None
    (joint,) = found
    screw = scene.joints[joint].screw if joint else None
    own = None if screw is None else screw.lead
    return joint, table.lead or own or known or 0.0


def _build_control(table: DriveTable, lead: float) -> AxisControl:
    gain = table.velocity_gain
    # a torque per turning speed is a force per speed over the square of travel per radian
    along = gain.value if gain.dimension == DAMPING else gain.value / (lead / (2.0 * math.pi)) ** 2
    late = DEAD_CYCLES * table.sampling if table.sampling is not None else table.dead_time or 0.0
    return AxisControl(
        position_gain=table.kv,
        velocity_gain=along,
        integral_time=math.inf if table.integral_time is None else table.integral_time,
        velocity_feed_forward=table.feed_forward.velocity,
        dead_time=late,
        current_lag=table.current_loop or 0.0,
        encoder=table.encoder,
    )


def _build_friction(table: FrictionTable) -> GuideFriction:
    return table.fill(
        GuideFriction,
        breakaway=table.coulomb if table.breakaway is None else table.breakaway,
        viscous=0.0 if table.viscous is None else table.viscous.value,
    )


def check_effects(draft: Draft, findings: Findings) -> None:
    """Report effects that cannot be switched on, and those of contours that nothing obeys."""
    scene = draft.table
    for name, value in scene.effects.items():
        if fault := find_effect_fault(name, value):
            findings.add(("effects", name), fault)
    acting, on_path = scene.analyses.effects, "path" in scene.analyses.requested
    if scene.mechanism is not None:
        # its variants may name effects for contours that they leave out
        acting |= {*CONTOUR_EFFECTS} - ({"regeneration"} if on_path else set())
    for name in set(CONTOUR_EFFECTS) - acting:
        if scene.effects.get(name):
            findings.add(("effects", name), _explain_effect(name, on_path=on_path))


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

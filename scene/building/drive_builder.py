"""From checked tables to drives in SI units along their axes."""

import math

from headstock.geometry.machine.drives import AxisControl, Drive, GuideFriction
from headstock.scene.building.drives import DRIVE_CONTROL, FRICTION, SCREW_INERTIA, driven_axis, find_screws
from headstock.scene.reading.units import DAMPING
from headstock.scene.requests import ControlRequest, PathCut
from headstock.scene.schema.drives import DriveTable, FrictionTable
from headstock.scene.schema.scene import SceneTable
from headstock.solvers.milling.cutting_materials import CUTTING_MATERIALS
from headstock.solvers.milling.forces import EndMill, MillingCut

DEAD_CYCLES = 1.5  # one cycle of computing, and half a cycle during which a force is held


def build_drives(scene: SceneTable) -> dict[str, Drive]:
    """Drives by name, with the effects that are on; none without the effect ``drive_control``."""
    on = {effect for effect, value in scene.effects.items() if value is not False}
    if DRIVE_CONTROL not in on:
        return {}
    return {name: _build_drive(name, table, scene, on) for name, table in scene.drives.items()}


def build_control(scene: SceneTable, poses: tuple[str, ...]) -> ControlRequest | None:
    """What is asked of the control loops."""
    request = scene.analyses.control
    return None if request is None else ControlRequest(request.up_to, request.speed, tuple(request.poses or poses))


def build_path_cut(scene: SceneTable) -> PathCut | None:
    """What a path mills, where the effect ``cutting_force`` is on."""
    path = scene.analyses.path
    if path is None or path.cut is None or scene.effects.get("cutting_force", False) is False:
        return None
    table = path.cut
    mill = EndMill(table.mill.diameter, table.mill.teeth, table.mill.helix, table.mill.runout)
    cut = MillingCut(mill, CUTTING_MATERIALS[table.material], table.spindle, table.axial_depth, table.radial_depth)
    return PathCut(cut, table.at or next(iter(scene.points)), table.up)


def _build_drive(name: str, table: DriveTable, scene: SceneTable, on: set[str]) -> Drive:
    (joint,) = find_screws(name, table, scene)
    screw = scene.joints[joint].screw
    lead = table.lead or (screw.lead if screw is not None and screw.lead is not None else 0.0)
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
        friction=None if FRICTION not in on or table.friction is None else _build_friction(table.friction),
        cycle=table.sampling or 0.0,
        acceleration_share=table.feed_forward.acceleration,
    )


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
    return GuideFriction(
        coulomb=table.coulomb,
        breakaway=table.coulomb if table.breakaway is None else table.breakaway,
        stribeck_speed=table.stribeck_speed,
        viscous=0.0 if table.viscous is None else table.viscous.value,
        smoothing=table.smoothing,
    )

"""A scene's lumped mechanism: rigid components on the markers that carry them, springs in the legs,
placed in a pose.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray, Frame, compose_frames, rigid_transfer, rotate_dofs
from headstock.geometry.machine.drives import Drive
from headstock.geometry.machine.guide_errors import ErrorProfile, ProfileError
from headstock.geometry.machine.joints import JointEnd
from headstock.geometry.machine.machine import NO_OFFSET, Sensor
from headstock.geometry.mechanisms.exechon import COMPLIANCES, LEGS, LENGTHS
from headstock.geometry.parts.components import Load
from headstock.reduction.coupling.channels import GRAVITY, load_factors, sensor_rows
from headstock.reduction.coupling.drives import find_moved_mass, make_rigid_train
from headstock.reduction.motions.compliance_budget import WEIGHT
from headstock.reduction.motions.tool_deviation import FORCES, GEOMETRY, ToolDeviation
from headstock.reduction.superelement import Superelement
from headstock.scene.scene import LegSprings, SceneMechanism
from headstock.solvers.control.drive_trains import DriveTrain
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.static_response import solve_static
from headstock.solvers.mechanisms.dynamics import CompliantMechanism, LumpedSprings, MechanismBody
from headstock.solvers.mechanisms.modes import SmallMotions, linearise_poses, marker_motion
from headstock.solvers.second_order import SecondOrderSystem

SPRING_PARTS = ("joint", "drive", "screw")


@dataclass(frozen=True, eq=False)
class PlacedMechanism:
    """A lumped mechanism in a pose; its drives are locked unless they were let go.

    Attributes:
        model: Bodies, springs and closures.
        state: ``(n,)`` coordinates.
        motions: Small motions about the pose.
        superelements: Rigid bodies by component.
        placements: Frame of each component in the machine frame.
        body_motions: Component to ``(6, c)`` motion of its centre of mass and its turning per
            compliant coordinate, machine axes.
    """

    model: CompliantMechanism
    springs: LegSprings
    state: FloatArray
    motions: SmallMotions
    superelements: Mapping[str, Superelement]
    placements: dict[str, Frame]
    body_motions: dict[str, FloatArray]

    def motion_at(self, end: JointEnd, offset: Sequence[float] = NO_OFFSET) -> FloatArray:
        """``(6, c)`` motion at an offset ``(3,)`` from an interface [m] in the axes of its body, per
        compliant coordinate, machine axes; zero for ground and what is not carried.
        """
        if end.component is None or end.interface is None:
            return np.zeros((6, len(self.motions.stiffness)))
        body, placement = self.superelements[end.component], self.placements[end.component]
        return (
            rigid_transfer(
                placement.rotation @ body.center_of_mass,
                placement.rotation @ self._local(end, offset),
            )
            @ self.body_motions[end.component]
        )

    def measure(self, sensor: Sensor) -> FloatArray:
        """``(k, c)`` motion in each direction of a sensor per compliant coordinate."""
        name = sensor.component
        rows = sensor_rows(self.superelements[name], self.placements[name], sensor)
        return rows @ self.body_motions[name]

    def position_of(self, end: JointEnd, offset: Sequence[float] = NO_OFFSET) -> FloatArray:
        """``(3,)`` place at an offset ``(3,)`` from an interface [m] in the machine frame [m]."""
        if end.component is None:
            return np.zeros(3)
        placement = self.placements[end.component]
        return placement.origin + placement.rotation @ self._local(end, offset)

    def load_of(self, load: Load) -> FloatArray:
        """Generalised load ``(c,)`` of a static load: a wrench on its body, at the interface or
        about the centre of mass; zero on what is not carried.
        """
        if load.kind == "force":
            end = JointEnd(load.component, load.interface)
            return self.motion_at(end).T @ np.asarray(load.vector)
        body, placement = self.superelements[load.component], self.placements[load.component]
        wrench = np.sum(
            [
                factor * body.loads[unit].vector
                for unit, factor in load_factors(placement, load).items()
            ],
            axis=0,
        )
        motion = self.body_motions[load.component]
        return motion.T @ (rotate_dofs(placement.rotation) @ wrench)

    def _local(self, end: JointEnd, offset: Sequence[float]) -> FloatArray:
        origin = self.superelements[end.component or ""].interface_position(end.interface or "")
        return origin + np.asarray(offset)


def build_compliant_mechanism(
    mechanism: SceneMechanism,
    superelements: Mapping[str, Superelement],
    placements: Mapping[str, Frame],
    gravity: FloatArray | None,
    *,
    stiffening: bool = False,
) -> CompliantMechanism:
    """Bodies and springs of a lumped mechanism.

    Args:
        mechanism: Of the scene; needs springs.
        superelements: By component; only their mass, centre and inertia count.
        placements: Frame of each component on its mark.
        gravity: ``(3,)`` in the machine frame [m/s^2]; None without gravity.
        stiffening: Whether small motions feel gravity.
    """
    bodies = []
    for name, marker in mechanism.carries.items():
        body, placement = superelements[name], placements[name]
        center = placement.origin + placement.rotation @ body.center_of_mass
        bodies.append(
            MechanismBody(
                name,
                marker,
                body.mass_kg,
                center,
                placement.rotation @ body.inertia @ placement.rotation.T,
            )
        )
    turned = np.zeros(3) if gravity is None else mechanism.mounted.mounting.rotation.T @ gravity
    return CompliantMechanism(
        mechanism.mounted.mechanism,
        tuple(bodies),
        _build_springs(mechanism),
        gravity=turned,
        gravity_stiffening=stiffening,
    )


def _build_springs(mechanism: SceneMechanism) -> LumpedSprings:
    """Springs across and along each leg: a joint each way, and along the leg the drive and the
    screw in series with it.

    Raises:
        ValueError: The scene gives no springs.
    """
    given = mechanism.springs
    if given is None:
        raise ValueError("a lumped mechanism needs springs")
    across = 1.0 / given.joint
    along = 1.0 / given.joint + 1.0 / given.drive + given.screw_offset / given.screw
    lengths = [mechanism.mounted.mechanism.index(name) for name in LENGTHS for _ in range(2)]
    return LumpedSprings(
        constant=np.array([across, along] * len(LEGS)),
        per_length=np.array([0.0, 1.0 / given.screw] * len(LEGS)),
        length=np.array(lengths, dtype=np.intp),
        labels=COMPLIANCES,
    )


def place_mechanism(
    mechanism: SceneMechanism,
    model: CompliantMechanism,
    state: FloatArray,
    *,
    superelements: Mapping[str, Superelement],
    own: Mapping[str, Frame],
    released: Sequence[str] = (),
) -> PlacedMechanism:
    """A lumped mechanism in a pose.

    Args:
        model: From :func:`build_compliant_mechanism`.
        state: ``(n,)`` closed state.
        superelements: By component; those that are not carried stand still in the machine frame.
        own: Frame of each component on its mark.
        released: Driven coordinates that are free to move.
    """
    if mechanism.springs is None:
        raise ValueError("a lumped mechanism needs springs")
    motions = linearise_poses(model, state, released)
    placement, mounting = motions.kinematics.placement, mechanism.mounted.mounting
    placements: dict[str, Frame] = {}
    moving: dict[str, FloatArray] = {}
    for name, body in superelements.items():
        marker = mechanism.carries.get(name)
        if marker is None:
            placements[name], moving[name] = own[name], np.zeros((6, len(motions.stiffness)))
            continue
        index = model.mechanism.markers.index(marker)
        on_marker = compose_frames(
            mounting, Frame(placement.positions[index], placement.rotations[index])
        )
        placements[name] = compose_frames(on_marker, own[name])
        center = placements[name].origin + placements[name].rotation @ body.center_of_mass
        motion = rotate_dofs(mounting.rotation) @ marker_motion(model, motions, marker)
        moving[name] = rigid_transfer(on_marker.origin, center) @ motion
    return PlacedMechanism(
        model, mechanism.springs, state, motions, superelements, placements, moving
    )


def place_leg_drives(
    placed: PlacedMechanism, system: SecondOrderSystem, drives: Iterable[Drive], *, beta: float
) -> tuple[DriveTrain, ...]:
    """Drives of legs that are free to grow; a motor stands on the part of its leg that does not
    slide, and a linear scale reads the leg's length up to its joint at the platform.

    Args:
        placed: With the driven coordinates released.
        beta: Viscous damping over stiffness of couplings [s].
    """
    motions, springs = placed.motions, placed.model.springs
    markers = placed.model.mechanism.markers
    unit, drives = np.eye(len(motions.stiffness)), tuple(drives)
    slides = unit[[len(springs.labels) + motions.released.index(drive.axis) for drive in drives]]
    trains = []
    for drive, slide, mass in zip(drives, slides, find_moved_mass(system, slides), strict=True):
        leg = LENGTHS.index(drive.axis)
        along = motions.kinematics.placement.rotations[markers.index(LEGS[leg])][:, 2]
        turned = along @ marker_motion(placed.model, motions, LEGS[leg])[3:]
        trains.append(
            make_rigid_train(
                drive,
                slide=np.asarray(slide),
                scale=slide + unit[2 * leg + 1],
                # a right-hand screw that turns with its housing pulls the nut back
                stator=-drive.lead / (2.0 * np.pi) * turned,
                moved_mass=float(mass),
                beta=beta,
            )
        )
    return tuple(trains)


def spring_shares(placed: PlacedMechanism, stretch: FloatArray) -> dict[str, float]:
    """Share of strain energy in each leg's joint, drive and screw at coordinates ``(c,)``."""
    energy = placed.motions.stiffness * stretch**2
    total = float(energy.sum())
    return {
        part: float(value) / total if total else 0.0
        for part, value in _split_springs(placed, energy).items()
    }


def _split_springs(placed: PlacedMechanism, energy: FloatArray) -> dict[str, FloatArray]:
    """What springs ``(c, ...)`` across and along each leg have, by its joint, drive and screw."""
    split: dict[str, FloatArray] = {}
    for number, leg in enumerate(LEGS):
        parts = series_parts(
            placed.springs, float(placed.state[placed.model.springs.length[2 * number]])
        )
        for name, size in zip(SPRING_PARTS, parts, strict=True):
            split[f"{leg}.{name}"] = energy[2 * number + 1] * (size / sum(parts))
        split[f"{leg}.joint"] = split[f"{leg}.joint"] + energy[2 * number]
    return split


def deviate(
    placed: PlacedMechanism,
    system: SecondOrderSystem,
    loads: FloatArray,
    *,
    acting: Mapping[str, FloatArray],
    errors: Mapping[int, ErrorProfile],
) -> ToolDeviation:
    """Deviation of a lumped mechanism at a point by source and part, as
    :func:`headstock.reduction.motions.tool_deviation.solve_deviation` has it of others.

    Args:
        loads: ``(c, 6)`` of unit forces and moments at the point.
        acting: Generalised load ``(c,)`` of each static load by name, gravity among them.
        errors: Number of a leg, 0..2, to the error of its length over its length.

    Raises:
        ModelError: A leg is longer or shorter than its table.
    """
    sources: dict[str, FloatArray] = {}
    parts: dict[str, dict[str, FloatArray]] = {}
    if errors:
        pushed = np.diag(placed.motions.stiffness * leg_offsets(placed, errors))
        moved = loads.T @ solve_static(system, pushed).displacements
        sources[GEOMETRY] = moved.sum(axis=1)
        parts[GEOMETRY] = {LEGS[leg]: moved[:, 2 * leg + 1] for leg in errors}
    if not acting:
        return ToolDeviation(sources, parts)
    influence = solve_static(system, loads).displacements
    forces = [load for name, load in acting.items() if name != GRAVITY]
    deforming = {GRAVITY: [acting[GRAVITY]]} if GRAVITY in acting else {}
    for source, terms in (deforming | ({FORCES: forces} if forces else {})).items():
        moved = solve_static(system, np.sum(terms, axis=0)).displacements
        sources[source] = loads.T @ moved
        energy = influence * (placed.motions.stiffness * moved)[:, None]
        parts[source] = _split_springs(placed, energy)
        if placed.motions.geometric is not None:
            parts[source][WEIGHT] = influence.T @ (placed.motions.geometric @ moved)
    return ToolDeviation(sources, parts)


def leg_offsets(placed: PlacedMechanism, errors: Mapping[int, ErrorProfile]) -> FloatArray:
    """Compliant coordinates ``(c,)`` by the errors of the legs' lengths in a pose, without loads.

    Args:
        errors: Number of a leg, 0..2, to the error of its length over its length.

    Raises:
        ModelError: A leg is longer or shorter than its table.
    """
    offsets = np.zeros(len(placed.motions.stiffness))
    lengths = placed.state[[placed.model.springs.length[2 * leg + 1] for leg in errors]]
    offsets[[2 * leg + 1 for leg in errors]] = sample_leg_errors(errors, lengths[None])[0]
    return offsets


def sample_leg_errors(errors: Mapping[int, ErrorProfile], lengths: FloatArray) -> FloatArray:
    """Return what legs are too long by at their lengths ``(n, k)``, a column each [m].

    Args:
        errors: Number of a leg, 0..2, to the error of its length over its length.
        lengths: Of these legs [m].

    Raises:
        ModelError: A leg is longer or shorter than its table.
    """
    samples = np.zeros_like(lengths)
    for column, (leg, profile) in enumerate(errors.items()):
        try:
            samples[:, column] = profile.sample(lengths[:, column])
        except ProfileError as error:
            raise ModelError(
                f"errors of leg {leg + 1}: {error}; give the table values up to there"
            ) from error
    return samples


def series_parts(springs: LegSprings, length: float) -> tuple[float, float, float]:
    """Compliance of joint, drive and screw along a leg of a given length [m/N] (Bonnemains et al.
    2010, eqs. 1 and 2).
    """
    return 1.0 / springs.joint, 1.0 / springs.drive, (length + springs.screw_offset) / springs.screw

"""A short name for every mode of a machine: what bends, what moves and on what; of bodies of
revolution, the harmonic around the axis.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.dof_layout import turn_dofs
from headstock.reduction.motions.body_motions import (
    MOTION_NAMES,
    BodyMotion,
    center_of_mass,
    rigid_dofs,
    split_motions,
)
from headstock.reduction.motions.compliance_budget import energy_shares
from headstock.reduction.motions.part_names import join_names, split_number
from headstock.solvers.linear.modal_analysis import ModalResult

# difference of two moments of inertia over them up to which a body is round about the third axis
ROUND = 0.02
# least over largest reach of a round body's points, which a mesh and a sample of it thin out
EVEN = 0.92
DIRECTIONS = 24
FEWEST_POINTS = 60
HARMONICS = 4  # waves around the axis that are distinguished
BINS = 8
CLEAR = 0.6  # share of a deformation from which one harmonic names it
ELASTIC_SHARE = 0.3  # strain energy from which a component is said to deform
MOVING_SHARE = 0.15  # kinetic energy from which a component is named as moving
JOINT_SHARE = 0.2  # strain energy from which a joint, or a family of numbered ones, is named
FAMILY_SHARE = 0.02
RIGID_SHARE = 0.95  # kinetic energy that one rigid motion of the whole machine explains
TWIST_SHARE = 0.8
STRETCH_SHARE = 0.5
SLENDER_RATIO = 0.5  # smallest over middle moment of inertia
PARALLEL = 0.9
SAMPLES = 600
WHOLE_MACHINE = "whole machine"  # what moves where all bodies move as one
SLICES = 12


def _round_axis(moments: FloatArray, axes: FloatArray, places: FloatArray) -> FloatArray | None:
    """Return the axis ``(3,)`` of a body of revolution; None where it has none.

    Args:
        moments: ``(3,)`` principal moments of inertia, rising.
        axes: ``(3, 3)`` their axes, one a column.
        places: ``(n, 3)`` points of the body about its centre of mass: a square bar has the moments
            of a round one.
    """
    low, middle, high = moments
    first, last = middle - low <= ROUND * middle, high - middle <= ROUND * high
    if first == last:
        return None
    axis, side, other = (
        (axes[:, 2], axes[:, 0], axes[:, 1]) if first else (axes[:, 0], axes[:, 1], axes[:, 2])
    )
    angles = np.linspace(0.0, 2.0 * np.pi, DIRECTIONS, endpoint=False)
    if _is_even(places, np.outer(np.cos(angles), side) + np.outer(np.sin(angles), other)):
        return np.asarray(axis)
    return None


def _is_ball(moments: FloatArray, places: FloatArray) -> bool:
    """Return whether a body reaches equally far in every direction from its centre of mass."""
    corners = np.array(
        [[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z],
        dtype=float,
    )
    even = _is_even(places, corners / np.linalg.norm(corners, axis=1, keepdims=True))
    return bool(moments[2] - moments[0] <= ROUND * moments[2]) and even


def _is_even(places: FloatArray, directions: FloatArray) -> bool:
    """Return whether points reach equally far in directions; too few of them show nothing."""
    reach = (
        (places @ directions.T).max(axis=0)
        if len(places) >= FEWEST_POINTS
        else np.array([0.0, 1.0])
    )
    return bool(reach.min() >= EVEN * reach.max())


def _name_on_ball(places: FloatArray, field: FloatArray) -> tuple[str, str]:
    """Return the verb and addition for a deformation ``(n, 3)`` at places ``(n, 3)`` about the
    middle of a ball.
    """
    outward = places / np.maximum(
        np.linalg.norm(places, axis=1, keepdims=True), np.finfo(float).tiny
    )
    radial, whole = (field * outward).sum(axis=1), float((field**2).sum())
    if radial.sum() ** 2 / len(radial) > CLEAR * whole:
        return "breathe", ""
    return ("twist" if (radial**2).sum() < (1.0 - CLEAR) * 0.25 * whole else "deform"), ""


def _name_around(
    axis: FloatArray, places: FloatArray, field: FloatArray, letter: int, *, slender: bool
) -> tuple[str, str] | None:
    """Return the verb and addition for a deformation of a body of revolution; None for what bends
    it as any other body or has no clear harmonic.

    Args:
        axis: ``(3,)`` unit.
        places: ``(n, 3)`` about the middle.
        field: ``(n, 3)`` displacements there.
        letter: Index of the machine axis that the axis is nearest to.
        slender: It is longer than wide.
    """
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    side /= np.linalg.norm(side)
    flat = np.column_stack([places @ side, places @ np.cross(axis, side)])
    radii, angles = np.linalg.norm(flat, axis=1), np.arctan2(flat[:, 1], flat[:, 0])
    moved = np.column_stack([field @ side, field @ np.cross(axis, side)])
    cosine, sine = np.cos(angles), np.sin(angles)
    parts = np.column_stack(
        [
            moved[:, 0] * cosine + moved[:, 1] * sine,
            moved[:, 1] * cosine - moved[:, 0] * sine,
            field @ axis,
        ]
    )
    # rings of like height on a long body, of like radius on a flat one
    order = np.argsort(places @ axis if slender else radii, kind="stable")
    shares = np.zeros((HARMONICS + 1, 3))
    for ring in np.array_split(order, BINS):
        waves = [np.ones(len(ring))] + [
            wave(n * angles[ring]) for n in range(1, HARMONICS + 1) for wave in (np.cos, np.sin)
        ]
        fitted = np.linalg.lstsq(np.column_stack(waves), parts[ring], rcond=None)[0]
        for number, wave in enumerate(waves):
            shares[(number + 1) // 2] += fitted[number] ** 2 * float(wave @ wave)
    shares /= max(float((parts**2).sum()), np.finfo(float).tiny)
    harmonic = int(np.argmax(shares.sum(axis=1)))
    if shares[harmonic].sum() < CLEAR or harmonic == 1:
        return None
    across = shares[harmonic, 2] > 0.5 * shares[harmonic].sum()
    if harmonic:
        if across:
            return "bend", f"with {harmonic} nodal diameters"
        return ("ovalize", "") if harmonic == 2 else ("deform", f"in {harmonic} lobes")
    if shares[0, 1] > 0.5 * shares[0].sum():
        return "twist", "ABC"[letter]
    if across:
        return ("stretch", "XYZ"[letter]) if slender else ("bend", "like an umbrella")
    return "breathe", ""


@dataclass(frozen=True, eq=False)
class NamedModes:
    """Names and energy shares of modes, one entry per mode.

    Attributes:
        names: Such as ``column bends X, B rotation of y_base + y_slider on x_guide``.
        strain_shares: Share of the strain energy per component and joint; empty for rigid-body
            modes.
        kinetic_shares: Share of the kinetic energy per component.
    """

    names: tuple[str, ...]
    strain_shares: tuple[dict[str, float], ...]
    kinetic_shares: tuple[dict[str, float], ...]


def name_modes(coupled: CoupledMachine, modal: ModalResult) -> NamedModes:
    """Name the modes of a coupled machine by their energies.

    X, Y, Z are translations and A, B, C rotations about machine axes, taken at the centre of mass
    of the body that has most of the kinetic energy; a component bends, twists or stretches when it
    holds at least 30 % of the strain energy.
    """
    strain, kinetic = energy_shares(coupled, modal.shapes)
    # of a rigid-body mode nothing but rounding
    strain = ({},) * modal.rigid_count + strain[modal.rigid_count :]
    names = tuple(
        _name_mode(coupled, modal.shapes[:, i], strain[i], kinetic[i], free=i < modal.rigid_count)
        for i in range(len(strain))
    )
    return NamedModes(names, strain, kinetic)


def _name_mode(
    coupled: CoupledMachine,
    shape: FloatArray,
    strain: dict[str, float],
    kinetic: dict[str, float],
    *,
    free: bool,
) -> str:
    stacked = coupled.basis @ shape
    motions = {motion.component: motion for motion in split_motions(coupled, stacked)}
    whole, explained = _whole_motion(coupled, stacked)
    joints = _main_joints({name: share for name, share in strain.items() if name not in motions})
    if explained >= RIGID_SHARE and len(motions) > 1:
        return f"{WHOLE_MACHINE} {'moves' if whole < 3 else 'turns'} {'XYZABC'[whole]}{' freely' if free else _on(joints)}"
    moving = _moving_together(motions, kinetic)
    if free:
        return f"free {moving}"
    bending = [name for name in _largest(strain, ELASTIC_SHARE) if name in motions]
    parts = _deformations(coupled, [motions[name] for name in bending])
    movers = _largest(kinetic, MOVING_SHARE)
    if not parts or movers[:1] not in ([], bending[:1]):
        parts.append(f"{moving}{_on(joints)}")
    return ", ".join(parts)


def _largest(shares: dict[str, float], limit: float) -> list[str]:
    """Return the names with at least a share, largest first, equals by name."""
    kept = [name for name, share in shares.items() if share >= limit]
    return sorted(kept, key=lambda name: (-round(shares[name], 6), name))


def _main_joints(shares: dict[str, float]) -> list[str]:
    """Return the joints whose family (names that differ by a number only) has at least a fifth of
    the strain energy, largest first.
    """
    families: dict[str, float] = {}
    for name, share in shares.items():
        stem = split_number(name)[0]
        families[stem] = families.get(stem, 0.0) + share
    order = _largest(families, JOINT_SHARE)
    return [
        name
        for stem in order
        for name in sorted(shares)
        if split_number(name)[0] == stem and shares[name] >= FAMILY_SHARE
    ]


def _on(joints: Sequence[str]) -> str:
    return f" on {join_names(joints)}" if joints else ""


def _moving_together(motions: dict[str, BodyMotion], kinetic: dict[str, float]) -> str:
    """Return the main motion of the body with most kinetic energy, and the bodies that share it."""
    movers = _largest(kinetic, MOVING_SHARE) or _largest(kinetic, 0.0)[:1]
    if not movers:
        return "motion without mass"
    main = motions[movers[0]].main
    return f"{MOTION_NAMES[main]} of {join_names([name for name in movers if motions[name].main == main])}"


def _whole_motion(coupled: CoupledMachine, stacked: FloatArray) -> tuple[int, float]:
    """Return the main rigid motion of the machine as one body, and the share of the kinetic energy
    that such a motion explains.
    """
    masses = {name: coupled.layout.superelements[name].mass_kg for name in coupled.offsets}
    total = sum(masses.values())
    if not total > 0.0:
        return 0, 0.0
    center = (
        np.sum([mass * center_of_mass(coupled, name) for name, mass in masses.items()], axis=0)
        / total
    )
    gram, work, energy = np.zeros((6, 6)), np.zeros(6), 0.0
    for name, dofs in coupled.offsets.items():
        motions, mass = rigid_dofs(coupled, name, center), coupled.matrices.masses[name]
        gram += motions.T @ mass @ motions
        work += motions.T @ (mass @ stacked[dofs])
        energy += float(stacked[dofs] @ mass @ stacked[dofs])
    rigid = np.linalg.lstsq(gram, work, rcond=None)[0]
    weights = gram.diagonal() * rigid**2
    main = int(np.argmax(np.round(weights / max(float(weights.max()), np.finfo(float).tiny), 6)))
    return main, float(rigid @ work) / energy if energy > 0.0 else 0.0


def _deformations(coupled: CoupledMachine, motions: Sequence[BodyMotion]) -> list[str]:
    """Return ``column_left + column_right bend X``: components that deform alike together."""
    alike: dict[tuple[str, str], list[str]] = {}
    for motion in motions:
        alike.setdefault(_describe_deformation(coupled, motion), []).append(motion.component)
    sentences = []
    for (verb, direction), names in alike.items():
        ending = "" if len(names) > 1 else "es" if verb.endswith("ch") else "s"
        sentences.append(f"{join_names(names)} {verb}{ending} {direction}".strip())
    return sentences


def _describe_deformation(coupled: CoupledMachine, motion: BodyMotion) -> tuple[str, str]:
    """Return how a component deforms: ``bend X`` or, about and along the long axis of a slender
    one, ``twist C``, ``stretch Z``.
    """
    places, field = _sample_field(coupled, motion)
    sizes = (field**2).sum(axis=0)
    if not sizes.sum() > 0.0:
        return "deform", ""
    superelement = coupled.layout.superelements[motion.component]
    rotation = coupled.placements[motion.component].rotation
    moments, axes = np.linalg.eigh(superelement.inertia)
    long = rotation @ axes[:, 0]
    slender = moments[0] < SLENDER_RATIO * moments[1]
    axis = int(np.argmax(np.round(np.abs(long), 6)))
    if _is_ball(moments, places):
        return _name_on_ball(places, field)
    around = _round_axis(moments, rotation @ axes, places)
    if around is not None:
        letter = int(np.argmax(np.round(np.abs(around), 6)))
        named = _name_around(
            around,
            places,
            field,
            letter,
            slender=bool(moments[2] - moments[1] < moments[1] - moments[0]),
        )
        if named is not None:
            return named
    if slender and _turning_share(long, places, field) > TWIST_SHARE:
        return "twist", "ABC"[axis]
    if slender and _stretching_share(long, places, field) > STRETCH_SHARE:
        return "stretch", "XYZ"[axis]
    if slender and abs(long[axis]) > PARALLEL:
        sizes[axis] = (
            0.0  # what sections that turn move along a bending bar, which is much in a stout one
        )
    return "bend", "XYZ"[
        int(np.argmax(np.round(sizes / max(float(sizes.max()), np.finfo(float).tiny), 6)))
    ]


def _turning_share(axis: FloatArray, places: FloatArray, field: FloatArray) -> float:
    """Return the share of a displacement field that turns its cross-sections about an axis: one
    angle per slice along it.
    """
    turning = 0.0
    around = np.cross(axis, places)
    order = np.argsort(places @ axis, kind="stable")
    for slice_ in np.array_split(order, SLICES):
        tangents = around[slice_]
        tangents = tangents - tangents.mean(axis=0) if len(slice_) else tangents
        size = float((tangents**2).sum())
        if size > 0.0:
            turning += float((field[slice_] * tangents).sum()) ** 2 / size
    return turning / float((field**2).sum())


def _stretching_share(axis: FloatArray, places: FloatArray, field: FloatArray) -> float:
    """Return the share of a displacement field that moves its cross-sections along an axis as a
    whole: one shift per slice.
    """
    order = np.argsort(places @ axis, kind="stable")
    shifts = (field @ axis)[order]
    whole = sum(
        float(slice_.sum()) ** 2 / max(1, len(slice_)) for slice_ in np.array_split(shifts, SLICES)
    )
    return whole / float((field**2).sum())


def _sample_field(coupled: CoupledMachine, motion: BodyMotion) -> tuple[FloatArray, FloatArray]:
    """Return the places about the centre of mass and displacements there ``(n, 3)`` of a
    component's deformation, machine axes.

    Mesh points where the recovery basis is kept, boundary nodes otherwise.
    """
    superelement = coupled.layout.superelements[motion.component]
    placement = coupled.placements[motion.component]
    rotation = placement.rotation
    if superelement.recovery is None:
        origins = np.array([frame.origin for frame in superelement.frames]).reshape(-1, 3)
        field = motion.deformation[: superelement.boundary_size].reshape(-1, 6)[:, :3]
        return (origins - superelement.center_of_mass) @ rotation.T, field
    step = max(1, len(superelement.recovery.points) // SAMPLES)
    chosen = np.arange(0, len(superelement.recovery.points), step)
    rows = (3 * chosen[:, None] + np.arange(3)).ravel()
    local = turn_dofs(superelement, placement) @ motion.deformation
    field = (superelement.recovery.basis[rows] @ local).reshape(-1, 3) @ rotation.T
    return (superelement.recovery.points[chosen] - superelement.center_of_mass) @ rotation.T, field

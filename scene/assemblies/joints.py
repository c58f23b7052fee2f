"""Joints of an assembly: what the motions of pairs stand for in a scene, and what is asked of each."""

import tomllib
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.assemblies.contact_patches import write_contact_patches
from headstock.geometry.assemblies.contacts import Contact
from headstock.geometry.assemblies.pair_motions import PairMotion, group_equal_pairs
from headstock.geometry.assemblies.parts import Assembly
from headstock.geometry.frames import FloatArray
from headstock.scene.assemblies.bodies import Seat, write_direction, write_point
from headstock.scene.expansion.catalogue import CATALOGUE, nearest_elements, read_catalogue
from headstock.scene.reading.files import TomlTable, TomlValue
from headstock.scene.reading.open_values import OPEN, REASON

ROLES = {"bonded": "seat", "fit": "fit", "guide": "guide", "bearing": "bearing", "screw": "thread"}
SLIDING = ("guide", "screw")  # joints across which an axis can move
OPPOSITE = -0.999  # cosine of normals of walls that face each other
LARGE = 0.02  # area of a contact over the surface of the smaller solid from which it deforms
LARGE_CONTACTS, SHAPES = "large_contacts", 24


@dataclass(frozen=True, eq=False)
class Link:
    """A pair of solids that is joined.

    Attributes:
        contacts: Through which it is.
        question: Name of the parameter of the scene that asks for the joint; empty where nothing is
            asked.
        keys: Of the joint, but its ends.
    """

    motion: PairMotion
    contacts: tuple[Contact, ...]
    question: str
    keys: TomlTable


class Questions:
    """Open values of a scene, as its parameters."""

    def __init__(self) -> None:
        self.parameters: TomlTable = {}

    def ask(self, name: str, default: TomlValue, reason: str) -> str:
        """Add a question, and return the expression that stands for its answer."""
        self.parameters[name] = {OPEN: default, REASON: reason}
        return f"= {name}"


def link_pairs(
    assembly: Assembly,
    contacts: Sequence[Contact],
    motions: Sequence[PairMotion],
    fasteners: Collection[int],
    questions: Questions,
) -> list[Link]:
    """Return the pairs that are joined; pairs that are equal ask one question.

    Args:
        fasteners: Solids that are left out.
        questions: Receives those of the joints.
    """
    parts = {one.solid: part.name for part in assembly.parts for one in part.placements}
    groups = group_equal_pairs(assembly, contacts)
    group_of = {pair: group[0] for group in groups for pair in group}
    touching: dict[int, set[int]] = {}
    for motion in motions:
        for one, other in (motion.solids, motion.solids[::-1]):
            touching.setdefault(one, set()).add(other)
    names: dict[tuple[int, int], str] = {}
    links = []
    for motion in motions:
        pair = motion.solids
        if set(pair) & set(fasteners):
            continue
        group = group_of[pair]
        if group not in names:
            stem = "_".join(dict.fromkeys(parts[number] for number in pair))
            again = sum(name.rstrip("0123456789") in (stem, f"{stem}_") for name in names.values())
            names[group] = f"{stem}_{again + 1}" if again else stem
        used = tuple(contacts[i] for i in motion.contacts)
        used = tuple(one for one in used if not one.wide or motion.likely == "guide") or used
        if motion.likely in ("bearing", "screw"):
            used = tuple(one for one in used if one.kind == "cylinder")
        certain = bool(touching[pair[0]] & touching[pair[1]] & set(fasteners))
        certain |= not motion.slides and not motion.turns
        links.append(_link(motion, used, names[group], questions, certain=certain))
    return links


def _link(
    motion: PairMotion,
    contacts: tuple[Contact, ...],
    name: str,
    questions: Questions,
    *,
    certain: bool,
) -> Link:
    at = np.mean([contact.center for contact in contacts], axis=0)
    if motion.likely == "guide":
        width, normal = _measure_rail(contacts, np.array(motion.slides[0]))
        size = nearest_elements(f"guide_{round(1e3 * width)}")[0]
        reason = f"{motion.reason}; the rail is {1e3 * width:.3g} mm wide"
        keys: TomlTable = {
            "from": questions.ask(name, f"{CATALOGUE}{size}", reason),
            "axis": write_direction(motion.slides[0]),
            "normal": write_direction(normal),
            "at": write_point(at),
        }
        return Link(motion, contacts, name, keys)
    if motion.likely in ("bearing", "screw"):
        _, direction = motion.turns[0]
        millimetres = round(2e3 * (contacts[0].radius or 0.0))
        reason = f"{motion.reason}; the shaft has a diameter of {millimetres} mm"
        keys = {"axis": write_direction(direction), "at": write_point(at)}
        if motion.likely == "bearing":
            element = f"{CATALOGUE}{nearest_elements(f'screw_bearing_{millimetres}')[0]}"
            keys["from"] = questions.ask(name, element, reason)
            # the motor is locked
            keys["stiffness"] = {"torsion": "rigid"}
        else:
            size = nearest_elements(f"ball_screw_{millimetres}x10")[0]
            # of the nut alone: the shaft is a component
            stiffness = read_catalogue()[size].joint["stiffness"]
            default = stiffness["axial"] if isinstance(stiffness, dict) else ""
            reason += f"; {CATALOGUE}{size}"
            keys |= {
                "kind": "ball_screw",
                "stiffness": {"axial": questions.ask(name, default, reason)},
            }
        return Link(motion, contacts, name, keys)
    if certain:
        return Link(motion, contacts, "", {"kind": "rigid"})
    return Link(motion, contacts, name, {"kind": questions.ask(name, "rigid", motion.reason)})


def seat_solids(
    assembly: Assembly, links: Sequence[Link], rigid: Collection[int], questions: Questions
) -> dict[int, list[Seat]]:
    """Return the interfaces that links need, by solid.

    Args:
        rigid: Numbers of solids that are rigid bodies.
        questions: Receives that of large contacts, where there are any.
    """
    solids = {solid.number: solid for solid in assembly.solids}
    placed = {one.solid: one for part in assembly.parts for one in part.placements}
    seats: dict[int, list[Seat]] = {}
    for link in links:
        area = sum(contact.area for contact in link.contacts)
        center = np.average(
            [contact.center for contact in link.contacts],
            axis=0,
            weights=[contact.area for contact in link.contacts],
        )
        coupling = "average" if link.motion.likely == "guide" else None
        smaller = min(solids[number].area for number in link.motion.solids)
        bonded = link.motion.likely == "bonded" and not set(link.motion.solids) & set(rigid)
        if bonded and area >= LARGE * smaller:
            coupling = questions.ask(
                LARGE_CONTACTS,
                {"flexible": SHAPES},
                "deformation shapes of bonded contacts that are a large part of a surface: rigid ones are too stiff",
            )
        for side, number in enumerate(link.motion.solids):
            place = placed[number]
            patches = [
                tomllib.loads(f"patch = {text}")["patch"]
                for contact in link.contacts
                for text in write_contact_patches(assembly, contact, side)
            ]
            shifted = (center - np.array(place.shift)) @ np.array(place.rotation)
            role = ROLES[link.motion.likely]
            seat = Seat(link.motion.solids, role, tuple(patches), shifted, area, coupling)
            seats.setdefault(number, []).append(seat)
    return seats


def _measure_rail(contacts: Sequence[Contact], slide: FloatArray) -> tuple[float, FloatArray]:
    """Return width [m] and normal ``(3,)`` of a rail: across the walls that face each other."""
    planes = [contact for contact in contacts if contact.kind == "plane"]
    normals = np.array([contact.axis for contact in planes])
    centers = np.array([contact.center for contact in planes])
    pairs = np.argwhere(normals @ normals.T < OPPOSITE)
    one, other = pairs[0]
    width = abs(float((centers[one] - centers[other]) @ normals[one]))
    return width, np.cross(slide, normals[one])

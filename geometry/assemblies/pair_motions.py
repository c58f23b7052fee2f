"""Motions that the contacts of two solids leave free, and the joint that the pair may be."""

from dataclasses import dataclass
from typing import Literal

from headstock.geometry.parts.cad_faces import Vector

JointGuess = Literal["bonded", "guide", "bearing", "screw", "fit"]


@dataclass(frozen=True)
class PairMotion:
    """A pair of solids that touch: what they can still do, and which joint it may be.

    Attributes:
        solids: Numbers of the solids, the smaller first.
        contacts: Indices of their contacts.
        slides: Orthonormal directions that no normal blocks: none, one or two.
        turns: A point [m] and the direction of each axis that it may turn about.
        likely: The joint that geometry, names and repetition speak for.
        reason: Why, in words of geometry.
    """

    solids: tuple[int, int]
    contacts: tuple[int, ...]
    slides: tuple[Vector, ...]
    turns: tuple[tuple[Vector, Vector], ...]
    likely: JointGuess
    reason: str

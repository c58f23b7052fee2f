"""Components of an assembly: solids of one shape that are held at the same places are one entry."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from headstock.geometry.assemblies.parts import Assembly, Part, Placement
from headstock.geometry.frames import FloatArray, find_axis
from headstock.scene.reading.files import TomlTable, TomlValue

SAME_PLACE = 1e-5  # of the centres of interfaces of equal solids [m]
SAME_AREA = 1e-3
TURNED = 1e-9  # smallest rotation that is written [rad]


@dataclass(frozen=True, eq=False)
class Seat:
    """Where a solid touches another, an interface of its component.

    Attributes:
        pair: Numbers of both solids.
        role: What it is called.
        patches: Tables of a scene, in the coordinates of the part's first solid.
        center: ``(3,)`` in these coordinates [m].
        area: [m^2].
        coupling: As the scene has it; None for the default.
    """

    pair: tuple[int, int]
    role: str
    patches: tuple[TomlTable, ...]
    center: FloatArray
    area: float
    coupling: str | None

    def is_like(self, other: "Seat") -> bool:
        """Return whether another solid of the part may have it as the same interface."""
        return (
            (self.role, self.coupling) == (other.role, other.coupling)
            and float(np.linalg.norm(self.center - other.center)) <= SAME_PLACE
            and abs(self.area - other.area) <= SAME_AREA * self.area
        )


@dataclass(eq=False)
class Body:
    """One entry of the components of a scene.

    Attributes:
        name: Of the entry; of several places ``NAME_1``, ``NAME_2``, ...
        seats: Of the first solid, by the name of the interface.
        ends: Per solid its pairs with the names of their interfaces.
        free: Interfaces at which no other solid is.
    """

    part: Part
    name: str
    placements: list[Placement]
    seats: dict[str, Seat]
    ends: dict[int, dict[tuple[int, int], str]] = field(default_factory=dict)
    free: dict[str, TomlTable] = field(default_factory=dict)

    def member(self, solid: int) -> str:
        """Return the component's name of one of its solids."""
        numbers = [placement.solid for placement in self.placements]
        return self.name if len(numbers) == 1 else f"{self.name}_{numbers.index(solid) + 1}"

    def join(self, placement: Placement, seats: Sequence[Seat]) -> bool:
        """Add a solid whose seats are like those of the first one; return whether they are."""
        left = dict(self.seats)
        names: dict[tuple[int, int], str] = {}
        for seat in seats:
            name = next((name for name, one in left.items() if one.is_like(seat)), None)
            if name is None:
                return False
            del left[name]
            names[seat.pair] = name
        if left:
            return False
        self.placements.append(placement)
        self.ends[placement.solid] = names
        return True

    def write(self, file: str, **keys: TomlValue) -> TomlTable:
        """Return the entry as a scene has it.

        Args:
            file: Name of the STEP file.
            keys: Material, fidelity.
        """
        table: TomlTable = {
            "solid": {"step": file, "solid": self.part.placements[0].solid},
            **keys,
        }
        places: list[TomlValue] = [write_point(one.shift) for one in self.placements]
        turns = [_write_rotation(np.array(one.rotation)) for one in self.placements]
        if len(places) == 1:
            table |= {"at": places[0]} if np.any(self.placements[0].shift) else {}
            table |= {"rotate": turns[0]} if turns[0] else {}
        else:
            table["places"] = places
            each: TomlTable = {str(n): {"rotate": turn} for n, turn in enumerate(turns, 1) if turn}
            table |= {"each": each} if each else {}
        seats = {name: _write_seat(seat) for name, seat in self.seats.items()}
        return table | {"interfaces": {**seats, **self.free}}


def list_bodies(
    assembly: Assembly, seats: Mapping[int, Sequence[Seat]], left_out: Collection[int]
) -> list[Body]:
    """Return the components of an assembly.

    Args:
        seats: Of each solid.
        left_out: Numbers of solids that are no components.
    """
    bodies: list[Body] = []
    for part in assembly.parts:
        alike: list[Body] = []
        for placement in part.placements:
            held = seats.get(placement.solid, ())
            if placement.solid in left_out or any(body.join(placement, held) for body in alike):
                continue
            named = _name_seats(held)
            body = Body(part, part.name, [placement], named)
            body.ends[placement.solid] = {seat.pair: name for name, seat in named.items()}
            alike.append(body)
        for index, body in enumerate(alike if len(alike) > 1 else ()):
            body.name = f"{part.name}_{_letter(index)}"
        bodies += alike
    return bodies


def _letter(index: int) -> str:
    """``a`` to ``z``, then ``aa``."""
    high, low = divmod(index, 26)
    return (_letter(high - 1) if high else "") + chr(ord("a") + low)


def _name_seats(seats: Sequence[Seat]) -> dict[str, Seat]:
    """Names of the interfaces of a solid: by role, numbered where there are several of one."""
    roles = [seat.role for seat in seats]
    counts: dict[str, int] = {}
    named: dict[str, Seat] = {}
    for seat in seats:
        counts[seat.role] = counts.get(seat.role, 0) + 1
        several = roles.count(seat.role) > 1
        named[f"{seat.role}_{counts[seat.role]}" if several else seat.role] = seat
    return named


def _write_seat(seat: Seat) -> TomlTable:
    one = len(seat.patches) == 1
    table: TomlTable = dict(seat.patches[0]) if one else {"patches": [*seat.patches]}
    return table if seat.coupling is None else table | {"coupling": seat.coupling}


def _write_rotation(rotation: FloatArray) -> TomlTable | None:
    """Return a rotation matrix ``(3, 3)`` as a scene has it; None where nothing is turned."""
    axis = np.linalg.svd(rotation - np.eye(3))[2][2]
    skew = rotation - rotation.T
    sine = 0.5 * float(np.dot([skew[2, 1], skew[0, 2], skew[1, 0]], axis))
    angle = float(np.arctan2(sine, 0.5 * (np.trace(rotation) - 1.0)))
    if abs(angle) <= TURNED:
        return None
    return {"axis": write_direction(axis), "angle": f"{np.degrees(angle):.12g} deg"}


def write_direction(vector: Sequence[float] | FloatArray) -> TomlValue:
    """Return a unit vector as a scene has it: ``x``, ``-x`` or three numbers."""
    if found := find_axis(vector):
        return found[0] if found[1] > 0.0 else f"-{found[0]}"
    return [round(float(value), 12) for value in vector]


def write_point(values: Sequence[float] | FloatArray) -> list[TomlValue]:
    """Return a place [m] as a scene has it."""
    return [f"{round(1e3 * float(value), 5) + 0.0:.10g} mm" for value in values]

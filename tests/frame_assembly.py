"""A machine frame of 38 solids whose contacts are known, written with gmsh; sizes in mm."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import gmsh

Contact = tuple[str, str, str, float]  # names of two solids, kind, gap [mm]


@dataclass
class Frame:
    """Solids of the open model by name, in the order of their numbers, and their contacts."""

    tags: dict[str, int] = field(default_factory=dict)
    contacts: list[Contact] = field(default_factory=list)

    def add(self, name: str, tag: int, *cuts: int) -> None:
        """Add a solid, other solids cut out of it."""
        if cuts:
            ((_, tag),) = gmsh.model.occ.cut([(3, tag)], [(3, cut) for cut in cuts])[0]
        self.tags[name] = tag

    def touch(self, name: str, *others: str, kind: str = "plane", gap: float = 0.0) -> None:
        """Note contacts of one solid with others."""
        self.contacts += [(name, other, kind, gap) for other in others]

    def numbers(self) -> dict[str, int]:
        """Number of each solid in the file, which counts by tag."""
        order = sorted(self.tags.values())
        return {name: order.index(tag) + 1 for name, tag in self.tags.items()}

    def expected(self) -> list[tuple[int, int, str, float]]:
        """Numbers, kind and gap of each contact, sorted."""
        numbers = self.numbers()
        rows = ((numbers[a], numbers[b], kind, gap) for a, b, kind, gap in self.contacts)
        return sorted((min(a, b), max(a, b), kind, gap) for a, b, kind, gap in rows)


def box(low: Sequence[float], high: Sequence[float]) -> int:
    return int(gmsh.model.occ.addBox(*low, *(b - a for a, b in zip(low, high, strict=True))))


def rod(x: float, y: float, low: float, high: float, diameter: float, axis: str = "z") -> int:
    """A cylinder along z, or along y with ``y`` as its height."""
    if axis == "y":
        return int(gmsh.model.occ.addCylinder(x, low, y, 0, high - low, 0, diameter / 2))
    return int(gmsh.model.occ.addCylinder(x, y, low, 0, 0, high - low, diameter / 2))


def fuse(*tags: int) -> int:
    ((_, tag),) = gmsh.model.occ.fuse([(3, tags[0])], [(3, tag) for tag in tags[1:]])[0]
    return int(tag)


def add_guide(
    frame: Frame, name: str, x: float, air: float, places: Sequence[float], table: str | None = None
) -> None:
    """A rail along y on a beam, screwed to it, and carriages on it with air around the rail, each
    with a dowel.
    """
    screws = [(f"{name}_screw_{i}", y) for i, y in enumerate((40.0, 360.0), 1)]
    frame.add(
        f"{name}_rail",
        box((x - 10, 30, 90), (x + 10, 370, 110)),
        *(rod(x, y, 80, 111, 6.6) for _, y in screws),
        *(rod(x, y, 104, 111, 11) for _, y in screws),
    )
    frame.touch(f"{name}_rail", f"{name}_beam")
    for screw, y in screws:
        frame.add(screw, fuse(rod(x, y, 78, 104, 6), rod(x, y, 104, 110, 10)))
        frame.touch(screw, f"{name}_rail")
        frame.touch(screw, f"{name}_beam", kind="cylinder", gap=-0.5)
    for i, y in enumerate(places, 1):
        carriage, dowel = f"{name}_carriage_{i}", f"{name}_dowel_{i}"
        slot = box((x - 10 - air, y - 30, 100), (x + 10 + air, y + 30, 110 + air))
        block = box((x - 30, y - 30, 100), (x + 30, y + 30, 130))
        frame.add(carriage, block, slot, rod(x, y, 118, 131, 8))
        for _ in range(3):
            frame.touch(carriage, f"{name}_rail", gap=air)
        frame.add(dowel, rod(x, y, 120, 150, 8))
        frame.touch(dowel, carriage, kind="cylinder")
        if table:
            frame.touch(carriage, table)
            frame.touch(dowel, table, kind="cylinder")


def add_cover(frame: Frame, name: str, x: float, z: float) -> None:
    """A cover apart from a side of a solid by two washers."""
    frame.add("cover", box((x - 11, 20, z - 15), (x - 1, 380, z + 15)))
    for i, y in enumerate((100.0, 300.0), 1):
        tag = gmsh.model.occ.addCylinder(x - 1, y, z, 1, 0, 0, 10)
        frame.add(f"washer_{i}", tag, gmsh.model.occ.addCylinder(x - 2, y, z, 3, 0, 0, 5))
        frame.touch(f"washer_{i}", name, "cover")


def build_small_frame() -> Frame:
    """Build a guide with air and a cover on a beam in the open model: 11 solids."""
    frame = Frame()
    frame.add("left_beam", box((50, 20, 30), (110, 380, 90)), *beam_tool(80.0))
    add_guide(frame, "left", 80.0, 3.0, (150.0, 250.0))
    add_cover(frame, "left_beam", 50.0, 60.0)
    return frame


def beam_tool(x: float) -> list[int]:
    """Threaded holes for the screws of a rail."""
    return [rod(x, y, 75, 91, 5) for y in (40.0, 360.0)]


def build_frame(carriages: Sequence[float] = (150.0, 250.0)) -> Frame:
    """Build the frame in the open model.

    Args:
        carriages: Their places on each of the two rails.
    """
    frame = Frame()
    foot_screws = {
        f"{side}_foot_screw_{i}": (x, y)
        for side, x in (("left", 60.0), ("right", 500.0))
        for i, y in enumerate((60.0, 340.0), 1)
    }
    frame.add(
        "base",
        box((0, 0, 0), (600, 400, 30)),
        *(rod(x, y, 10, 31, 6.8) for x, y in foot_screws.values()),
    )
    left, right = box((50, 20, 30), (110, 380, 90)), box((490, 20, 30), (550, 380, 90))
    right = fuse(right, box((530, 20, 90), (550, 380, 95)))  # a shoulder
    for side, beam, x in (("left", left, 80.0), ("right", right, 520.0)):
        through = [rod(*at, 29, 96, 9) for name, at in foot_screws.items() if side in name]
        frame.add(f"{side}_beam", beam, *beam_tool(x), *through)
        frame.touch(f"{side}_beam", "base")
        add_guide(frame, side, x, 3.0 if side == "left" else 0.0, carriages, "table")
    frame.touch("right_rail", "right_beam")
    for name, (x, y) in foot_screws.items():
        frame.add(name, fuse(rod(x, y, 15, 90, 8), rod(x, y, 90, 98, 13)))
        frame.touch(name, f"{name.split('_')[0]}_beam")
        frame.touch(name, "base", kind="cylinder", gap=-0.6)
    dowels = [rod(x, y, 129, 151, 8) for x in (80, 520) for y in carriages]
    frame.add(
        "table",
        box((40, min(carriages) - 50, 130), (560, max(carriages) + 50, 150)),
        *dowels,
        box((120, 120, 140), (180, 180, 151)),
    )
    frame.add("insert", box((122, 122, 140), (178, 178, 155)))
    frame.add("workpiece", box((250, 150, 150.05), (350, 250, 190)))
    frame.add("clamp", box((400, 150, 149.9), (440, 250, 170)))
    frame.add("key", box((200, 120, 149), (220, 160, 160)))
    for name, gap in (("insert", 0.0), ("workpiece", 0.05), ("clamp", -0.1), ("key", -1.0)):
        frame.touch(name, "table", gap=gap)
    frame.add("column", box((240, 320, 30), (360, 380, 300)))
    frame.add("headstock", box((260, 220, 200), (340, 320, 280)), rod(300, 240, 219, 300, 40, "y"))
    frame.add("spindle", rod(300, 240, 190, 295, 25, "y"))
    frame.touch("column", "base", "headstock")
    for name, y in (("bearing_1", 225.0), ("bearing_2", 275.0)):
        frame.add(name, rod(300, 240, y, y + 12, 40, "y"), rod(300, 240, y - 1, y + 13, 25, "y"))
        frame.touch(name, "spindle", "headstock", kind="cylinder")
    for i, (x, y) in enumerate(((50, 50), (550, 50), (50, 350), (550, 350)), 1):
        frame.add(f"foot_{i}", rod(x, y, -20, 0, 60))
        frame.touch(f"foot_{i}", "base")
    add_cover(frame, "base", 0.0, 15.0)
    return frame

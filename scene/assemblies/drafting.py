"""The text of a scene for an assembly: one list of questions, then components, joints, axes and points."""

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.assemblies.contacts import Contact
from headstock.geometry.assemblies.fasteners import find_fasteners
from headstock.geometry.assemblies.pair_motions import PairMotion
from headstock.geometry.assemblies.parts import Assembly, TreeNode
from headstock.geometry.frames import find_axis
from headstock.geometry.machine.joints import connected_groups
from headstock.scene.assemblies.bodies import list_bodies
from headstock.scene.assemblies.joints import SLIDING, Link, Questions, link_pairs, seat_solids
from headstock.scene.reading.files import TomlTable, TomlValue, write_toml, write_value

MATERIALS = {  # with what in a name hints at each; the first is the default
    "steel": (("210 GPa", 0.3, "7850 kg/m^3"), r"steel|stahl"),
    "cast_iron": (("120 GPa", 0.26, "7200 kg/m^3"), r"cast|iron|guss|ggg?\d"),
    "aluminium": (("70 GPa", 0.33, "2700 kg/m^3"), r"alu"),
    "granite": (("60 GPa", 0.25, "2700 kg/m^3"), r"granit"),
    "mineral_casting": (("40 GPa", 0.25, "2400 kg/m^3"), r"mineral|polymer"),
}
ACROSS = 2  # elements
DENSITY = 7850.0  # of screws [kg/m^3]
SMALL = 0.01  # volume of a rigid part over that of the largest
SLENDER = 4.0  # longest side of a part over the middle one from which it bends
DEEP = 30  # components from which each subassembly has a file of its own
MODES = 12
LEFT_OUT = "left_out"
UP = "z"
TOOL_WORDS, WORK_WORDS = r"spindle|tool|spindel|werkzeug|headstock", r"table|tisch|pallet|work"
HEADER = """\
# Made of {file}: {count} solids, {parts} shapes. Every value that is not sure is a question in [parameters]:
# write another value in its place, or run with --accept-defaults. `headstock check {scene}` lists the questions,
# `headstock show {scene}` draws the parts apart, with the places where they touch.
"""
LEFT = "# Screws, nuts and washers are left out; {name}.csv has their masses: {names}.\n"


@dataclass(frozen=True)
class DraftedScene:
    """Files of a scene, and what was found.

    Attributes:
        texts: By file name; the scene's own is the first.
        questions: How many values are open.
        left_out: Numbers of the solids that are point masses.
    """

    texts: Mapping[str, str]
    questions: int
    left_out: tuple[int, ...]


def draft_scene(
    assembly: Assembly,
    contacts: Sequence[Contact],
    motions: Sequence[PairMotion],
    *,
    scene: str,
    name: str,
    ends_of: Callable[[int], Collection[str]],
) -> DraftedScene:
    """Write the scene of an assembly.

    Args:
        scene: Name of its file.
        ends_of: Returns which of ``x- x+ y- y+ z- z+`` a solid, by its number, has plane faces at.
    """
    draft = _Draft(assembly, contacts, motions)
    tables = draft.write(ends_of)
    count = len(draft.bodies_of)
    parts = len(assembly.parts)
    text = HEADER.format(
        file=assembly.path.name, count=len(assembly.solids), parts=parts, scene=scene
    )
    for remark in (*assembly.remarks, *draft.faults()):
        text += f"# {' '.join(remark.split())}\n"
    texts: dict[str, str] = {}
    if draft.fasteners:
        names = sorted({_name_of(assembly, number) for number in draft.fasteners})
        text += LEFT.format(name=LEFT_OUT, names=", ".join(names))
        texts[f"{LEFT_OUT}.csv"] = draft.list_masses()
    root: TomlTable = {"name": name}
    if count > DEEP:
        components = tables.pop("components")
        files = _split_components(
            assembly, draft, components if isinstance(components, dict) else {}
        )
        root["include"] = [*files]
        texts |= {file: write_toml({"components": {**table}}) for file, table in files.items()}
    questions = draft.questions.parameters
    listed = "".join(f"{key} = {write_value(value)}\n" for key, value in questions.items())
    text += f"{write_toml(root)}\n[parameters]\n{listed}\n{write_toml(tables)}"
    return DraftedScene({scene: text, **texts}, len(questions), tuple(draft.fasteners))


class _Draft:
    """A scene while it is written."""

    def __init__(
        self, assembly: Assembly, contacts: Sequence[Contact], motions: Sequence[PairMotion]
    ) -> None:
        self.assembly, self.questions = assembly, Questions()
        self.solids = {solid.number: solid for solid in assembly.solids}
        self.fasteners = find_fasteners(assembly, contacts, motions)
        kept = [solid for solid in assembly.solids if solid.number not in self.fasteners]
        self.largest = max(kept, key=lambda solid: solid.volume)
        self.rigid = [solid.number for solid in kept if self._is_compact(solid.number)]
        self.links = link_pairs(assembly, contacts, motions, self.fasteners, self.questions)
        seats = seat_solids(assembly, self.links, self.rigid, self.questions)
        self.bodies = list_bodies(assembly, seats, self.fasteners)
        self.bodies_of = {one.solid: body for body in self.bodies for one in body.placements}

    def faults(self) -> Iterator[str]:
        """Yield what is wrong with parts."""
        for part in self.assembly.parts:
            if part.fault is not None:
                yield f"{part.name} cannot be meshed and is rigid: {part.fault}"

    def _is_compact(self, number: int) -> bool:
        """Return whether a solid is small and deforms less than its joints."""
        solid = self.solids[number]
        _, middle, longest = sorted(np.subtract(solid.high, solid.low))
        return solid.volume <= SMALL * self.largest.volume and longest < SLENDER * middle

    def write(self, ends_of: Callable[[int], Collection[str]]) -> TomlTable:
        """Return the tables of the scene."""
        joints = {self._name_joint(link): link for link in self.links}
        groups = self._group_bodies(joints)
        ground = self._find_ground(groups)
        foot = self._add_end(ground, ("z-",), "foot", ends_of)
        tables: TomlTable = {name: self._write_joint(link) for name, link in joints.items()}
        default = f"{self._member(ground)}.{foot}"
        held = self.questions.ask("ground", default, "part that is lowest and heaviest")
        tables["to_ground"] = {"between": ["ground", held], "kind": "rigid"}
        points = self._write_point(groups, ground, ends_of)
        axes = self._write_axes(joints, groups)
        components = self._write_components()
        used = {str(table.get("material")) for table in components.values()}
        materials: TomlTable = {
            name: dict(zip(("E", "nu", "rho"), values, strict=True))
            for name, (values, _) in MATERIALS.items()
            if f"= material_{name}" in used or name == "steel"
        }
        scene: TomlTable = {"materials": materials, "components": {**components}, "joints": tables}
        scene |= {"axes": axes} if axes else {}
        scene["points"] = {"tcp": points}
        if self.fasteners:
            longest = max(
                float(np.linalg.norm(np.subtract(self.solids[n].high, self.solids[n].low)))
                for n in self.fasteners
            )
            reach = f"{1e3 * longest:.3g} mm"
            scene["masses"] = {
                LEFT_OUT: {"file": f"{LEFT_OUT}.csv", "frame": "machine", "reach": reach}
            }
        return scene | {"analyses": {"modal": {"count": MODES}, "static": {"at": "tcp"}}}

    def list_masses(self) -> str:
        """Return the table of the solids that are left out."""
        rows = ["name,component,x [mm],y [mm],z [mm],mass [g]"]
        for number, host in self.fasteners.items():
            solid = self.solids[number]
            place = ",".join(f"{1e3 * value:.4f}" for value in solid.center)
            mass = f"{1e3 * DENSITY * solid.volume:.5g}"
            rows.append(f"solid_{number},{self._member(host)},{place},{mass}")
        return "\n".join(rows) + "\n"

    def _member(self, number: int) -> str:
        return self.bodies_of[number].member(number)

    def _name_joint(self, link: Link) -> str:
        first, second = (self._member(number) for number in link.motion.solids)
        return f"{first}_to_{second}"

    def _write_joint(self, link: Link) -> TomlTable:
        pair = link.motion.solids
        ends: list[TomlValue] = [
            f"{self._member(number)}.{self.bodies_of[number].ends[number][pair]}" for number in pair
        ]
        return {"between": ends, **link.keys}

    def _write_components(self) -> dict[str, TomlTable]:
        tables: dict[str, TomlTable] = {}
        for body in self.bodies:
            number = body.placements[0].solid
            name = f"{_name_of(self.assembly, number)} {self.solids[number].product}".lower()
            hints = (key for key, (_, words) in MATERIALS.items() if re.search(words, name))
            hint = next(hints, "steel")
            reason = (
                f"a name says so, as {name.split()[0]}" if hint != "steel" else "no part names one"
            )
            keys: TomlTable = {"material": self.questions.ask(f"material_{hint}", hint, reason)}
            if body.part.fault is not None:
                keys["fidelity"] = "rigid"
            elif number in self.rigid:
                keys["fidelity"] = self.questions.ask(
                    "small_parts",
                    "rigid",
                    f"compact, and below {100.0 * SMALL:g} % of the largest part",
                )
            else:
                across = self.questions.ask(
                    "across_patches", ACROSS, "elements across each contact: more take much longer"
                )
                keys["mesh"] = {"across_patches": across}
            tables[body.name] = body.write(self.assembly.path.name, **keys)
        return tables

    def _group_bodies(self, joints: Mapping[str, Link]) -> list[list[int]]:
        """Return groups of solids that no guide or screw divides."""
        edges = [
            link.motion.solids for link in joints.values() if link.motion.likely not in SLIDING
        ]
        named = [(str(one), str(other)) for one, other in edges]
        return [
            [int(n) for n in group] for group in connected_groups(map(str, self.bodies_of), named)
        ]

    def _find_ground(self, groups: Sequence[Sequence[int]]) -> int:
        """Return the largest solid of the group that reaches lowest."""
        axis = "xyz".index(UP)
        lowest = min(
            groups,
            key=lambda group: (
                round(min(self.solids[n].low[axis] for n in group), 4),
                -sum(self.solids[n].volume for n in group),
            ),
        )
        return max(lowest, key=lambda n: self.solids[n].volume)

    def _add_end(
        self,
        number: int,
        sides: Sequence[str],
        name: str,
        ends_of: Callable[[int], Collection[str]],
    ) -> str:
        """Add an interface at an end of a part, the first of some that is plane, and return its name."""
        body = self.bodies_of[number]
        present = ends_of(body.part.placements[0].solid)
        side = next((one for one in sides if one in present), None) or next(iter(present), sides[0])
        body.free[name] = (
            {"face": side} if name == "foot" else {"face": side, "coupling": "average"}
        )
        return name

    def _write_point(
        self,
        groups: Sequence[Sequence[int]],
        ground: int,
        ends_of: Callable[[int], Collection[str]],
    ) -> TomlTable:
        """Return where the tool and the work are: on bodies at the ends of chains of guides."""
        moving = [group for group in groups if ground not in group]
        largest = [max(group, key=lambda n: self.solids[n].volume) for group in moving]
        still = [number for number in self.bodies_of if number != ground] or [ground]

        def score(number: int, words: str) -> tuple[bool, float]:
            named = re.search(words, _name_of(self.assembly, number).lower()) is not None
            return named, self.solids[number].high["xyz".index(UP)]

        tool = max(largest or still, key=lambda number: score(number, TOOL_WORDS))
        rest = [number for number in largest if number != tool]
        sides = ("z-", "z+") if rest else ("z+", "x+", "y+")
        end = self._add_end(tool, sides, "tool", ends_of)
        named = f"{self._member(tool)}.{end}"
        point: TomlTable = {
            "tool": self.questions.ask(
                "tool", named, f"highest of the parts{' that move' if largest else ''}"
            )
        }
        if not rest:
            return point | {"work": "ground"}
        work = max(rest, key=lambda number: score(number, WORK_WORDS))
        named = f"{self._member(work)}.{self._add_end(work, ('z+',), 'work', ends_of)}"
        return point | {
            "work": self.questions.ask("work", named, "highest of the other parts that move")
        }

    def _write_axes(self, joints: Mapping[str, Link], groups: Sequence[Sequence[int]]) -> TomlTable:
        """Return an axis for each two groups that guides alone join, in one direction."""
        group_of = {number: index for index, group in enumerate(groups) for number in group}
        across: dict[tuple[int, ...], list[str]] = {}
        for name, link in joints.items():
            if link.motion.likely in SLIDING:
                sides = tuple(sorted({group_of[number] for number in link.motion.solids}))
                across.setdefault(sides, []).append(name)
        axes: TomlTable = {}
        for sides, names in across.items():
            guides = [joints[name] for name in names if joints[name].motion.likely == "guide"]
            directions = np.array([guide.motion.slides[0] for guide in guides])
            if (
                len(sides) < 2
                or not guides
                or np.abs(directions @ directions[0]).min() < 1.0 - 1e-6
            ):
                continue
            found = find_axis(directions[0], 1e-6)
            letter = found[0].upper() if found else "U"
            free = (f"{letter}{n}" if n else letter for n in range(len(across)))
            axes[next(name for name in free if name not in axes)] = {"joints": [*names]}
        return axes


def _name_of(assembly: Assembly, number: int) -> str:
    """Return what a solid is called: its occurrence in the tree, or its part."""
    solid = assembly.solids[number - 1]
    if solid.names:
        return solid.names[-1]
    return next(
        part.name for part in assembly.parts if any(one.solid == number for one in part.placements)
    )


def _split_components(
    assembly: Assembly, draft: _Draft, components: Mapping[str, TomlValue]
) -> dict[str, dict[str, TomlValue]]:
    """Return components by file: one for each subassembly of the root, one for the others."""
    files: dict[str, dict[str, TomlValue]] = {}
    branches = [
        (node, set(_solids_below(node))) for node in assembly.tree.children if node.children
    ]
    for body in draft.bodies:
        number = body.placements[0].solid
        branch = next((node.name for node, inside in branches if number in inside), "parts")
        stem = re.sub(r"\W+", "_", branch, flags=re.ASCII).strip("_").lower() or "parts"
        files.setdefault(f"{stem}.toml", {})[body.name] = components[body.name]
    return files


def _solids_below(node: TreeNode) -> Iterable[int]:
    return (number for one in node.walk() for number in one.solids)

"""Schema of supports, static loads and probes."""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from headstock.geometry.parts.components import NORMAL
from headstock.scene.reading.units import quote_value
from headstock.scene.schema import types
from headstock.scene.schema.patches import SHAPES, ShapedTable

FIXED = ("x", "y", "z", NORMAL)


def _read_fixed(value: object) -> object:
    if isinstance(value, str) and value in FIXED:
        return value
    if not isinstance(value, list):
        raise types.problem(
            f"{quote_value(value)} is no direction that can be fixed; write x, y, z, {NORMAL}, or three plain numbers such as [1, 1, 0]"
        )
    return types.read_direction(value)


# of the component: x, y, z, a vector, or normal to the face at every point
Fixed = Annotated[
    str | tuple[float, float, float],
    BeforeValidator(_read_fixed),
    types.describe_direction(
        f"x, y, z, {NORMAL} or three plain numbers", FIXED, "x", NORMAL, [1, 1, 0]
    ),
]


class SupportTable(ShapedTable):
    """Pointwise support of a face (`component.face`), of an interface's patches (`at =
    component.interface`), or of the edge between two faces.
    """

    face: types.Text | None = None
    """face whose nodes are fixed: `component.face`"""
    at: types.Text | None = None
    """interface whose nodes are fixed: `component.interface`"""
    edge: Annotated[list[types.Text], Field(min_length=2, max_length=2)] | None = None
    """two faces of a component, whose common edge is fixed"""
    fix: Annotated[list[Fixed], Field(min_length=1, max_length=3)]
    """directions fixed at every node, of the component's frame: `x`, `y`, `z`, three numbers, or `normal` to the face"""

    @property
    def owner(self) -> str:
        """The component it holds."""
        return (self.edge[0] if self.edge else self.face or self.at or "").partition(".")[0]

    def _faults(self) -> Iterator[str]:
        if len(set(self.fix)) < len(self.fix):
            yield "names a direction twice in fix"
        yield from super()._faults()
        if self.edge is None:
            yield from _area_faults(self.face, self.at, shaped=bool(self.shapes))
            return
        for face in self.edge:
            yield from _area_faults(face, None, shaped=bool(self.shapes))
        if self.face is not None or self.at is not None or self.shapes:
            yield "an edge is where two whole faces meet; remove face, at and shapes"
        if len({face.partition(".")[0] for face in self.edge}) > 1:
            yield 'an edge lies between two faces of one component; write edge = ["plate.z-", "plate.x-"]'
        if NORMAL in self.fix:
            yield "an edge has no one normal; write directions such as x or [1, 0, 1]"


LoadKind = Literal["force", "traction", "pressure", "body", "displacement", "base"]
LOAD_KINDS: dict[LoadKind, tuple[str, ...]] = {
    "force": ("force", "moment"),
    "traction": ("traction",),
    "pressure": ("pressure",),
    "body": ("body",),
    "displacement": ("displacement", "rotation"),
    "base": ("base",),
}


class LoadTable(ShapedTable):
    """A static load: force and moment at an interface, traction or pressure on an area, a body
    acceleration field, a displacement and rotation that a joint is given, or an acceleration of the
    ground.
    """

    at: types.Text | None = None
    """point or `component.interface` on which a force or moment acts"""
    face: types.Text | None = None
    """`component.face` on which a pressure or traction acts"""
    component: types.Text | None = None
    """component on which a body force acts"""
    force: Annotated[list[types.Force], Field(min_length=3, max_length=3)] | None = None
    """force along x, y, z"""
    moment: Annotated[list[types.Moment], Field(min_length=3, max_length=3)] | None = None
    """moment about x, y, z"""
    traction: Annotated[list[types.Pressure], Field(min_length=3, max_length=3)] | None = None
    """force per area along x, y, z"""
    pressure: types.Pressure | None = None
    """pressure against the face"""
    body: Annotated[list[types.Acceleration], Field(min_length=3, max_length=3)] | None = None
    """acceleration along x, y, z that acts on the mass"""
    joint: types.Text | None = None
    """joint that is displaced: its ground moves, or its second end relative to the first"""
    displacement: Annotated[list[types.Length], Field(min_length=3, max_length=3)] | None = None
    """displacement of the joint's point along x, y, z"""
    rotation: Annotated[list[types.Angle], Field(min_length=3, max_length=3)] | None = None
    """small rotation about x, y, z through the joint's point"""

    base: Annotated[list[types.Acceleration], Field(min_length=3, max_length=3)] | None = None
    """acceleration of the ground along x, y, z; motions are relative to it"""

    @property
    def owner(self) -> str:
        """The component it acts on; empty of a displacement and of a moving ground."""
        return self.component or (self.face or self.at or "").partition(".")[0]

    @property
    def kind(self) -> LoadKind:
        """Return which kind of load was written."""
        return next(kind for kind, keys in LOAD_KINDS.items() if self.given(keys))

    def _faults(self) -> Iterator[str]:
        kinds = [kind for kind, keys in LOAD_KINDS.items() if self.given(keys)]
        if len(kinds) != 1:
            yield "needs exactly one of force (with moment), traction, pressure, body, displacement (with rotation), base"
        places = self.given(("at", "face", "component", "joint")).keys()
        if "base" in kinds:
            if places:
                yield f"base moves the whole ground; remove {next(iter(places))}"
        elif "joint" in places or "displacement" in kinds:
            if places != {"joint"} or "displacement" not in kinds:
                yield 'a displacement is given to a joint; write joint = "foot", displacement = ["0 um", "0 um", "-20 um"]'
        elif "force" in kinds and "at" not in places:
            yield 'a force or moment acts at an interface; write at = "component.interface"'
        elif "body" in kinds:
            if places != {"component"}:
                yield 'a body load acts on a whole component; write component = "name"'
        elif "component" in places:
            yield '`component` goes with body loads; write face = "component.z+" or at = "component.interface"'
        else:
            yield from super()._faults()
            yield from _area_faults(self.face, self.at, shaped=bool(self.shapes))


class ProbeTable(types.StrictTable):
    """A place on an elastic component, in its own frame, where displacement and stress under the
    loads are wanted.
    """

    component: types.Text
    """name of an elastic component"""
    at: types.Position
    """position in the component's frame"""


def _area_faults(face: str | None, at: str | None, *, shaped: bool) -> Iterator[str]:
    """Yield why an area is given twice or not at all.

    Args:
        face: ``component.face``, where given.
        at: ``component.interface``, where given.
        shaped: It is only a part of a face.
    """
    if (face is None) == (at is None):
        yield 'needs either face = "component.z-" or at = "component.interface"'
    if at is not None and shaped:
        yield f"an interface brings its own patches; {', '.join(SHAPES)} go with face"
    text = face if face is not None else at or ""
    if text.count(".") != 1 or not all(text.split(".")):
        yield f'{text!r:.80} names no component and area; write "component.z-" or "component.interface"'

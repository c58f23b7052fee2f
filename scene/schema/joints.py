"""Schema of joints: shafts of ball screws, carriages on rails, the joint itself, and chains of masses
and springs.
"""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from headstock.scene.schema import types
from headstock.scene.schema.guide_errors import RailErrorsTable


class ScrewTable(types.StrictTable):
    """The shaft of a ball screw between its bearings; the motor is locked."""

    origin: Annotated[types.Text | None, Field(alias="from")] = None
    """a ball screw of the [catalogue](catalogue.md), such as `"catalogue:ball_screw_40x10"`, for diameter and lead"""
    diameter: types.PositiveLength
    """diameter of the load-carrying cross-section: root diameter, or the effective one of the manufacturer; not needed with `from`, which
    brings it"""
    bore: types.NotNegativeLength = 0.0
    """diameter of a hollow screw's bore, smaller than `diameter`"""
    E: types.PositivePressure | None = None
    """Young's modulus; default: 210 GPa"""
    nu: types.Number | None = None
    """Poisson's ratio, above -1 and below 0.5; default: 0.3"""
    lead: types.PositiveLength | None = None
    """travel per turn; with it the shaft's twist and the coupling add compliance along the thread; default: none, the shaft stretches
    only"""
    bearing: types.PositiveStiffness | None = None
    """axial stiffness of the fixed bearing, or that of one of the [catalogue](catalogue.md), `"catalogue:screw_bearing_30"`; default:
    rigid"""
    coupling: types.PositiveRotationalStiffness | None = None
    """torsional stiffness between shaft and motor; default: rigid"""
    floating_end: types.End | None = None
    """interface of a floating bearing at the free end of the shaft; default: none, that end is free"""
    second_end: types.End | None = None
    """interface of a second fixed bearing; default: none, that end is free"""
    second_bearing: types.PositiveStiffness | None = None
    """axial stiffness of the second bearing; default: rigid"""
    length: types.PositiveLength | None = None
    """length of the shaft between both fixed bearings; only with `second_end`, which needs it"""

    def _faults(self) -> Iterator[str]:
        if self.bore >= self.diameter:
            yield f"its bore of {1e3 * self.bore:.6g} mm is not smaller than its diameter of {1e3 * self.diameter:.6g} mm"
        if (self.second_end is None) != (self.length is None):
            yield (
                "a second fixed bearing needs the shaft's length between both, and only it does;"
                ' write second_end = "bed.bearing_2", length = "900 mm"'
            )
        if self.second_end is not None and self.floating_end is not None:
            yield "a shaft between two bearings has its own length; remove floating_end or second_end"
        if self.second_end is None and self.second_bearing is not None:
            yield 'there is no second bearing; write second_end = "bed.bearing_2" too'
        if self.coupling is not None and self.lead is None:
            yield 'a coupling deflects along the thread only; write lead = "10 mm" too'


class CarriagesTable(types.StrictTable):
    """Carriages on parallel rails."""

    middle: types.Position
    """centre of all carriages"""
    along: types.Length = 0.0
    """distance between neighbours on a rail, along the joint's axis"""
    across: types.Length = 0.0
    """distance between rails, square to axis and normal; `{rail}` in texts is the rail's number"""
    rails: types.Count = 2
    """number of rails, counted from the positive side to the negative"""
    per_rail: types.Count = 2
    """carriages on each rail, counted from the positive end of the axis to the negative"""


class _LayerTable(types.StrictTable):
    """A contact layer between the faces of a bolted or glued joint: stiffness per area."""

    normal: types.PositiveStiffnessPerArea
    """stiffness per area across the faces"""
    shear: types.PositiveStiffnessPerArea
    """stiffness per area along the faces"""
    covers: types.NotNegativeShare = 1.0
    """length and width of the area that carries, as a share of those of the patches, about their centre"""

    def _faults(self) -> Iterator[str]:
        if self.covers == 0.0:
            yield "`covers` is zero, so nothing carries; write for example covers = 0.8"


class JointTable(types.StrictTable):
    """A joint between two interfaces, or an interface and ground; which stiffness keys it takes
    depends on its kind.
    """

    origin: Annotated[types.Text | None, Field(alias="from")] = None
    """an element of the [catalogue](catalogue.md): `from = "catalogue:guide_35"` gives kind, stiffness and damping; own keys override its
    values"""
    between: Annotated[list[types.End], Field(min_length=2, max_length=2)]
    """its two ends"""
    kind: Literal[
        "rigid",
        "spring",
        "linear_guide",
        "ball_screw",
        "bolted",
        "bearing",
        "mount",
        "revolute",
        "universal",
        "spherical",
        "prismatic",
    ]
    """kind of joint, see the table of kinds below; not needed with `from`, which brings it"""
    axis: types.Direction | None = None
    """x axis of the joint, its direction of motion; z axis of `bolted` and `mount`; default: x, or z of these two, where the kind does not
    need it"""
    normal: types.Direction | None = None
    """z axis of the joint, square to `axis`; second axis of `universal`; default: a direction square to `axis`"""
    at: types.Position | None = None
    """point where it acts, in the machine frame, all axes at zero; default: centre of its first interface"""
    places: list[types.Position] | dict[types.Name, types.Position] | None = None
    """in place of `at`: one joint at each, `NAME_1`, `NAME_2`, ... of a list, `NAME_left` of a table; `{n}` in texts is the number or
    name"""
    carriages: CarriagesTable | None = None
    """in place of `at`: a `linear_guide` at each place of carriages on parallel rails"""
    each: types.Exceptions = {}
    """what is different at single places: `each.2 = { "stiffness.normal" = "40 N/um" }`"""
    length: types.PositiveLength | None = None
    """length of the carriage (or nut) on a rail, centred at `at`; required on rails"""
    screw: ScrewTable | None = None
    """shaft of a ball screw: its stiffness depends on the distance of the nut (first end) from the fixed bearing (second end); default:
    none, its stiffness does not depend on the position"""
    stiffness: dict[types.Name, types.JointStiffness] = {}
    """stiffness of its directions, keys by kind, see below; `"rigid"` constrains a direction; default: directions without a key are free"""
    stiffness_per_area: _LayerTable | None = None
    """in place of `stiffness` of a `bolted` joint: a contact layer over the area of two flexible interfaces, whose faces may deform against
    each other"""
    damping: dict[types.Name, types.JointDamping] = {}
    """viscous damping of its directions, the same keys; used with the effect `damping`"""
    loss_factor: types.LossFactor = 0.0
    """structural damping as a share of its stiffness; used with the effect `damping`"""
    errors: RailErrorsTable | None = None
    """errors of the rail or screw it slides along, see [geometric errors](geometric_errors.md); used with the effect `guide_errors`"""
    allow_negative: types.Flag = False
    """accept a negative stiffness or damping"""
    soft: types.Flag = False
    """accept that it deflects by more than a millimetre under the weight it carries, as air springs and rubber mounts do"""


MOST_MASSES = 200


class ChainTable(types.StrictTable):
    """Point masses in a row that move along one direction, each on a spring to the one before.

    The mass `NAME_1` is the first, `NAME_spring_1` the spring before it.
    """

    origin: Annotated[types.End, Field(alias="from")]
    """where the first spring begins: `ground` or `component.interface`"""
    to: types.End | None = None
    """where the last spring ends, behind the last mass; default: the chain ends with a mass"""
    axis: types.Direction
    """direction in which the masses move"""
    at: types.Position | None = None
    """position of the masses in the machine frame; required where the chain is attached to a component"""
    masses: Annotated[list[types.PositiveMass], Field(min_length=1, max_length=MOST_MASSES)]
    """masses of `NAME_1`, `NAME_2`, ...; each is a component with the interface `center`"""
    stiffness: Annotated[
        list[types.PositiveStiffness], Field(min_length=1, max_length=MOST_MASSES + 1)
    ]
    """stiffness of the spring before each mass, and of the one to the other end: the joints `NAME_spring_1`, ..."""
    damping: list[types.NotNegativeDamping] = []
    """viscous damping of each spring; used with the effect `damping`"""
    loss_factor: types.LossFactor = 0.0
    """structural damping of every spring; used with the effect `damping`"""

    def _faults(self) -> Iterator[str]:
        springs = len(self.masses) + (self.to is not None)
        where = "one before each mass" + (" and one to the other end" if self.to else "")
        for name, values in (("stiffness", self.stiffness), ("damping", self.damping)):
            if len(values) != springs and (values or name == "stiffness"):
                yield f"has {len(values)} entries of {name} for {springs} springs: {where}"
        ends = [end for end in (self.origin, self.to) if end is not None]
        if self.at is None and any(end.component is not None for end in ends):
            yield 'begins or ends at a component; write where its masses are: at = ["0 mm", "0 mm", "250 mm"]'

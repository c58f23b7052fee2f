"""The Exechon tripod with its two-axis wrist, as a mechanism: two UPR legs on a common first axis and one SPR leg.

Base frame: y along the common first axis of legs 1 and 2, x towards leg 3, z towards the platform. Platform frame: x along the last
revolutes of legs 1 and 2, y along the last revolute of leg 3, z towards the tool. Architecture and symbols: Zoppi, Zlatanov and
Molfino (2010), Kinematics analysis of the Exechon tripod, DETC2010-28668, whose legs A, C, B are legs 1, 2, 3 here. With lumped
compliances between leg tip and platform joint it is the model of Bonnemains, Chanal, Bouzgarrou and Ray (2010), eqs. 4 to 6.
"""

from dataclasses import dataclass

from headstock.geometry.mechanisms.mechanism import Alignment, AxisName, Balance, ChainItem, Mark, Mechanism, Meeting, shift, turn

LEGS = ("leg_1", "leg_2", "leg_3")
LENGTHS = ("q1", "q2", "q3")
WRIST = ("g4", "g5")
COMPLIANCES = ("d11", "d12", "d21", "d22", "d31", "d32")


@dataclass(frozen=True)
class ExechonDimensions:
    """Lengths of an Exechon [m].

    Attributes:
        base: Places of the legs' base joints: y of legs 1 and 2 on the common axis, x of leg 3.
        platform: Places of the platform joints: y of legs 1 and 2, x of leg 3.
        universal_offsets: Distance between the two axes of the universal joint of legs 1 and 2, signed by the way it is built.
        platform_heights: z of the platform joints of legs 1 and 2.
        wrist: x and z of the wrist centre in the platform frame.
        tool_length: From the wrist centre to the tool point along the spindle.
    """

    base: tuple[float, float, float]
    platform: tuple[float, float, float]
    universal_offsets: tuple[float, float] = (0.0, 0.0)
    platform_heights: tuple[float, float] = (0.0, 0.0)
    wrist: tuple[float, float] = (0.0, 0.0)
    tool_length: float = 0.0


def exechon_mechanism(dimensions: ExechonDimensions) -> Mechanism:
    """The mechanism: 3 lengths and 2 wrist angles driven, 9 passive angles, 9 closures, 6 lumped compliances.

    Marks: ``leg_i`` turns with leg i and does not slide, ``tip_i`` is its end, ``joint_i`` its platform joint, ``platform``,
    ``wrist_4`` and ``wrist_5`` turn with the axes of the wrist about its centre, ``tcp``.

    Of the twelve loop equations two are redundant, and sharing the first angle of legs 1 and 2 takes one more away.
    """
    c, h = dimensions.wrist
    wrist: tuple[ChainItem, ...] = (
        shift("x", c), shift("z", h), turn("z", "g4"), Mark("wrist_4"), turn("y", "g5"), Mark("wrist_5"),
        shift("z", dimensions.tool_length), Mark("tcp"),
    )  # fmt: skip
    x3, c3 = dimensions.base[2], dimensions.platform[2]
    third: tuple[ChainItem, ...] = (
        shift("x", x3), turn("x", "a1"), turn("y", "a2"), turn("z", "a3"), Mark("leg_3"), shift("z", "q3"), Mark("tip_3"),
        shift("x", "d31"), shift("z", "d32"), Mark("joint_3"), turn("y", "ps3"), shift("x", -c3), Mark("platform_3"),
    )  # fmt: skip
    between: tuple[AxisName, ...] = ("y", "z")
    return Mechanism(
        "Exechon",
        chains=(_planar_leg(dimensions, 1, wrist), _planar_leg(dimensions, 2, ()), third),
        closures=(
            # the component along the last revolutes is an identity in the rotating plane of legs 1 and 2
            Meeting("platform", "platform_2", between, frame="plane"),
            Balance({"th1": 1.0, "ps1": 1.0, "th2": -1.0, "ps2": -1.0}),
            Meeting("platform_3", "platform"),
            Alignment("platform", "platform_3"),
        ),
        driven=(*LENGTHS, *WRIST),
        compliant=COMPLIANCES,
    )


def _planar_leg(dimensions: ExechonDimensions, leg: int, wrist: tuple[ChainItem, ...]) -> tuple[ChainItem, ...]:
    place = leg - 1
    return (
        turn("y", "phi"),
        *((Mark("plane"),) if leg == 1 else ()),
        shift("y", dimensions.base[place]),
        shift("z", dimensions.universal_offsets[place]),
        turn("x", f"th{leg}"),
        Mark(f"leg_{leg}"),
        shift("z", f"q{leg}"),
        Mark(f"tip_{leg}"),
        shift("y", f"d{leg}1"),
        shift("z", f"d{leg}2"),
        Mark(f"joint_{leg}"),
        turn("x", f"ps{leg}"),
        shift("z", -dimensions.platform_heights[place]),
        shift("y", -dimensions.platform[place]),
        Mark("platform" if leg == 1 else "platform_2"),
        *wrist,
    )

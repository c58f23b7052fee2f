"""Numbers and descriptions that Kono, Lorenzer, Weikert and Wegener print of their machine (section 4, tables 2 and 3)."""

from dataclasses import dataclass
from typing import Literal

Direction = Literal["X", "Y", "Z", "A", "B", "C"]
VARIANTS = ("R", "BE", "CE", "YE", "YCE")
# table 3, Axis Construction Kit: all natural frequencies below 300 Hz [Hz] but those of the machine on its air springs
TABLE_3: dict[str, tuple[float, ...]] = {
    "R": (146.0, 233.0, 254.0, 302.0),
    "BE": (78.6, 146.0, 239.0, 249.0, 288.0),
    "CE": (84.5, 145.0, 225.0, 236.0, 254.0, 297.0),
    "YCE": (76.9, 143.0, 150.0, 160.0, 237.0, 247.0, 272.0),
}
# which of them the authors put beside measured mode 9, the Y-translation of the sliders: a number of table 3, from 1
MODE_9 = {"R": 4, "BE": 5, "YCE": 7}
TABLE_3_FEM = (78.2, 144.0, 153.0, 172.0, 237.0, 250.0, 276.0)  # YCE with the finite element method [Hz]
# table 1
TRAVEL = 0.2  # of each axis [m]
SCREW_LEADS = {"X": 0.010, "Y": 0.010, "Z": 0.005}  # [m]
DRIVEN_MASSES = {"X": 35.0, "Y": 47.0, "Z": 4.0}  # [kg]
MEASURED_COMPLIANCE = {"x": 9.3, "y": 11.5, "z": 151.0}  # size of dz per force along each axis [um/kN]
LISTED_TO_HZ = 300.0


@dataclass(frozen=True)
class Motion:
    """Bodies that move alike; ``sense`` -1: against those of the first motion of the mode with a sense."""

    bodies: tuple[str, ...]
    direction: Direction
    sense: int = 1


@dataclass(frozen=True)
class MeasuredMode:
    """A mode of table 2.

    Attributes:
        number: In the table.
        frequency_hz: Measured [Hz].
        words: Its description, shortened.
        motions: The description as motions of bodies.
        paired: The YCE mode that the authors put beside it (from 1 in table 3), None where there is none.
    """

    number: int
    frequency_hz: float
    words: str
    motions: tuple[Motion, ...]
    paired: int | None


GANTRY = ("y_base", "y_slider", "z_slider")
SLIDERS = ("y_slider", "z_slider")
MEASURED_MODES = (
    MeasuredMode(
        1, 80.0, "columns bend: B of the gantry against B of base and X-slider",
        (Motion(GANTRY, "B"), Motion(("base", "x_slider"), "B", -1)), 1,
    ),
    MeasuredMode(2, 141.0, "C of the gantry against C of the X-slider", (Motion(GANTRY, "C"), Motion(("x_slider",), "C", -1)), 2),
    MeasuredMode(3, 154.0, "C of the gantry with C of the X-slider", (Motion(GANTRY, "C"), Motion(("x_slider",), "C")), 3),
    MeasuredMode(4, 163.0, "Y-base twists: B of Y- and Z-slider", (Motion(SLIDERS, "B"),), 4),
    MeasuredMode(
        6, 203.0, "B and A of Y- and Z-slider, X of base and X-slider",
        (Motion(SLIDERS, "B"), Motion(SLIDERS, "A"), Motion(("x_slider",), "X")), 5,
    ),
    MeasuredMode(
        8, 261.0, "A of Y- and Z-slider, Y of the X-slider against Y of the Y-base",
        (Motion(("x_slider",), "Y"), Motion(("y_base",), "Y", -1), Motion(SLIDERS, "A")), 6,
    ),
    MeasuredMode(
        9, 274.0, "A of Y- and Z-slider, Y of Y-, Z- and X-slider against Y of the Y-base",
        (Motion((*SLIDERS, "x_slider"), "Y"), Motion(("y_base",), "Y", -1), Motion(SLIDERS, "A")), 7,
    ),
)  # fmt: skip

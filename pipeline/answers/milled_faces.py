"""The profile of a milled face as a result: parameters, where the face is, and the profile itself,
thinned.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.answer import Entry
from headstock.pipeline.numbers.estimates import Estimate, scale_total
from headstock.pipeline.numbers.numbers import Key, make_key
from headstock.pipeline.storage.json_texts import check_finite
from headstock.solvers.milling.milled_faces import ProfileParameters

UM, MM = 1e6, 1e3


# profile: lowest and highest place in cells over the whole face, and its mean line; detail: a short
# piece, every sample; strongest wave: of those longer than the marks of the teeth
MILLED_KEYS = """
    face at location_error_um location_by_height[].* ra_um rz_um wt_um pt_um strongest_wave.*
    mark_at_start_um mark_at_end_um length_mm evaluated_mm[] cut_off_mm height_mm feed_per_tooth_mm
    rigid_cusp_um profile.*[] detail.*[] errors.*"""


@dataclass(frozen=True, eq=False)
class MilledFace:
    """The profile of a milled face, at the height of half the depth of cut, outward of the nominal
    face.

    Attributes:
        number: From 1 in the order of the path.
        length: [m].
        evaluated: Where the evaluation length starts and ends [m].
        cut_off: Wavelength between roughness and waviness [m].
        height: Above the lower end of the tool [m].
        per_tooth: Feed per tooth [m].
        cusp: Height of the cusps of a rigid machine [m].
        marks: Largest deviation of the mean line from the location error before and after the
            evaluation length, where the tool comes out of a corner and goes into one [m].
        by_height: Heights above the lower end of the tool and the location error there [m].
        places: ``(k,)`` cells along the face [m].
        lowest: ``(k,)`` of the profile in each cell [m].
        highest: ``(k,)`` [m].
        waviness: ``(k,)`` mean line [m].
        detail_places: ``(d,)`` of a short piece [m].
        detail: ``(d,)`` the profile there [m].
    """

    number: int
    at: str
    length: float
    evaluated: tuple[float, float]
    cut_off: float
    height: float
    per_tooth: float
    cusp: float
    parameters: ProfileParameters
    marks: tuple[float, float]
    by_height: tuple[tuple[float, float], ...]
    places: FloatArray
    lowest: FloatArray
    highest: FloatArray
    waviness: FloatArray
    detail_places: FloatArray
    detail: FloatArray

    @property
    def sizes(self) -> dict[str, float]:
        """Parameters with ±, by their names [m]."""
        found = self.parameters
        return {
            "location_error": found.location,
            "ra": found.ra,
            "rz": found.rz,
            "wt": found.wt,
            "pt": found.pt,
            "mark_at_start": self.marks[0],
            "mark_at_end": self.marks[1],
        }

    def summarise(self, errors: Mapping[Key, Estimate]) -> Entry:
        """Return it as it stands in ``summary.json``.

        Args:
            errors: ± of numbers [m].

        Raises:
            AccuracyError: A result is not a finite number.
        """
        what, found = f"profile of face {self.number}", self.parameters
        check_finite(what, np.array([found.location, found.ra, found.rz, found.wt, found.pt]))
        return {
            "face": self.number,
            "at": self.at,
            "location_error_um": UM * found.location,
            "location_by_height": [
                {"height_mm": MM * height, "location_error_um": UM * location}
                for height, location in self.by_height
            ],
            "ra_um": UM * found.ra,
            "rz_um": UM * found.rz,
            "wt_um": UM * found.wt,
            "pt_um": UM * found.pt,
            "strongest_wave": {
                "length_mm": MM * found.wavelength,
                "amplitude_um": UM * found.wave,
            },
            "mark_at_start_um": UM * self.marks[0],
            "mark_at_end_um": UM * self.marks[1],
            "length_mm": MM * self.length,
            "evaluated_mm": [MM * end for end in self.evaluated],
            "cut_off_mm": MM * self.cut_off,
            "height_mm": MM * self.height,
            "feed_per_tooth_mm": MM * self.per_tooth,
            "rigid_cusp_um": UM * self.cusp,
            "profile": {
                "at_mm": check_finite(what, MM * self.places),
                "lowest_um": check_finite(what, UM * self.lowest),
                "highest_um": check_finite(what, UM * self.highest),
                "waviness_um": check_finite(what, UM * self.waviness),
            },
            "detail": {
                "at_mm": check_finite(what, MM * self.detail_places),
                "height_um": check_finite(what, UM * self.detail),
            },
            "errors": {
                f"{name}_um": scale_total(
                    errors.get(make_key("profile", face=self.number, figure=name)), UM
                )
                for name in self.sizes
            },
        }

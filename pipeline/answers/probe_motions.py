"""Displacement and stress at probes under loads over time as results: the types, and how they read in
``summary.json`` and ``results.h5``.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypedDict

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.meshing.process.plain_hdf5 import h5py
from headstock.pipeline.answers.probes import MEGA, MICRO
from headstock.pipeline.numbers.estimates import Estimate, scale_shares, scale_total
from headstock.pipeline.numbers.numbers import Key, make_key
from headstock.solvers.stresses import STRESS_NAMES, largest_von_mises
from headstock.solvers.watched_outputs import Extreme


class ProbeMotionSummary(TypedDict):
    """The entry of a probe: its largest equivalent stress, the stress then by ``xx``, ``xy`` and so on,
    and its largest displacement, by size.
    """

    component: str
    singular: str
    peak_von_mises_mpa: float
    peak_von_mises_s: float
    peak_von_mises_error_mpa: float | None
    peak_von_mises_error_share: dict[str, float | None]
    peak_stress_mpa: dict[str, float]
    peak_displacement_um: float
    peak_displacement_s: float
    peak_displacement_error_um: float | None
    error_left_out: list[str]


@dataclass(frozen=True, eq=False)
class ProbeTrace:
    """What is tabled and drawn of a probe.

    Attributes:
        displacement: ``(n, 3)`` at the samples, machine axes [m].
        stress: ``(n, 6)`` xx yy zz xy xz yz [Pa].
    """

    name: str
    displacement: FloatArray
    stress: FloatArray

    @property
    def von_mises(self) -> FloatArray:
        """``(n,)`` [Pa]."""
        return largest_von_mises(self.stress)

    def fill(self, group: h5py.Group) -> None:
        """Write the curves."""
        group["displacement"], group["stress"] = self.displacement, self.stress


@dataclass(frozen=True, eq=False)
class ProbeMotion:
    """Response at a probe.

    Attributes:
        von_mises: The largest equivalent stress [Pa].
        stress: ``(6,)`` then [Pa].
        displacement: The largest size of the displacement [m].
        von_mises_error: Of the largest equivalent stress by the mesh around it [Pa].
        displacement_error: The same of the largest displacement [m].
        singular: What makes the stress there grow with every finer mesh; empty for nothing.
    """

    component: str
    trace: ProbeTrace
    von_mises: Extreme
    stress: FloatArray
    displacement: Extreme
    von_mises_error: Estimate
    displacement_error: Estimate
    singular: str = ""

    def thin(self, some: NDArray[np.intp]) -> "ProbeMotion":
        """With some of the samples."""
        own = self.trace
        trace = ProbeTrace(own.name, own.displacement[some], own.stress[some])
        return dataclasses.replace(self, trace=trace)

    def summarise(
        self, errors: Mapping[Key, Estimate] | None = None, **at: str
    ) -> ProbeMotionSummary:
        """Return it as it stands in ``summary.json``.

        Args:
            errors: ± of its numbers by all sources; None for what the mesh around it leaves out.
            at: Roles of their keys: feed and probe.
        """
        mises, moved = self.von_mises_error, self.displacement_error
        if errors is not None:
            mises = errors.get(make_key("peak_stress", **at), Estimate())
            moved = errors.get(make_key("peak_displacement", **at), Estimate())
        return {
            "component": self.component,
            "singular": self.singular,
            "peak_von_mises_mpa": MEGA * self.von_mises.value,
            "peak_von_mises_s": self.von_mises.time,
            "peak_von_mises_error_mpa": scale_total(mises, MEGA),
            "peak_von_mises_error_share": scale_shares(mises, MEGA),
            "peak_stress_mpa": {
                name: MEGA * float(value)
                for name, value in zip(STRESS_NAMES, self.stress, strict=True)
            },
            "peak_displacement_um": MICRO * self.displacement.value,
            "peak_displacement_s": self.displacement.time,
            "peak_displacement_error_um": scale_total(moved, MICRO),
            "error_left_out": sorted({*mises.left_out, *moved.left_out}),
        }

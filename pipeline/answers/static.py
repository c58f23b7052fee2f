"""Static compliances at points as results: the types, and how they read in both files."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Self

import numpy as np

from headstock.geometry.frames import DIRECTIONS, DOF_NAMES, FloatArray
from headstock.meshing.process.plain_hdf5 import h5py
from headstock.pipeline.answers.answer import Answer, Entry
from headstock.pipeline.numbers.estimates import (
    Estimate,
    list_left_out,
    scale_parts,
    scale_shares,
    scale_total,
)
from headstock.pipeline.numbers.numbers import Key, Number, make_key
from headstock.pipeline.storage.json_texts import check_finite, null_open

UM_PER_KN = 1e9  # m/N
N_PER_UM = 1e-6  # N/m


POINT_KEYS = """
    compliance_um_per_kN[][] compliance_6x6[][] free_motions[] budget.*.* text
    error_um_per_kN.* error_share.*.* error_parts.*.*.* error_left_out[]
    displacement[] displacements.*[]"""


@dataclass(frozen=True, eq=False)
class PointCompliance:
    """Static compliance at a named point, tool relative to work, machine axes.

    Attributes:
        compliance: ``(6, 6)`` [m/N, 1/N, 1/(N m)], rows and columns x y z rx ry rz; NaN where a
            free motion leaves it open.
        budget: Direction x, y, z to share of the compliance per component or joint; shares sum to
            1.
        text: What it says about the weak link.
        displacement: ``(6,)`` motion under the scene's static loads [m, rad], NaN where a free
            motion leaves it open; None without loads.
        free_motions: Motions of the machine that nothing holds.
        displacements: Load, ``gravity`` and ``guide_errors`` among them, to its part ``(6,)`` of
            the displacement.
        turns: Its rotations are known; those of a sensor are NaN.
    """

    compliance: FloatArray
    budget: dict[str, dict[str, float]]
    text: str = ""
    displacement: FloatArray | None = None
    free_motions: tuple[str, ...] = ()
    displacements: dict[str, FloatArray] = field(default_factory=dict)
    turns: bool = True

    @property
    def is_partial(self) -> bool:
        """Some of it is not known."""
        return bool(self.free_motions) or not self.turns


@dataclass(frozen=True, eq=False)
class StaticAnswer(Answer):
    """Static compliance in one pose."""

    pose: str
    points: dict[str, PointCompliance]
    units: ClassVar[dict[str, str]] = {
        r"static/.*/compliance": "SI: m and rad per N and N m",
        r"static/.*/displacements?(/.*)?": "SI: m, m, m, rad, rad, rad",
    }
    entry: ClassVar[str] = "static"
    keys: ClassVar[str] = f"""static.*({POINT_KEYS}) static_poses.*.*({POINT_KEYS})"""

    def list_numbers(self) -> Iterator[Number]:
        """Yield compliances in and across x, y, z, and displacements under the scene's loads."""
        for name, point in self.points.items():
            at = {"pose": self.pose, "point": name}
            for row, output in enumerate(DIRECTIONS):
                for column, given in enumerate(DIRECTIONS):
                    direction = output if row == column else output + given
                    key = make_key("compliance", direction=direction, **at)
                    value = float(point.compliance[row, column])
                    yield Number(key, value, "m/N", self.errors.get(key))
            moved = {} if point.displacement is None else {"": point.displacement}
            for load, values in (moved | point.displacements).items():
                kind, own = ("load_displacement", {"load": load}) if load else ("displacement", {})
                for direction, value in zip(DOF_NAMES, values, strict=True):
                    unit = "rad" if direction.startswith("r") else "m"
                    key = make_key(kind, direction=direction, **at, **own)
                    yield Number(key, float(value), unit)

    def summarise(self) -> dict[str, Entry]:
        """Its points as they stand in ``summary.json``.

        Raises:
            AccuracyError: A compliance is not a number although no motion is free.
        """
        return {
            name: _summarise_point(name, point, self.list_errors(name))
            for name, point in self.points.items()
        }

    @classmethod
    def gather(cls, answers: Sequence[Self]) -> dict[str, object]:
        """Return the points of the first pose, and by pose where there are several."""
        found = {answer.pose: answer.summarise() for answer in answers}
        several = {"static_poses": found} if len(found) > 1 else {}
        return {"static": next(iter(found.values()), {}), **several}

    def list_errors(self, point: str) -> dict[str, Estimate]:
        """Return direction to ± of the compliance of a point [m/N]."""
        return {
            direction: self.errors[key]
            for direction in DIRECTIONS
            if (key := compliance_key(self.pose, point, direction)) in self.errors
        }

    def fill(self, file: "h5py.File") -> None:
        """Write compliances and displacements, NaN for what free motions leave open."""
        for name, point in self.points.items():
            group = file.create_group(f"static/{self.pose}/{name}")
            for what, values in (
                ("compliance", point.compliance),
                ("displacement", point.displacement),
            ):
                if values is not None:
                    check_finite(
                        f"static {what} at {name}",
                        values[~np.isnan(values)] if point.is_partial else values.ravel(),
                    )
                    group[what] = values
            for load, values in point.displacements.items():
                group[f"displacements/{load}"] = values


def compliance_key(pose: str, point: str, direction: str) -> Key:
    """Return the key of a compliance."""
    return make_key("compliance", pose=pose, point=point, direction=direction)


def _summarise_point(name: str, point: PointCompliance, errors: dict[str, Estimate]) -> Entry:
    what, free = f"static compliance at {name}", point.is_partial
    summary: Entry = {
        "compliance_um_per_kN": null_open(what, point.compliance[:3, :3] * UM_PER_KN, free=free),
        "compliance_6x6": null_open(what, point.compliance, free=free),
        "free_motions": list(point.free_motions),
        "budget": {
            direction: dict(
                zip(shares, check_finite(f"budget at {name}", list(shares.values())), strict=True)
            )
            for direction, shares in point.budget.items()
        },
        "text": point.text,
        "error_um_per_kN": {
            direction: scale_total(error, UM_PER_KN) for direction, error in errors.items()
        },
        "error_share": {
            direction: scale_shares(error, UM_PER_KN) for direction, error in errors.items()
        },
        "error_parts": {
            direction: scale_parts(error, UM_PER_KN) for direction, error in errors.items()
        },
        "error_left_out": list_left_out(errors.values()),
    }
    if point.displacement is not None:
        what = f"displacement of {name} under the static loads"
        summary["displacement"] = null_open(what, point.displacement[None], free=free)[0]
        summary["displacements"] = {
            load: null_open(what, moved[None], free=free)[0]
            for load, moved in point.displacements.items()
        }
    return summary

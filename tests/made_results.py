"""Results made by hand, for tests of what is shown of them."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from headstock.geometry.machine.machine import Pose
from headstock.pipeline.answers.answer import Answer
from headstock.pipeline.answers.modal import PoseModes
from headstock.pipeline.numbers.estimates import Estimate
from headstock.pipeline.numbers.numbers import make_key
from headstock.pipeline.results.results import Results


def make_results(*answers: Answer, **fields: Any) -> Results:
    """Return results of a run of nothing but some answers."""
    empty: dict[str, Any] = {"stages": (), "components": {}, "joint_springs": {}}
    return Results(**{"name": "beam", "versions": {}, "answers": answers} | empty | fields)


def make_modes(
    frequencies_hz: Sequence[float],
    names: Sequence[str],
    pose: str = "left",
    errors: Mapping[tuple[str, int], Mapping[str, float | None]] | None = None,
    **fields: Any,
) -> PoseModes:
    """Return modes without shapes.

    Args:
        errors: Kind of number and mode to the shares of its ±.
    """
    count = len(frequencies_hz)
    plain: dict[str, Any] = {
        "pose": Pose(pose),
        "frequencies_hz": np.array(frequencies_hz),
        "rigid_count": 0,
        "damping_ratio": (None,) * count,
        "mode_names": tuple(names),
        "energy_share": ({},) * count,
        "kinetic_share": ({},) * count,
        "shapes": np.zeros((0, count)),
        "damped_hz": (None,) * count,
        "errors": {
            make_key(kind, pose=pose, mode=mode): Estimate(shares)
            for (kind, mode), shares in (errors or {}).items()
        },
    }
    return PoseModes(**plain | fields)

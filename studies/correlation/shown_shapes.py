"""Measured and computed shapes side by side as the viewer draws them: the machine twice, the measured one
moving as its channels say, expanded to all of its surface.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from headstock.geometry.frames import FloatArray, Frame
from headstock.geometry.parts.skins import Skin
from headstock.pipeline.results.views import MachineView, PoseView, ShiftArray
from headstock.pipeline.stages.run_state import PoseModel
from headstock.solvers.pairing.mode_pairing import Field
from headstock.solvers.pairing.shape_agreement import fit_scale

MEASURED = "measured"
GAP = 0.35  # between both machines, of the width


def find_factor(shapes: Field, references: Field) -> Field:
    """Return the factor ``(k,)`` that gives shapes ``(c, k)`` the size and phase of references; where a
    reference rests, the phase of their largest real part.
    """
    factor = fit_scale(shapes, references)
    alone = np.exp(-0.5j * np.angle(np.sum(shapes * shapes, axis=0)))
    return np.where(np.abs(factor) > 0.0, factor, alone)


def view_side_by_side(
    machine: PoseModel, skins: Mapping[str, Skin], measured: FloatArray, computed: FloatArray
) -> MachineView:
    """Return two machines in one pose whose shapes are those of the pairs.

    Args:
        skins: Surface of each component in its frame.
        measured: ``(n_all, k)`` expanded motions of superelement dofs; zero where nothing was measured.
        computed: ``(n_all, k)`` of the same modes; zero where the model has none.
    """
    pose = machine.view()
    aside = _step_aside(skins, pose.placements)
    twins = {f"{name} ({MEASURED})": name for name in skins}
    placements = dict(pose.placements) | {
        twin: dataclasses.replace(
            pose.placements[name], origin=pose.placements[name].origin + aside
        )
        for twin, name in twins.items()
    }
    shifts: dict[str, ShiftArray] = machine.shift_skins(dict(skins), computed)
    moved = machine.shift_skins(dict(skins), measured)
    return MachineView(
        skins={**skins, **{twin: skins[name] for twin, name in twins.items()}},
        poses={
            machine.pose.name: PoseView(
                placements,
                pose.joints,
                pose.points,
                shifts={**shifts, **{twin: moved[name] for twin, name in twins.items()}},
            )
        },
    )


def _step_aside(skins: Mapping[str, Skin], placements: Mapping[str, Frame]) -> FloatArray:
    """Return how far the second machine stands from the first ``(3,)``: along the shorter of its
    horizontal sides.
    """
    corners: Sequence[FloatArray] = [
        skin.points @ placements[name].rotation.T + placements[name].origin
        for name, skin in skins.items()
    ]
    widths = np.ptp(np.vstack(corners), axis=0)
    axis = int(np.argmin(widths[:2]))
    # a thin machine would hide behind itself
    aside = np.zeros(3)
    aside[axis] = (1.0 + GAP) * max(widths[axis], GAP * widths.max())
    return aside

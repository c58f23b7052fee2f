"""A machine that cuts what its own tooth left before: the delay differential equation
of milling, integrated in time.

The chip under a tooth is as thick as the tool's feed and its motion since an earlier tooth passed
there; the thinnest over several teeth counts, because a tooth that jumps out leaves the wave of the
one before it (Tlusty and Ismail 1981). A tooth out of the part cuts nothing, so an unstable cut
grows to a limit cycle and not without bound. Radial engagement stays as it is without vibration.
"""

from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.milling.forces import (
    MillingCut,
    engaged,
    push_tool,
    radius_differences,
    tooth_angles,
)
from headstock.solvers.motion.alpha import (
    AlphaSteps,
    CompliantHistory,
    LinearMotion,
    chunk_slices,
)

WAVES = 3  # teeth that are looked back
PASSES = 2


@dataclass(frozen=True, eq=False)
class _CuttingPhase:
    """What cuts at one angle of the spindle, ``k`` pieces of teeth, axes along the travel, away
    from the part, up.

    Attributes:
        normals: ``(2, k)`` direction of each chip's thickness.
        chip: ``(3, k)`` force on the tool per thickness [N/m].
        edge: ``(3, k)`` force on the tool wherever it cuts [N].
        runout: ``(WAVES, k)`` thickness by runout, against each earlier tooth [m].
    """

    normals: FloatArray
    chip: FloatArray
    edge: FloatArray
    runout: FloatArray


@dataclass(frozen=True, eq=False)
class RegenerativeCut:
    """A cut along a path.

    Attributes:
        phases: One turn of the spindle, step by step.
        delay: Steps from tooth to tooth.
        feed: ``(n,)`` feed per tooth [m].
        share: ``(n,)`` 0 where the tool is out of the part, 1 where it is in.
        frame: ``(n, 3, 3)`` rows: along the travel, away from the part, up, in the ground frame of
            the chains.
    """

    phases: tuple[_CuttingPhase, ...]
    delay: int
    feed: FloatArray
    share: FloatArray
    frame: FloatArray


def cutting_phases(cut: MillingCut, steps_per_turn: int) -> tuple[_CuttingPhase, ...]:
    """The pieces of teeth in the cut over one turn.

    Raises:
        ModelError: A tooth period is no whole number of steps.
    """
    if steps_per_turn % cut.mill.teeth:
        raise ModelError(
            f"regeneration needs a whole number of steps from tooth to tooth; {steps_per_turn} steps per turn are no multiple of"
            f" {cut.mill.teeth} teeth"
        )
    turn = 2.0 * np.pi / cut.spindle
    theta, lag = tooth_angles(cut, np.arange(steps_per_turn) * turn / steps_per_turn)
    runout = np.array([radius_differences(cut.mill, lag, wave) for wave in range(1, WAVES + 1)])
    return tuple(_phase(cut, angles, runout) for angles in theta)


def integrate_regenerative(
    motion: LinearMotion, load: FloatArray, cut: RegenerativeCut
) -> tuple[CompliantHistory, FloatArray]:
    """Generalised-α steps of the linear model with the chip of each instant, from static rest.

    Args:
        load: ``(n, c)`` all other loads.

    Returns:
        The motion and the ``(n, 3)`` force on the tool [N], axes of the motion.
    """
    times, steps = motion.times, AlphaSteps(motion)
    state = steps.rest(load[0])
    history, force = np.empty((len(times), 3, load.shape[1])), np.zeros((len(times), 3))
    positions = np.zeros((len(times), 3))
    rest = np.zeros((len(times), 3)) if motion.rest is None else motion.rest
    looks = cut.delay * np.arange(1, WAVES + 1)
    for part in chunk_slices(len(times)):
        tool = motion.between(motion.tool, part)
        flexibility = (
            None if motion.flexibility is None else motion.between(motion.flexibility, part)
        )
        for row, n in enumerate(range(part.start, part.stop)):
            if n > 0:
                if cut.share[n] > 0.0:
                    # the chip is seen where the tool would be with the acceleration of the step
                    # before, so that its force and friction are solved for together
                    ahead = tool[row] @ steps.predict(state)
                    moved = ahead + rest[n] - positions[np.maximum(n - looks, 0)]
                    if flexibility is None:
                        force[n] = _cut_force(cut, n, moved)
                    else:
                        # what gives way at once depends on the force itself: its change falls by
                        # flexibility times cutting stiffness, some hundredths, with every pass
                        force[n] = force[n - 1]
                        for _ in range(PASSES):
                            force[n] = _cut_force(cut, n, moved + flexibility[row] @ force[n])
                state = steps.advance(n, state, load[n] + force[n] @ tool[row])
            history[n] = state[:3]
            positions[n] = tool[row] @ state[0] + rest[n]
            if flexibility is not None:
                positions[n] += flexibility[row] @ force[n]
    return CompliantHistory(history[:, 0], history[:, 1], history[:, 2]), force


def _cut_force(cut: RegenerativeCut, step: int, moved: FloatArray) -> FloatArray:
    """``(3,)`` force in the axes of the motion after motions ``(WAVES, 3)`` of the tool
    since the last teeth.
    """
    phase, frame = cut.phases[step % len(cut.phases)], cut.frame[step]
    fed = moved @ frame[:2].T
    fed[:, 0] += cut.feed[step] * np.arange(1, WAVES + 1)
    chip = (fed @ phase.normals + phase.runout).min(axis=0)
    cutting = chip > 0.0
    return cut.share[step] * ((phase.chip @ (chip * cutting) + phase.edge @ cutting) @ frame)


def _phase(cut: MillingCut, theta: FloatArray, runout: FloatArray) -> _CuttingPhase:
    teeth, slices = np.nonzero(engaged(cut, theta))
    angle = theta[teeth, slices]
    width = cut.axial_depth / cut.slices
    return _CuttingPhase(
        np.stack([np.cos(angle), np.sin(angle)]),
        width * push_tool(cut, cut.coefficients.chip, angle),
        width * push_tool(cut, cut.coefficients.edge, angle),
        runout[:, teeth],
    )

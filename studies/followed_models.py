"""Numbers of a machine in another model of it: natural modes by their shapes, frequency responses line
by line.
"""

from dataclasses import dataclass, field

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.accuracy.followed import ComparedMachine, MachineFamily, follow_numbers
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.answers.modal import PoseModes
from headstock.pipeline.numbers.numbers import Number, make_key
from headstock.pipeline.results.results import Results
from headstock.pipeline.stages.frf import prepare_response
from headstock.reduction.motions.mode_naming import name_modes
from headstock.solvers.linear.frequency_response import evaluate_frf
from headstock.studies.kind_changes import Change

# of the drive points' responses: what symmetry makes zero is left with this of an uneven mesh
NEGLIGIBLE = 1e-3
FAR = 2.0  # times its frequency from which a mode of the same shape is another one


@dataclass(frozen=True)
class FollowedModel:
    """What another model says of the modes and responses of a machine.

    Attributes:
        numbers: Frequencies under the keys of the machine as written.
        missing: Modes of the machine as written that the model lacks within an octave, each with its
            frequency.
        added: Modes of the model, below the highest of the machine as written, that this lacks.
        lines: Of each response, the line that is furthest off.
    """

    numbers: list[Number] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    added: list[str] = field(default_factory=list)
    lines: list[Change] = field(default_factory=list)


def follow_model(written: Results, family: MachineFamily, model: ComparedMachine) -> FollowedModel:
    """Return what a model says of the modes and responses of the machine as written.

    Args:
        model: The other model, of the same family.
    """
    found = FollowedModel()
    for modes in written.modal:
        _follow_modes(modes, family, model, found)
    found.lines.extend(_compare_lines(response, model) for response in written.frf.values())
    return found


def _follow_modes(
    modes: PoseModes, family: MachineFamily, model: ComparedMachine, found: FollowedModel
) -> None:
    """Add the modes of a pose to what was found."""
    pose = modes.pose.name
    followed = follow_numbers(modes, family.base, model)
    own = modes.frequencies_hz[modes.rigid_count :]
    names = modes.mode_names[modes.rigid_count :]
    for number, hz, name in zip(followed.numbers, own, names, strict=True):
        if hz / FAR < number.value < hz * FAR:
            found.numbers.append(number)
        else:
            found.missing.append(f"{name} ({hz:.4g} Hz) in pose {pose}")
    if followed.missing:
        coupled = model.at(pose).coupled
        others = model.watch(pose, modes.below + len(modes.frequencies_hz)).modes
        named = name_modes(coupled, others).names
        found.added.extend(
            f"{named[mode]} ({others.frequencies_hz[mode]:.4g} Hz) in pose {pose}"
            for mode in followed.missing
        )


def _compare_lines(response: PoseResponse, model: ComparedMachine) -> Change:
    """Return the line furthest off, over the peak of its response; what symmetry makes zero is left out."""
    curves = response.curves
    prepared = prepare_response(model.at(curves.pose))
    receptance = evaluate_frf(prepared, curves.frequencies_hz).receptance
    own, other = (np.nan_to_num(each) for each in (curves.receptance, receptance))
    peaks = np.abs(own).max(axis=0)
    counted = peaks > NEGLIGIBLE * np.sqrt(np.outer(peaks.max(axis=1), peaks.max(axis=0)))
    off: FloatArray = np.where(
        counted, np.abs(other - own) / np.where(peaks > 0.0, peaks, 1.0), 0.0
    )
    line, output, given = (int(place) for place in np.unravel_index(np.argmax(off), off.shape))
    where = (
        f"{' '.join(curves.outputs[output])} under {' '.join(curves.inputs[given])} at "
        f"{curves.frequencies_hz[line]:.4g} Hz"
    )
    without, present = (float(abs(each[line, output, given])) for each in (other, own))
    entry = list(response.list_series())[output * len(curves.inputs) + given]
    return Change(
        make_key("response_line", pose=curves.pose, line=where),
        float(off[line, output, given]),
        without,
        present,
        entry.unit,
    )

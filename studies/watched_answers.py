"""What models of one machine are compared by beside the numbers of their summaries: natural modes
by their shapes, and frequency responses line by line.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.planning.plan import Plan
from headstock.pipeline.results.results import Results
from headstock.pipeline.stages.frf import prepare_response
from headstock.pipeline.stages.machine import CoupledPose, couple_pose
from headstock.pipeline.stages.run_state import RunState
from headstock.pipeline.stages.shared_components import make_superelements
from headstock.pipeline.storage.store import Store
from headstock.reduction.estimates.model_errors import WatchedModes, compare_modes, watch_modes
from headstock.reduction.motions.body_fields import BodyPlaces, choose_places, place_motion
from headstock.reduction.motions.mode_naming import name_modes
from headstock.scene.scene import Scene
from headstock.solvers.linear.frequency_response import evaluate_frf
from headstock.solvers.mpi import MPI
from headstock.solvers.second_order import ComplexArray
from headstock.studies.answers import Change

# of the drive points' responses: what symmetry makes zero is left with this of an uneven mesh
NEGLIGIBLE = 1e-3
FAR = 2.0  # times its frequency from which a mode of the same shape is another one


@dataclass(frozen=True, eq=False)
class Watched:
    """Where models are looked at: the same for all of them.

    Attributes:
        places: By component, points that stand for its mass.
        counts: Pose to how many modes of the machine as written are judged.
        responses: Pose to the response of the machine as written, whose lines count.
    """

    places: Mapping[str, BodyPlaces]
    counts: Mapping[str, int]
    responses: Mapping[str, PoseResponse]


@dataclass(frozen=True, eq=False)
class WatchedAnswers:
    """What one model says there.

    Attributes:
        modes: Pose to its modes and their motions.
        names: Pose to a name of each of them.
        receptance: Pose to its response ``(lines, outputs, inputs)`` [m/N, ...].
    """

    modes: dict[str, WatchedModes]
    names: dict[str, tuple[str, ...]]
    receptance: dict[str, ComplexArray]


@dataclass(frozen=True)
class ShapeChanges:
    """How far modes and lines of two models are apart.

    Attributes:
        changes: The largest of the natural frequencies, and of the lines of responses.
        missing: Modes of the model as written that the other one lacks within an octave, each with
            its frequency.
        added: Modes of the other one, below the highest judged, that the one as written lacks.
    """

    changes: tuple[Change, ...] = ()
    missing: tuple[str, ...] = ()
    added: tuple[str, ...] = ()


def choose_watched(scene: Scene, plan: Plan, results: Results, store: Store) -> Watched:
    """Where all models of a scene are looked at, of the run of the scene as written.

    Args:
        scene: As written.
        plan: Its plan.
        results: Of its run.
        store: That has its components.
    """
    parts = _restore(scene, plan, store).parts
    return Watched(
        {name: choose_places(element) for name, element in parts.superelements.items()},
        {modes.pose.name: modes.below + len(modes.frequencies_hz) for modes in results.modal},
        results.frf,
    )


def watch_answers(scene: Scene, plan: Plan, watched: Watched, store: Store) -> WatchedAnswers:
    """Modes and lines of one model.

    Args:
        scene: Of the model.
        plan: Its plan.
        watched: Where it is looked at.
        store: That has its components.
    """
    parts = _restore(scene, plan, store).parts
    motions = {
        name: place_motion(element, watched.places[name].points)
        for name, element in parts.superelements.items()
    }
    found = WatchedAnswers({}, {}, {})
    for pose in dict.fromkeys((*watched.counts, *watched.responses)):
        machine: CoupledPose = couple_pose(parts, plan.poses[pose])
        if pose in watched.counts:
            modes = watch_modes(
                machine.coupled, watched.places, motions, count=watched.counts[pose]
            )
            found.modes[pose] = modes
            found.names[pose] = tuple(name_modes(machine.coupled, modes.modes).names)
        if pose in watched.responses:
            lines = watched.responses[pose].curves.frequencies_hz
            found.receptance[pose] = evaluate_frf(prepare_response(machine), lines).receptance
    return found


def _restore(scene: Scene, plan: Plan, store: Store) -> RunState:
    state = RunState(scene, plan, MPI.COMM_SELF, store)
    make_superelements(state)
    return state


def compare_watched(
    watched: Watched, written: WatchedAnswers, tried: WatchedAnswers
) -> ShapeChanges:
    """What another model changes of the modes and lines of the machine as written.

    Args:
        watched: Where both were looked at.
        written: The machine as written.
        tried: The other model of it.
    """
    frequencies: list[Change] = []
    missing: list[str] = []
    added: list[str] = []
    for pose, count in watched.counts.items():
        place = f" in pose {pose}"
        own, other = written.modes[pose], tried.modes[pose]
        compared = compare_modes(own, other, count=count)
        own_hz, other_hz = own.shapes.frequencies_hz, other.shapes.frequencies_hz
        for mode in range(min(own.shapes.rigid_count, count), count):
            partner = compared.partners[mode]
            hz = float(own_hz[mode])
            there = float(other_hz[partner]) if partner >= 0 else 0.0
            words = f"{written.names[pose][mode]} ({hz:.4g} Hz)"
            if not hz / FAR < there < hz * FAR:
                missing.append(words + place)
                frequencies.append(Change("frequencies", 1.0, words + place, None, hz))
                continue
            share = abs(there - hz) / max(there, hz)
            frequencies.append(Change("frequencies", share, words + place, there, hz))
        added += [
            f"{tried.names[pose][mode]} ({other_hz[mode]:.4g} Hz){place}"
            for mode in compared.missing
        ]
    lines = [
        _compare_lines(response, written.receptance[pose], tried.receptance[pose])
        for pose, response in watched.responses.items()
    ]
    worst = [
        max(changes, key=lambda change: change.share) for changes in (frequencies, lines) if changes
    ]
    return ShapeChanges(tuple(worst), tuple(missing), tuple(added))


def _compare_lines(response: PoseResponse, own: ComplexArray, other: ComplexArray) -> Change:
    """The line furthest off, over the peak of its response; what symmetry makes zero is left out."""
    curves = response.curves
    own, other = (np.nan_to_num(each) for each in (own, other))
    peaks = np.abs(own).max(axis=0)
    counted = peaks > NEGLIGIBLE * np.sqrt(np.outer(peaks.max(axis=1), peaks.max(axis=0)))
    off: FloatArray = np.where(
        counted, np.abs(other - own) / np.where(peaks > 0.0, peaks, 1.0), 0.0
    )
    line, output, given = (int(place) for place in np.unravel_index(np.argmax(off), off.shape))
    where = (
        f"{' '.join(curves.outputs[output])} under {' '.join(curves.inputs[given])} at "
        f"{curves.frequencies_hz[line]:.4g} Hz in pose {curves.pose}"
    )
    sizes = (float(abs(each[line, output, given])) for each in (other, own))
    return Change("lines of frequency responses", float(off[line, output, given]), where, *sizes)

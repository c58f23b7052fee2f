"""Modes and frequency responses of a machine, as a test of it would have them: a universal file (UFF)."""

import dataclasses
from pathlib import Path

import numpy as np

from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.geometry.machine.joints import JointEnd
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.answers.modal import PoseModes
from headstock.pipeline.runner import run_stages
from headstock.pipeline.stages.machine import couple_pose
from headstock.pipeline.storage.outputs import check_output, write_output
from headstock.pipeline.storage.store import Store
from headstock.reduction.coupling.channels import machine_channels
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.dof_layout import locate_interface
from headstock.scene.analyses.frf import FrfRequest
from headstock.scene.analyses.modal import ModalRequest
from headstock.scene.scene import Analyses, Scene, require_name
from headstock.scene.test_data.records import (
    MeasuredModes,
    MeasuredResponses,
    TestChannel,
    TestData,
    TestPoint,
    as_vector,
)
from headstock.scene.test_data.uff_writing import encode_uff
from headstock.solvers.errors import ModelError
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import share_from_root
from headstock.solvers.second_order import Channel

UNITS = dict(zip(DIRECTIONS, np.eye(3), strict=True))
ALIGNED = 1e-9


def export_test_data(
    scene: Scene, path: Path, *, pose: str | None, comm: MPI.Comm, store: Store | None = None
) -> str:
    """Write modes at all points, interfaces and sensors, and the responses of ``[analyses.frf]``, as a
    universal file; motions in machine axes, of points those of the tool relative to the work.

    Args:
        scene: The same on every rank.
        path: File to write, whole or not at all.
        pose: Name of a pose; default: the first.
        store: Where meshes and superelements are kept; by default the user's.

    Returns:
        What was written, in a few words; on every rank.

    Raises:
        SceneError: There is no such pose.
        ModelError: The machine is a lumped mechanism.
        HeadstockError: A computation or the file failed.
    """
    name = pose or next(iter(scene.poses))
    require_name(scene, "poses", name, scene.poses)
    check_output(path)
    requests: list[ModalRequest | FrfRequest] = [
        dataclasses.replace(scene.analyses.get(ModalRequest) or ModalRequest(), poses=(name,))
    ]
    if FrfRequest in scene.analyses:
        requests.append(dataclasses.replace(scene.analyses[FrfRequest], poses=(name,)))
    wanted = dataclasses.replace(scene, analyses=Analyses(*requests))
    state = run_stages(wanted, comm, store, with_errors=False)
    text = ""
    if state.is_root:
        if scene.is_lumped:
            raise ModelError(
                "modes are exported for machines of coupled components only, not for a lumped mechanism"
            )
        coupled = couple_pose(state.parts, state.plan.poses[name]).coupled
        points = _locate_points(coupled, scene)
        modes = next(answer for answer in state.answers if isinstance(answer, PoseModes))
        response = next((each for each in state.answers if isinstance(each, PoseResponse)), None)
        responses, skipped = _responses(coupled, scene, response)
        data = TestData(points, (), responses, _modes(coupled, scene, modes))
        write_output(path, encode_uff(data, f"{scene.name}, pose {name}"))
        pairs = 0 if responses is None else responses.values[0].size
        text = f"{path}: pose {name}, {len(points)} points, {len(modes.frequencies_hz)} modes (set 55), {pairs} responses (set 58)"
        if skipped:
            text += f"; left out, for they are no forces or motions along machine axes: {', '.join(skipped)}"
    return str(share_from_root(comm, text))


def _locate_points(coupled: CoupledMachine, scene: Scene) -> dict[str, TestPoint]:
    """Points, interfaces and sensors in the machine [m]."""
    layout, places = coupled.layout, {}
    for component, superelement in layout.superelements.items():
        for interface in superelement.interface_maps:
            end = JointEnd(component, interface)
            places[str(end)] = locate_interface(layout, end)
    for point in scene.machine.points.values():
        places[point.name] = locate_interface(layout, point.carrier, point.offset)
    for sensor in scene.machine.sensors.values():
        frame = layout.placements[sensor.component]
        places[sensor.name] = frame.origin + frame.rotation @ sensor.position
    return {name: TestPoint(name, as_vector(place)) for name, place in places.items()}


def _modes(coupled: CoupledMachine, scene: Scene, modes: PoseModes) -> MeasuredModes:
    count = len(modes.frequencies_hz)
    rows = machine_channels(coupled.layout, scene.machine, np.eye(len(modes.shapes)))
    sensors = set(scene.machine.sensors)
    channels, shapes = [], []
    for (name, direction), row in rows.items():
        if direction in UNITS and name not in sensors:
            channels.append(TestChannel(name, as_vector(UNITS[direction])))
            shapes.append(row @ modes.shapes)
    if modes.sensor_shapes is not None:
        for index, name in enumerate(modes.sensors):
            channels += [TestChannel(name, as_vector(unit)) for unit in UNITS.values()]
            shapes += list(modes.sensor_shapes[:, index].T)
    ratios = [np.nan if ratio is None else ratio for ratio in modes.damping_ratio]
    values = np.array(shapes, dtype=complex).reshape(len(channels), count)
    return MeasuredModes(
        modes.frequencies_hz, np.array(ratios), tuple(channels), values, scaled=True
    )


def _responses(
    coupled: CoupledMachine, scene: Scene, response: PoseResponse | None
) -> tuple[MeasuredResponses | None, list[str]]:
    """Responses of motions to forces along machine axes, and the channels that are neither."""
    if response is None:
        return None, []
    curves = response.curves
    sides: list[dict[int, TestChannel]] = []
    skipped: dict[str, None] = {}
    for channels in (curves.outputs, curves.inputs):
        sides.append({})
        for index, channel in enumerate(channels):
            if (unit := _axis(coupled, scene, channel)) is None:
                skipped[" ".join(channel)] = None
            else:
                sides[-1][index] = TestChannel(channel[0], as_vector(unit))
    motions, forces = sides
    if not motions or not forces:
        return None, list(skipped)
    values = np.array(curves.receptance[:, list(motions)][:, :, list(forces)], dtype=complex)
    # at 0 Hz a free body has no value
    lines = np.isfinite(values).all(axis=(1, 2))
    return (
        MeasuredResponses(
            curves.frequencies_hz[lines],
            tuple(motions.values()),
            tuple(forces.values()),
            values[lines],
        ),
        list(skipped),
    )


def _axis(coupled: CoupledMachine, scene: Scene, channel: Channel) -> FloatArray | None:
    """Direction ``(3,)`` of a channel where it is a translation along a machine axis."""
    name, direction = channel
    if direction not in UNITS:
        return None
    sensor = scene.machine.sensors.get(name)
    if sensor is None:
        return UNITS[direction]
    turned = sensor.turn_directions(coupled.layout.placements[sensor.component].rotation)
    unit = turned[list(sensor.directions).index(direction)]
    along = np.round(unit)
    return along if np.abs(unit - along).max() < ALIGNED else None

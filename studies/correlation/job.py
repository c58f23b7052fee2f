"""A test of a machine compared with its model: from the files of both to a correlation."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Sensor
from headstock.pipeline.results.views import MachineView
from headstock.pipeline.stages.run_state import Announcer, Observer
from headstock.pipeline.storage.provenance import SceneChoice
from headstock.pipeline.storage.store import Store
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import Scene, require_name
from headstock.scene.test_data.errors import MeasurementError
from headstock.scene.test_data.reading import read_test_data
from headstock.scene.test_data.records import MeasuredModes, TestData, as_vector
from headstock.solvers.mpi import MPI
from headstock.solvers.pairing.mode_pairing import Field, correlate_modes
from headstock.solvers.pairing.shape_agreement import cross_orthogonality
from headstock.solvers.pairing.shape_expansion import expand_by_modes, expand_by_stiffness
from headstock.solvers.ranks import make_on_root
from headstock.studies.correlation.base_case import (
    BaseCase,
    list_exchanges,
    match_base_modes,
    read_base_case,
)
from headstock.studies.correlation.carriers import choose_carriers, find_carriers
from headstock.studies.correlation.channel_remarks import describe_channel_faults
from headstock.studies.correlation.correlation import WITHIN, Correlation, pair_by_most
from headstock.studies.correlation.modal_fit import ModalFit, pass_modes, read_modes
from headstock.studies.correlation.model import (
    ObservedMachine,
    PreparedMachine,
    observe_machine,
    prepare_machine,
    request_modes,
)
from headstock.studies.correlation.placement import UNMOVED, place_test
from headstock.studies.correlation.responses import (
    ComparedResponses,
    compare_responses,
    spread_ratios,
)
from headstock.studies.correlation.sensor_names import find_sensor, name_sensor
from headstock.studies.correlation.sensor_shapes import list_places
from headstock.studies.correlation.shown_shapes import find_factor, view_side_by_side
from headstock.studies.correlation.target_file import (
    SENSORS_FILE,
    TARGETS_FILE,
    write_sensors,
    write_targets,
)

# of a place on a drawn surface from the mesh [m]
SLACK = 1e-3
AT = "_on_"  # between a point and the part that may carry it
NEEDED = 3  # points whose place is known turn a test into the axes of a machine
UNITS = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
type Expansion = Literal["serep", "static", "dynamic"]


@dataclass(frozen=True)
class CorrelationJob:
    """What is compared.

    Attributes:
        test: File of the test.
        pose: Pose of the scene; None for the first.
        within: Relative deviation up to which a frequency counts as met.
        like: Target file of a test before the machine was modified; None without one.
        expansion: How measured shapes are expanded for pictures.
    """

    scene: SceneChoice
    test: Path
    pose: str | None = None
    within: float = WITHIN
    expansion: Expansion = "serep"
    like: Path | None = None


@dataclass(frozen=True, eq=False)
class _Test:
    """A test with its modes, from the file or fitted to its responses.

    Attributes:
        fit: Modes of the test.
    """

    data: TestData
    fit: ModalFit

    @property
    def modes(self) -> MeasuredModes:
        """Poles and shapes."""
        return self.fit.modes

    @property
    def range_hz(self) -> tuple[float, float]:
        """Frequencies between which it looked: its lines, else its modes [Hz]."""
        modes, responses = self.modes.frequencies_hz, self.data.responses
        lines = modes if responses is None else responses.frequencies_hz
        return float(lines.min()), float(max(lines.max(), modes.max()))


@dataclass(frozen=True, eq=False)
class _LoadedCorrelation:
    """A job whose files are read and checked."""

    job: CorrelationJob
    test: _Test
    scene: Scene
    base: BaseCase | None


def load_correlation(job: CorrelationJob) -> _LoadedCorrelation:
    """Read and check the files of a job.

    Raises:
        SceneError: The scene has problems.
        MeasurementError: The test file has.
    """
    test = _read_test(job.test)
    base = None if job.like is None else read_base_case(job.like)
    return _LoadedCorrelation(job, test, _load_scene(job, test), base)


def run_correlation(
    loaded: _LoadedCorrelation,
    store: Store,
    comm: MPI.Comm,
    *,
    announce: Announcer = lambda stage: None,
    observer: Observer = lambda record: None,
) -> Correlation | None:
    """Compare a test with its model; collective.

    Args:
        loaded: The same on every rank.
        announce: Called with each stage of a component before it begins, on every rank.
        observer: Called with the record of each as it ends, on rank 0.

    Returns:
        The correlation on rank 0, None elsewhere.

    Raises:
        HeadstockError: A computation failed.
    """
    job, test, scene = loaded.job, loaded.test, loaded.scene
    pose = scene.poses[job.pose or next(iter(scene.poses))]
    bare = prepare_machine(scene, pose, comm, store, announce=announce, observer=observer)
    placed = make_on_root(comm, lambda: _place_test(test, bare))
    observed = prepare_machine(placed.scene, pose, comm, store)
    if observed is None:
        return None
    nearest = {point: several[0] for point, several in placed.sensors.items()}
    model, remarks = choose_carriers(
        observe_machine(observed, nearest, placed.rotation), test.modes, placed.sensors
    )
    placed = dataclasses.replace(placed, remarks=(*placed.remarks, *remarks))
    return _compare(loaded, placed, model)


@dataclass(frozen=True, eq=False)
class _PlacedTest:
    """Where the points of a test are on a machine.

    Attributes:
        scene: With a sensor at every point.
        sensors: Measured point to its sensor on the nearest part, and on others that touch it there.
        rotation: ``(3, 3)`` from the axes of the test to those of the machine.
        distances: Point to its distance from the surface that carries it [m].
    """

    scene: Scene
    sensors: dict[str, list[Sensor]]
    rotation: FloatArray
    distances: dict[str, float]
    remarks: tuple[str, ...] = ()


def _read_test(path: Path) -> _Test:
    """Return a test with its modes.

    Raises:
        MeasurementError: Something is wrong in the file, or there is nothing to compare.
    """
    data = read_test_data(path)
    fit = read_modes(data, path.name) if data.modes is None else pass_modes(data.modes)
    if not len(fit.modes.frequencies_hz):
        raise MeasurementError(
            f"{path.name}:1: no mode is found in its frequency responses; look at their band and noise"
        )
    return _Test(data, fit)


def _load_scene(job: CorrelationJob, test: _Test) -> Scene:
    chosen = job.scene
    scene = load_scene(chosen.path, variant=chosen.variant, overrides=chosen.overrides)
    if job.pose is not None:
        require_name(scene, "poses", job.pose, scene.poses)
    return request_modes(scene, test.range_hz[1])


def _place_test(test: _Test, bare: PreparedMachine | None) -> _PlacedTest:
    """Put a sensor at every measured point.

    Raises:
        ValueError: On another rank than 0.
    """
    if bare is None:
        raise ValueError("points are placed on rank 0")
    channels = [*test.modes.channels]
    if test.data.responses is not None:
        channels += [*test.data.responses.motions, *test.data.responses.forces]
    known = bare.scene.machine.sensors
    points = tuple(dict.fromkeys(channel.point for channel in channels))
    named = {name: one for name in points if (one := find_sensor(known, name)) is not None}
    written = {name: point for name, point in test.data.points.items() if name in points}
    if lost := [name for name in points if name not in named and name not in written]:
        raise MeasurementError(
            f"nothing says where the points {', '.join(lost[:8])} of the test lie; export points (UFF 15 or 2411), or write sensors of these"
            " names into the scene"
        )
    placement = UNMOVED
    if written and (len(named) < len(points) or len(named) >= NEEDED):
        frames = bare.machine.placements
        matches = {
            name: frames[one.component].origin + frames[one.component].rotation @ one.position
            for name, one in named.items()
        }
        placement = place_test(written, bare.skins, frames, matches)
    sensors = {name: [one] for name, one in named.items()}
    distances = {}
    taken = set(known)
    for point in points:
        if point in named:
            continue
        carriers = find_carriers(bare, placement.move(np.array(written[point].position)))
        distances[point] = carriers[0].distance
        name = name_sensor(point, taken)
        sensors[point] = [
            Sensor(
                f"{name}{AT * bool(number)}{carrier.component * bool(number)}",
                carrier.component,
                as_vector(carrier.position),
                UNITS,
                reach=SLACK + carrier.distance,
            )
            for number, carrier in enumerate(carriers)
        ]
        taken |= {sensor.name for sensor in sensors[point]}
    added = {one.name: one for several in sensors.values() for one in several}
    machine = dataclasses.replace(bare.scene.machine, sensors=known | added)
    scene = dataclasses.replace(bare.scene, machine=machine)
    return _PlacedTest(scene, sensors, placement.rotation, distances, placement.remarks)


def _compare(
    loaded: _LoadedCorrelation, placed: _PlacedTest, model: ObservedMachine
) -> Correlation:
    job, test, base = loaded.job, loaded.test, loaded.base
    measured, modes = test.modes, model.modes
    rows = model.observe(measured.channels)
    shapes = rows @ model.damped_shapes
    pairs, left_out = pair_by_most(measured, modes, shapes)
    faults = describe_channel_faults(measured.shapes, shapes, measured.channels)
    found = Correlation(
        scene=model.prepared.scene.name,
        test=job.test.name,
        variant=job.scene.variant,
        fit=test.fit,
        computed=modes,
        shapes=shapes,
        range_hz=test.range_hz,
        within=job.within,
        pairs=pairs,
        mac=correlate_modes(measured.shapes, shapes),
        left_out=left_out,
        distances=placed.distances,
        sensors=dict(model.sensors),
        rotation=placed.rotation,
        faults=tuple(fault.text for fault in faults),
        remarks=(*test.data.remarks, *test.fit.remarks, *placed.remarks),
        warnings=model.prepared.warnings,
    )
    places, wrong = list_places(found), {row for fault in faults for row in fault.rows}
    faulty = {place[0] for row in wrong if (place := places[row]) is not None}
    found = dataclasses.replace(found, faulty=frozenset(faulty))
    system, local = model.machine.system, rows @ model.dofs
    static = expand_by_stiffness(
        measured.shapes,
        local,
        system.stiffness,
        system.mass,
        frequencies_hz=measured.frequencies_hz,
    )
    if base is not None:
        names = match_base_modes(found, base)
        since = list_exchanges(names, base)
        found = dataclasses.replace(found, names=names, since_base=since)
    files = {
        TARGETS_FILE: write_targets(found, model.prepared.scene, base),
        SENSORS_FILE: write_sensors(found, model.prepared.scene),
    }
    return dataclasses.replace(
        found,
        fit_files={name: text for name, text in files.items() if text},
        orthogonality=cross_orthogonality(static, model.coordinates, system.mass),
        responses=_compare_responses(test, found, model),
        view=_view_shapes(job, found, model, local, static),
    )


def _compare_responses(
    test: _Test, found: Correlation, model: ObservedMachine
) -> ComparedResponses | None:
    responses = test.data.responses
    if responses is None:
        return None
    return compare_responses(
        model.machine,
        responses,
        motions=model.observe(responses.motions) @ model.dofs,
        forces=model.observe(responses.forces) @ model.dofs,
        ratios=spread_ratios(
            [(pair.first, pair.second) for pair in found.pairs],
            found.measured.damping,
            found.computed.rigid_count,
        ),
    )


def _view_shapes(
    job: CorrelationJob,
    found: Correlation,
    model: ObservedMachine,
    rows: FloatArray,
    static: Field,
) -> MachineView:
    """Return what the viewer shows of each row of the table.

    Args:
        rows: ``(c, n)`` of the channels per coordinate.
        static: ``(n, k)`` measured shapes, expanded by the stiffness.
    """
    measured, system = found.measured, model.machine.system
    expanded = static
    if job.expansion == "serep":
        expanded = expand_by_modes(measured.shapes, rows, model.coordinates)
    elif job.expansion == "dynamic":
        expanded = expand_by_stiffness(
            measured.shapes,
            rows,
            system.stiffness,
            system.mass,
            frequencies_hz=measured.frequencies_hz,
            dynamic=True,
        )
    first = np.zeros((len(system.mass), len(found.modes)))
    second = np.zeros_like(first)
    for column, row in enumerate(found.modes):
        if row.computed is not None:
            second[:, column] = model.coordinates[:, row.computed]
        if row.measured is not None:
            # both are as large and in phase where they were measured
            shape, seen = expanded[:, [row.measured]], rows @ second[:, [column]]
            factor = find_factor(rows @ shape, seen)
            first[:, column] = np.real(shape * factor)[:, 0]
    return view_side_by_side(
        model.machine, model.prepared.skins, model.dofs @ first, model.dofs @ second
    )

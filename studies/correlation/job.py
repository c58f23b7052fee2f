"""A test of a machine compared with its model: from the files of both to a correlation."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.geometry.machine.machine import Sensor
from headstock.pipeline.results.views import MachineView
from headstock.pipeline.stages.run_state import Announcer, Observer
from headstock.pipeline.storage.provenance import SceneChoice
from headstock.pipeline.storage.store import Store
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import Scene, require_name
from headstock.scene.test_data.errors import MeasurementError
from headstock.scene.test_data.reading import read_test_data
from headstock.scene.test_data.records import TestData, as_vector
from headstock.solvers.mpi import MPI
from headstock.solvers.pairing.mode_pairing import Field, correlate_modes
from headstock.solvers.pairing.shape_agreement import cross_orthogonality
from headstock.solvers.ranks import make_on_root
from headstock.studies.correlation.base_case import (
    BaseCase,
    list_exchanges,
    match_base_modes,
    read_base_case,
)
from headstock.studies.correlation.carriers import Carrier, choose_carriers, find_carriers
from headstock.studies.correlation.channel_remarks import describe_channel_faults
from headstock.studies.correlation.correlation import WITHIN, Correlation, pair_by_most
from headstock.studies.correlation.modal_fit import ModalFit, pass_modes, read_modes
from headstock.studies.correlation.model import (
    Expansion,
    ObservedMachine,
    PreparedMachine,
    observe_machine,
    prepare_machine,
    request_modes,
)
from headstock.studies.correlation.placement import UNMOVED, Placement, place_test
from headstock.studies.correlation.responses import compare_responses
from headstock.studies.correlation.sensors import (
    find_sensor,
    list_motions,
    locate_channels,
    name_sensor,
)
from headstock.studies.correlation.shown_shapes import find_factor, view_side_by_side
from headstock.studies.correlation.target_file import (
    TARGETS_FILE,
    write_targets,
)

# of a place on a drawn surface from the mesh [m]
SLACK = 1e-3
AT = "_on_"  # between a point and the part that may carry it
NEEDED = 3  # points whose place is known turn a test into the axes of a machine


@dataclass(frozen=True)
class CorrelationJob:
    """What is compared.

    Attributes:
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
class _LoadedCorrelation:
    """A job whose files are read and checked.

    Attributes:
        fit: Its modes, from the file or fitted to its responses.
        range_hz: Frequencies between which it looked: its lines, else its modes [Hz].
        base: Of a modified machine, the test before.
    """

    job: CorrelationJob
    data: TestData
    fit: ModalFit
    range_hz: tuple[float, float]
    scene: Scene
    base: BaseCase | None

    @property
    def points(self) -> tuple[str, ...]:
        """Names of the points that were measured or excited."""
        channels = [*self.fit.modes.channels]
        if self.data.responses is not None:
            channels += [*self.data.responses.motions, *self.data.responses.forces]
        return tuple(dict.fromkeys(channel.point for channel in channels))


def load_correlation(job: CorrelationJob) -> _LoadedCorrelation:
    """Read and check the files of a job.

    Raises:
        SceneError: The scene has problems.
        MeasurementError: Something is wrong in the test file, or there is nothing to compare.
    """
    data, name, chosen = read_test_data(job.test), job.test.name, job.scene
    fit = read_modes(data, name) if data.modes is None else pass_modes(data.modes)
    hz = fit.modes.frequencies_hz
    if not len(hz):
        raise MeasurementError(
            f"{name}:1: no mode is found in its frequency responses; look at their band and noise"
        )
    lines = hz if data.responses is None else data.responses.frequencies_hz
    base = None if job.like is None else read_base_case(job.like)
    scene = load_scene(chosen.path, variant=chosen.variant, overrides=chosen.overrides)
    if job.pose is not None:
        require_name(scene, "poses", job.pose, scene.poses)
    highest = float(max(lines.max(), hz.max()))
    scene = request_modes(scene, highest)
    return _LoadedCorrelation(job, data, fit, (float(lines.min()), highest), scene, base)


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
    scene = loaded.scene
    pose = scene.poses[loaded.job.pose or next(iter(scene.poses))]
    bare = prepare_machine(scene, pose, comm, store, announce=announce, observer=observer)
    placed = make_on_root(comm, lambda: _place_test(loaded, bare))
    observed = prepare_machine(placed.scene, pose, comm, store)
    if observed is None:
        return None
    nearest = {point: several[0] for point, several in placed.sensors.items()}
    model, remarks = choose_carriers(
        observe_machine(observed, nearest, placed.rotation), loaded.fit.modes, placed.sensors
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


def _place_test(loaded: _LoadedCorrelation, bare: PreparedMachine | None) -> _PlacedTest:
    """Put a sensor at every measured point.

    Raises:
        ValueError: On another rank than 0.
    """
    if bare is None:
        raise ValueError("points are placed on rank 0")
    points, known = loaded.points, bare.scene.machine.sensors
    named = {name: one for name in points if (one := find_sensor(known, name)) is not None}
    placement, written = _find_placement(loaded, bare, named), loaded.data.points
    carriers = {
        point: find_carriers(bare, placement.move(np.array(written[point].position)))
        for point in points
        if point not in named
    }
    sensors, taken = {name: [one] for name, one in named.items()}, set(known)
    for point, parts in carriers.items():
        sensors[point] = [*_make_sensors(name_sensor(point, taken), parts)]
        taken |= {sensor.name for sensor in sensors[point]}
    added = {one.name: one for several in sensors.values() for one in several}
    machine = dataclasses.replace(bare.scene.machine, sensors=known | added)
    scene = dataclasses.replace(bare.scene, machine=machine)
    distances = {point: parts[0].distance for point, parts in carriers.items()}
    return _PlacedTest(scene, sensors, placement.rotation, distances, placement.remarks)


def _find_placement(
    loaded: _LoadedCorrelation, bare: PreparedMachine, named: Mapping[str, Sensor]
) -> Placement:
    """Return where the points of a test stand on the machine.

    Args:
        named: Sensors of the scene that have names of points.
    """
    points, frames = loaded.points, bare.machine.placements
    written = {name: point for name, point in loaded.data.points.items() if name in points}
    if lost := [name for name in points if name not in named and name not in written]:
        raise MeasurementError(
            f"nothing says where the points {', '.join(lost[:8])} of the test lie; export points (UFF 15 or 2411), or write sensors of these"
            " names into the scene"
        )
    if not written or (len(named) == len(points) and len(named) < NEEDED):
        return UNMOVED
    matches = {
        name: frames[one.component].origin + frames[one.component].rotation @ one.position
        for name, one in named.items()
    }
    return place_test(written, bare.skins, frames, matches)


def _make_sensors(name: str, carriers: Sequence[Carrier]) -> Iterator[Sensor]:
    """Yield a sensor in three directions on each part that may carry a point, the nearest first."""
    for number, carrier in enumerate(carriers):
        yield Sensor(
            f"{name}{AT}{carrier.component}" if number else name,
            carrier.component,
            as_vector(carrier.position),
            {dof: as_vector(unit) for dof, unit in zip(DIRECTIONS, np.eye(3), strict=True)},
            reach=SLACK + carrier.distance,
        )


def _compare(
    loaded: _LoadedCorrelation, placed: _PlacedTest, model: ObservedMachine
) -> Correlation:
    job, measured, modes, base = loaded.job, loaded.fit.modes, model.modes, loaded.base
    rows = model.observe(measured.channels)
    shapes = rows @ model.damped_shapes
    pairs, left_out = pair_by_most(measured, modes, shapes)
    first, second = [pair.first for pair in pairs], [pair.second for pair in pairs]
    faults = describe_channel_faults(
        measured.shapes[:, first], shapes[:, second], measured.channels
    )
    places = locate_channels(measured.channels, model.sensors, placed.rotation)
    motions = list_motions(places, measured.shapes)
    names = () if base is None else match_base_modes(motions, base)
    wrong = {places[row] for fault in faults for row in fault.rows}
    local = rows @ model.dofs
    static = model.expand_shapes(measured, local, "static")
    responses = loaded.data.responses
    found = Correlation(
        scene=model.scene.name,
        test=job.test.name,
        variant=job.scene.variant,
        fit=loaded.fit,
        computed=modes,
        shapes=shapes,
        range_hz=loaded.range_hz,
        within=job.within,
        pairs=pairs,
        mac=correlate_modes(measured.shapes, shapes),
        left_out=left_out,
        orthogonality=cross_orthogonality(static, model.coordinates, model.machine.system.mass),
        responses=None
        if responses is None
        else compare_responses(model, responses, pairs, measured.damping),
        distances=placed.distances,
        sensors=dict(model.sensors),
        rotation=placed.rotation,
        names=names,
        since_base=() if base is None else list_exchanges(names, base),
        faulty=frozenset(place[0] for place in wrong if place is not None),
        faults=tuple(fault.text for fault in faults),
        remarks=(*loaded.data.remarks, *loaded.fit.remarks, *placed.remarks),
        warnings=model.warnings,
    )
    return dataclasses.replace(
        found,
        fit_files={TARGETS_FILE: write_targets(found, motions, model.scene, base)},
        view=_view_shapes(found, model, local, model.expand_shapes(measured, local, job.expansion)),
    )


def _view_shapes(
    found: Correlation, model: ObservedMachine, rows: FloatArray, expanded: Field
) -> MachineView:
    """Return what the viewer shows of each row of the table.

    Args:
        rows: ``(c, n)`` of the channels per coordinate.
        expanded: ``(n, k)`` measured shapes.
    """
    first = np.zeros((len(expanded), len(found.modes)))
    second = np.zeros_like(first)
    for column, row in enumerate(found.modes):
        if row.computed is not None:
            second[:, column] = model.coordinates[:, row.computed]
        if row.measured is not None:
            # both are as large and in phase where they were measured
            shape, seen = expanded[:, [row.measured]], rows @ second[:, [column]]
            factor = find_factor(rows @ shape, seen)
            first[:, column] = np.real(shape * factor)[:, 0]
    return view_side_by_side(model.machine, model.skins, model.dofs @ first, model.dofs @ second)

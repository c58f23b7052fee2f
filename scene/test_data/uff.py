"""Universal files (UFF): points, lines, frequency responses and modes of a test in SI, by pyuff."""

import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from headstock.geometry.errors import printable
from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.geometry.loading import load_library
from headstock.scene.test_data.errors import MeasurementError
from headstock.scene.test_data.records import (
    ComplexArray,
    MeasuredModes,
    MeasuredResponses,
    TestChannel,
    TestData,
    TestPoint,
    as_vector,
)
from headstock.scene.test_data.responses import Response, join_responses, read_force, read_motion
from headstock.scene.test_data.uff_sets import (
    COHERENCE,
    FREQUENCY_RESPONSE,
    KINDS,
    Qualifiers,
    UffSet,
    convert_analysis,
    read_qualifiers,
    rewrite_set,
    split_sets,
)

MISSING = (
    "universal files (UFF) are read and written by pyuff, which is not installed: ./headstock installs environment/test_data.txt"
    " where pip reaches a registry; elsewhere: pip install pyuff==2.5.8"
)
# units code of a set 164: length, force, and how many of each are one of SI
UNITS = {
    1: ("m", "N", 1.0, 1.0),
    2: ("ft", "lbf", 1 / 0.3048, 1 / 4.4482216152605),
    3: ("m", "kgf", 1.0, 1 / 9.80665),
    4: ("ft", "pdl", 1 / 0.3048, 1 / 0.138254954376),
    5: ("mm", "mN", 1e3, 1e3),
    6: ("cm", "cN", 1e2, 1e2),
    7: ("in", "lbf", 1 / 0.0254, 1 / 4.4482216152605),
    8: ("mm", "kgf", 1e3, 1 / 9.80665),
}
UNITS_TOLERANCE = 1e-3
MOST_NAMED = 8  # points in a remark
FUNCTIONS = {
    0: "general functions", 1: "time records", 2: "auto spectra", 3: "cross spectra", 5: "transmissibilities",
    9: "power spectral densities", 12: "spectra",
}  # fmt: skip
# specific data types: how often a motion is differentiated; forces
ORDERS = {8: 0, 11: 1, 12: 2}
FORCES = (9, 13)
UNKNOWN = (0, 1)
FREQUENCY = 18
ANALYSIS, QUALIFIERS = 2414, 1858
READ_FUNCTIONS = (None, FREQUENCY_RESPONSE, COHERENCE)
NORMAL_MODE, COMPLEX_MODES = 2, (3, 7)
# tens of the types of elements that are drawn
LINES, SURFACES = (1, 2), (4, 5, 6, 7, 8, 9)
type _Record = Mapping[str, Any]


class _SkippedError(Exception):
    """A function that is no frequency response, and why."""


def parse_uff(path: Path) -> TestData:
    """Read a universal file.

    Raises:
        MeasurementError: It is damaged, contradicts itself, holds nothing that is read, or pyuff is
            missing; says where.
    """
    sets = [
        (made.kind == ANALYSIS and convert_analysis(path.name, made)) or made
        for made in split_sets(path.name, path.read_bytes())
    ]
    remarks = [*_name_skipped(sets)]
    read = [made for made in sets if made.kind in KINDS]
    content = [rewrite_set(path.name, made) for made in read]
    wanted = [
        (made, text)
        for made, text in zip(read, content, strict=True)
        if made.function in READ_FUNCTIONS
    ]
    qualifiers = read_qualifiers(path.name, sets)
    file = _File(path.name, _read_by_pyuff(path.name, wanted), remarks, qualifiers)
    data = TestData(
        points=(points := file.read_points()),
        lines=tuple(file.read_lines(points)),
        responses=file.read_responses(points),
        modes=file.read_modes(),
        remarks=tuple(map(printable, remarks)),
    )
    if not data.points and data.responses is None and data.modes is None:
        listed = "; ".join(data.remarks) or "no set that is read"
        raise MeasurementError(
            f"{path.name}:1: holds no points, frequency responses or modes ({listed}); export sets 15 or 2411, 58 or 55"
        )
    return data


def _name_skipped(sets: Iterable[UffSet]) -> Iterator[str]:
    """Sets that are not read, by kind."""
    skipped: defaultdict[str, list[UffSet]] = defaultdict(list)
    for made in sets:
        if made.kind == ANALYSIS:
            skipped["sets 2414 that are no modes at nodes"].append(made)
        elif made.kind not in (*KINDS, QUALIFIERS):
            skipped[f"sets {made.kind}"].append(made)
        elif made.function not in READ_FUNCTIONS:
            number = made.function
            skipped[FUNCTIONS.get(number or 0, f"functions of type {number}")].append(made)
    for what, which in skipped.items():
        yield f"{len(which)} {what} skipped, the first in line {which[0].line}"


def _read_by_pyuff(
    name: str, sets: list[tuple[UffSet, bytes]]
) -> list[tuple[UffSet, dict[str, Any]]]:
    """Sets with what pyuff finds in them."""
    try:
        pyuff = load_library("pyuff")
    except ModuleNotFoundError as error:
        raise MeasurementError(f"{name}:1: {MISSING}") from error
    with tempfile.NamedTemporaryFile(suffix=".uff") as copy:
        copy.writelines(content for _, content in sets)
        copy.flush()
        file = pyuff.UFF(copy.name)
        kinds = [made.kind for made, _ in sets]
        if list(map(int, file.get_set_types())) != kinds:
            raise MeasurementError(
                f"{name}:1: pyuff finds other sets than the {len(kinds)} that stand between the lines -1; export binary sets as text"
            )
        records = []
        for index, (made, _) in enumerate(sets):
            try:
                records.append((made, file.read_sets(index)))
            except Exception as error:  # pyuff raises nothing more special
                raise MeasurementError(
                    f"{name}:{made.line}: {made}: pyuff cannot read it ({error}); export it again"
                ) from error
    return records


@dataclass(eq=False)
class _File:
    """Sets of a file that pyuff has read.

    Attributes:
        records: Every set with its fields.
        remarks: Assumptions, which the readers add to.
        qualifiers: Of functions, by number of their set.
        windows: Damping factors of exponential windows, and how many responses have each.
        length: One metre in the file's unit.
        force: One newton in the file's unit.
    """

    name: str
    records: list[tuple[UffSet, dict[str, Any]]]
    remarks: list[str]
    qualifiers: Mapping[int, Qualifiers] = field(default_factory=dict)
    length: float = 1.0
    force: float = 1.0
    has_units: bool = False
    systems: dict[int, tuple[FloatArray, FloatArray] | None] = field(default_factory=dict)
    windows: Counter[float] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        for _, record in self.of(151):
            program = str(record.get("program", "")).strip()
            if program:
                self.remarks.append(f"written by {program}")
        self._read_units()
        self._read_systems()

    def of(self, *kinds: int) -> list[tuple[UffSet, _Record]]:
        """Sets of some formats."""
        return [(made, record) for made, record in self.records if made.kind in kinds]

    def fail(self, made: UffSet, message: str) -> MeasurementError:
        """Return the error of a set."""
        return MeasurementError(f"{self.name}:{made.line}: {made}: {message}")

    def _read_units(self) -> None:
        found = self.of(164)
        for made, record in found:
            factors = float(record["length"]), float(record["force"])
            code = int(record["units_code"])
            known = UNITS.get(code)
            if known is not None and not np.allclose(factors, known[2:], rtol=UNITS_TOLERANCE):
                raise self.fail(
                    made,
                    f"units code {code} means {known[2]:.6g} {known[0]} to the metre and {known[3]:.6g} {known[1]} to the newton,"
                    f" its factors are {factors[0]:.6g} and {factors[1]:.6g}; correct the code or the factors",
                )
            if self.has_units and not np.allclose(factors, (self.length, self.force)):
                raise self.fail(
                    made, "units differ from those of an earlier set 164; export one system"
                )
            self.length, self.force = factors
            self.has_units = True
            length, force = known[:2] if known else ("units of its own",) * 2
            self.remarks.append(
                f"units of set 164: {factors[0]:.6g} to the metre ({length}), {factors[1]:.6g} to the newton ({force})"
            )
        if not found:
            self.remarks.append("no units (set 164): SI is assumed where an axis has no label")

    def _read_systems(self) -> None:
        for made, record in self.of(18):
            rows = zip(
                *(record[key] for key in ("cs_num", "cs_type", "ref_cs_num")),
                *(
                    np.reshape(record[key], (-1, 3)) / self.length
                    for key in ("ref_o", "x_point", "xz_point")
                ),
                strict=True,
            )
            for number, kind, reference, origin, on_x, on_xz in rows:
                x, other = on_x - origin, on_xz - origin
                y = np.cross(other, x)
                if min(np.linalg.norm(x), np.linalg.norm(y)) == 0.0:
                    raise self.fail(
                        made, f"the points of coordinate system {number:g} lie in a line"
                    )
                axes = np.stack([x, y, np.cross(x, y)], axis=1)
                usable = kind == 0 and reference in (0, number)
                axes /= np.linalg.norm(axes, axis=0)
                self.systems[int(number)] = (origin, axes) if usable else None
        for made, record in self.of(2420):
            for number, kind, matrix in zip(
                record["CS_sys_labels"], record["CS_types"], record["CS_matrices"], strict=True
            ):
                axes = np.array(matrix[:3]).T
                if np.abs(axes.T @ axes - np.eye(3)).max() > 1e-4 or np.linalg.det(axes) < 0:
                    raise self.fail(
                        made, f"the matrix of coordinate system {number} is no rotation"
                    )
                self.systems[number] = (
                    (np.array(matrix[3]) / self.length, axes) if kind == 0 else None
                )

    def _system(self, made: UffSet, number: int) -> tuple[FloatArray, FloatArray]:
        if number == 0 or number not in self.systems:
            return np.zeros(3), np.eye(3)
        system = self.systems[number]
        if system is None:
            raise self.fail(
                made,
                f"coordinate system {number} is not Cartesian, or is defined in another one; export points in Cartesian axes of the test",
            )
        return system

    def read_points(self) -> dict[str, TestPoint]:
        """Points with their axes in those of the test [m]."""
        points: dict[str, TestPoint] = {}
        undefined: Counter[int] = Counter()
        for made, record in self.of(15, 2411):
            columns = [np.asarray(record[key]) for key in ("node_nums", "def_cs", "disp_cs")]
            places = np.stack([record[axis] for axis in DIRECTIONS], axis=1) / self.length
            for label, defined, moved, place in zip(*columns, places, strict=True):
                origin, axes = self._system(made, int(defined))
                turned = self._system(made, int(moved))[1]
                undefined.update({int(defined), int(moved)} - {0, *self.systems})
                point = TestPoint(
                    str(int(label)),
                    as_vector(origin + axes @ place),
                    tuple(map(as_vector, turned)),
                )
                if points.setdefault(point.name, point).position != point.position:
                    raise self.fail(
                        made, f"point {point.name} is written twice, in two places; keep one"
                    )
        for number, count in undefined.items():
            self.remarks.append(
                f"coordinate system {number} of {count} points is not defined in the file: taken as the axes of the test"
            )
        turned_count = sum(point.axes != TestPoint("", (0, 0, 0)).axes for point in points.values())
        if turned_count:
            self.remarks.append(f"{turned_count} of {len(points)} points have axes of their own")
        return points

    def read_lines(self, points: Mapping[str, TestPoint]) -> Iterator[tuple[str, ...]]:
        """Lines of set 82, and edges of beams, triangles and quadrilaterals of set 2412."""
        strange: set[str] = set()
        for chain in (*self._traces(), *self._edges()):
            strange.update(unknown := {name for name in chain if name not in points})
            if len(chain) > 1 and not unknown:
                yield tuple(chain)
        if strange:
            self.remarks.append(
                f"lines through points that the file does not place are left out: {_list(strange)}"
            )

    def _traces(self) -> Iterator[list[str]]:
        for _, record in self.of(82):
            chain: list[str] = []
            for number in record["nodes"]:
                if number:
                    chain.append(str(int(number)))
                else:  # the pen goes up
                    yield chain
                    chain = []
            yield chain

    def _edges(self) -> Iterator[list[str]]:
        skipped: Counter[int] = Counter()
        for _, record in self.of(2412):
            for kind, elements in record.items():
                family = int(kind) // 10 if str(kind).isdecimal() else None
                if family in SURFACES or family in LINES:
                    for element in elements:
                        names = list(map(str, element["nodes_nums"]))
                        yield [*names, names[0]] if family in SURFACES else names
                elif family is not None:
                    skipped[int(kind)] += len(elements)
        for number, count in skipped.items():
            self.remarks.append(f"{count} elements of type {number} are not drawn")

    def read_responses(self, points: Mapping[str, TestPoint]) -> MeasuredResponses | None:
        """Frequency responses, as displacement over force."""
        responses: list[Response] = []
        skipped: defaultdict[str, list[str]] = defaultdict(list)
        functions = [item for item in self.of(58) if item[0].function == FREQUENCY_RESPONSE]
        coherences = {
            _pair(record): (np.asarray(record["x"]), np.asarray(record["data"]))
            for made, record in self.of(58)
            if made.function == COHERENCE
        }
        for made, record in functions:
            try:
                response = self._make_response(made, record, points)
            except _SkippedError as error:
                skipped[str(error)].append(f"set {made.number} in line {made.line}")
                continue
            lines, coherence = coherences.get(_pair(record), (np.zeros(0), None))
            if np.array_equal(lines, response.frequencies_hz):
                response = replace(response, coherence=coherence)
            responses.append(response)
        for reason, which in skipped.items():
            self.remarks.append(f"{len(which)} frequency responses skipped ({which[0]}): {reason}")
        lost = coherences.keys() - {_pair(record) for _, record in functions}
        if lost:
            self.remarks.append(f"{len(lost)} coherences skipped: of no frequency response")
        for window, count in self.windows.items():
            text = f"{count} frequency responses have an exponential window (damping factor {window:g})"
            self.remarks.append(
                f"{text}: it adds to the damping of every mode, which is not mended"
            )
        joined, remarks = join_responses(responses)
        self.remarks += remarks
        if joined is not None:
            self._name_unplaced((*joined.motions, *joined.forces), points)
        return joined

    def _name_unplaced(
        self, channels: Iterable[TestChannel], points: Mapping[str, TestPoint]
    ) -> None:
        lost = {channel.point for channel in channels if channel.point not in points}
        if points and lost:
            self.remarks.append(f"the file does not say where these points lie: {_list(lost)}")

    def _make_response(
        self, made: UffSet, record: _Record, points: Mapping[str, TestPoint]
    ) -> Response:
        """Return a function as a response.

        Raises:
            _SkippedError: It is none.
        """
        qualifiers = self.qualifiers.get(made.number, Qualifiers())
        if qualifiers.window:
            self.windows[qualifiers.window] += 1
        directions = record["rsp_dir"], record["ref_dir"]
        kind, unit = record["abscissa_spec_data_type"], record["abscissa_axis_units_lab"]
        in_hertz = kind == FREQUENCY or (kind in UNKNOWN and unit == "Hz")
        for fault, reason in (
            (qualifiers.octaves, "lines of octaves (set 1858), which are no spectrum"),
            (qualifiers.rotates, "rotations or moments (set 1858)"),
            (
                max(map(abs, directions)) > 3,
                "rotations or moments (directions 4 to 6), which are no displacement over force",
            ),
            (0 in directions, "no direction of response or reference"),
            (not in_hertz, f"the abscissa is no frequency (type {kind}, {unit!r})"),
            (not np.iscomplexobj(record["data"]), "real numbers"),
        ):
            if fault:
                raise _SkippedError(reason)
        order, factor = self._ordinate(record)
        motion, force = (
            self._channel(record[f"{end}_node"], record[f"{end}_dir"], points)
            for end in ("rsp", "ref")
        )
        where = f"{self.name}:{made.line}: {made}"
        return Response(where, motion, force, record["x"], factor * record["data"], order)

    def _ordinate(self, record: _Record) -> tuple[int, float]:
        """How often the motion is differentiated, and the factor to SI."""
        kind, below = record["ordinate_spec_data_type"], record["orddenom_spec_data_type"]
        above, under = (str(record[f"{axis}_axis_units_lab"]) for axis in ("ordinate", "orddenom"))
        if below == 0 and read_force(under) is None:
            above, _, under = above.rpartition("/")
        motion, newtons = read_motion(above), read_force(under)
        # types count, and units of set 164; labels where there are none
        if kind in ORDERS and (self.has_units or motion is None or motion[0] != ORDERS[kind]):
            motion = ORDERS[kind], 1.0 / self.length
        if below in FORCES and (self.has_units or newtons is None):
            newtons = 1.0 / self.force
        if motion is None or kind not in (*UNKNOWN, *ORDERS):
            raise _SkippedError(
                f"the ordinate is no displacement, velocity or acceleration (type {kind}, {above!r})"
            )
        if newtons is None or below not in (*UNKNOWN, *FORCES):
            raise _SkippedError(f"the denominator is no force (type {below}, {under!r})")
        return motion[0], motion[1] / newtons

    def _channel(self, node: int, direction: int, points: Mapping[str, TestPoint]) -> TestChannel:
        point = points.get(str(node), TestPoint(str(node), (0.0, 0.0, 0.0)))
        axis = np.sign(direction) * np.array(point.axes)[:, abs(direction) - 1]
        return TestChannel(point.name, as_vector(axis))

    def read_modes(self) -> MeasuredModes | None:
        """Poles and shapes of sets 55."""
        poles: list[complex] = []
        scales: list[complex] = []
        shapes: list[dict[str, ComplexArray]] = []
        skipped: Counter[str] = Counter()
        for made, record in self.of(55):
            if reason := _why_no_mode(record):
                skipped[reason] += 1
                continue
            pole, scale = self._pole(made, record)
            order = ORDERS.get(record["spec_data_type"], 0)
            shape = np.stack([record[f"r{axis}"] + 0j for axis in (1, 2, 3)], axis=1)
            shape = shape / pole**order if pole else shape
            names = [str(int(number)) for number in record["node_nums"]]
            if len(set(names)) < len(names):
                raise self.fail(made, "has a point twice; keep one")
            if pole.imag < 0.0:
                pole, scale, shape = pole.conjugate(), scale.conjugate(), shape.conj()
            poles.append(pole)
            scales.append(scale)
            shapes.append(dict(zip(names, shape, strict=True)))
        self.remarks += [f"{count} sets 55 skipped: {why}" for why, count in skipped.items()]
        return self._join_modes(np.array(poles), np.array(scales), shapes) if poles else None

    def _pole(self, made: UffSet, record: _Record) -> tuple[complex, complex]:
        """Pole [rad/s], and what divides the square of a shape; 0 where it is unknown."""
        if record["analysis_type"] == NORMAL_MODE:
            omega = 2.0 * np.pi * float(record["freq"])
            damping = float(record["modal_damp_vis"]) or 0.5 * float(record["modal_damp_his"])
            # of the shape as it is written, whatever its unit: the receptance decides
            mass = float(record["modal_m"]) * self.length / self.force
            if not (omega >= 0.0 and 0.0 <= damping < 1.0 and mass >= 0.0):
                raise self.fail(
                    made,
                    f"a mode of {record['freq']:g} Hz with damping ratio {damping:g} and modal mass {mass:g}; correct them",
                )
            return omega * (-damping + 1j * np.sqrt(1.0 - damping**2)), mass
        pole = complex(record["eig"])
        if pole.real > 0.0:
            raise self.fail(made, f"its pole {pole:g} rad/s grows; correct its sign")
        # H = phi phi^T / (a (s - p)), the record's convention has 2 i omega_d in place of a
        a = complex(record["modal_a"]) * self.length / self.force
        return pole, a / (2j * pole.imag) if pole.imag else 0.0

    def _join_modes(
        self,
        poles: Any,
        scales: Any,
        shapes: list[dict[str, ComplexArray]],
    ) -> MeasuredModes:
        order = np.argsort(np.abs(poles), kind="stable")
        names = list(dict.fromkeys(name for shape in shapes for name in shape))
        nothing = np.zeros(3)
        # (points, 3, modes): what a set leaves out is zero, as the format says
        values = np.array(
            [[shapes[mode].get(name, nothing) for mode in order] for name in names], dtype=complex
        ).transpose(0, 2, 1)
        scaled = bool((scales != 0).all())
        if scaled:
            values = values / np.sqrt(scales[order])
        measured = (values != 0).any(axis=2)
        channels = tuple(
            TestChannel(names[point], as_vector(np.eye(3)[axis]))
            for point, axis in np.argwhere(measured)
        )
        left_out = int(measured.size - measured.sum())
        if left_out:
            self.remarks.append(
                f"{left_out} directions of points are zero in all shapes: taken as not measured"
            )
        self.remarks.append("shapes are in the axes of the test, as set 55 has them")
        self.remarks.append(
            "shapes have the modal masses (or modal A) that the file writes"
            if scaled
            else "shapes have no modal scale: a modal mass (or modal A) is zero"
        )
        hz = np.abs(poles[order]) / (2.0 * np.pi)
        damping = np.divide(
            -poles[order].real, np.abs(poles[order]), out=np.zeros(len(hz)), where=hz > 0
        )
        damping[damping == 0.0] = np.nan
        return MeasuredModes(hz, damping, channels, values[measured], scaled)


def _pair(record: _Record) -> tuple[int, ...]:
    """Return the channels of a function, whatever their signs."""
    return tuple(abs(int(record[key])) for key in ("rsp_node", "rsp_dir", "ref_node", "ref_dir"))


def _why_no_mode(record: _Record) -> str:
    """Why a set 55 is no mode of vibration; empty where it is one."""
    if record["analysis_type"] not in (NORMAL_MODE, *COMPLEX_MODES):
        return f"analysis type {record['analysis_type']}"
    if record["spec_data_type"] not in (*UNKNOWN, *ORDERS) or record["data_ch"] not in (2, 3):
        return "no displacements, velocities or accelerations in x, y and z"
    return ""


def _list(names: Iterable[str]) -> str:
    ordered = sorted(names, key=lambda name: (len(name), name))
    more = f" and {len(ordered) - MOST_NAMED} more" if len(ordered) > MOST_NAMED else ""
    return ", ".join(ordered[:MOST_NAMED]) + more

"""Whether a search for an accuracy keeps what it promises on slender parts, through whose sections
single tetrahedra reach: rings, tubes and bent bars, thick and thin, all of them free. Rules of
recovery were written with twelve of them in view; eight fresh ones were drawn up later.

Beside each stands the truth of two swept grids of hexahedra with 27 nodes on the exact shape,
extrapolated from what they move by: neither tetrahedra nor an estimate of an error have a part in it.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import headstock.pipeline
from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Machine, Pose
from headstock.geometry.parts.components import Component, Material
from headstock.geometry.parts.solids import Solid, StepFile, Tube
from headstock.meshing.component_mesh import ComponentMesh, MeshQuality
from headstock.meshing.elements.quality import mesh_volume
from headstock.pipeline.storage.content_keys import code_fingerprint
from headstock.reduction.components.elastic import reduce_elastic
from headstock.reduction.requests import ReductionRequest
from headstock.scene.analyses.modal import ModalRequest
from headstock.scene.scene import AccuracyGoal, Analyses, Scene
from headstock.solvers.elastic.eigenpairs import ModeTarget
from headstock.solvers.mpi import MPI
from headstock.validation.coverage.coverage_case import (
    CoverageCase,
    CoverageSuite,
    Scratch,
    keep_measured,
    measurement_key,
    run_afresh,
)
from headstock.validation.coverage.parts import write_step
from headstock.validation.parts.structured_meshes import node_places
from headstock.validation.references.rows import ValidationRow, compare_bound, show

ASKED = 0.01
STEEL = Material("steel", 210e9, 0.3, 7850.0)
LARGEST_MEDIAN = 4.0
CLEAR = 1e-5  # true errors above which a ratio means something
# errors of their grids fall with the fourth power of the size; what they leave if they fell with the
# third is how far the truth is unknown
RATE, SLOW_RATE, FINER = 4.0, 3.0, 1.5
SURE = 0.2  # of ±: what may be unknown of the truth
ROUND = "elbow", "swan", "oval", "cone"  # kinds of solids whose section is a ring


@dataclass(frozen=True)
class _SlenderPart:
    """A part of the suite.

    Attributes:
        solid: Its shape; or of a curved solid its kind and lengths [m].
        up_to_hz: How far its frequencies are asked for.
        grid: Hexahedra of the coarser true grid: through the section, across or around it, along.
    """

    name: str
    solid: Tube | tuple[str, dict[str, float]]
    up_to_hz: float
    grid: tuple[int, int, int]

    @property
    def is_round(self) -> bool:
        """Its section is a ring."""
        return isinstance(self.solid, Tube) or self.solid[0] in ROUND


PARTS = (
    _SlenderPart("thin ring", Tube(0.24, 0.216, 0.02), 6500.0, (3, 56, 3)),
    _SlenderPart("flat ring", Tube(0.2, 0.15, 0.012), 9000.0, (4, 56, 2)),
    _SlenderPart("stout ring", Tube(0.16, 0.1, 0.04), 14000.0, (3, 32, 4)),
    _SlenderPart("thick tube", Tube(0.1, 0.05, 0.14), 22000.0, (3, 32, 8)),
    _SlenderPart("thin tube", Tube(0.09, 0.08, 0.2), 6500.0, (2, 56, 14)),
    _SlenderPart("long tube", Tube(0.06, 0.03, 0.3), 14000.0, (3, 20, 18)),
    _SlenderPart("bush", Tube(0.04, 0.008, 0.3), 14000.0, (4, 20, 20)),
    _SlenderPart(
        "bow", ("bow", {"bend": 0.12, "wide": 0.02, "high": 0.03, "bow": 0.19}), 12000.0, (4, 6, 20)
    ),
    _SlenderPart(
        "open ring",
        ("bow", {"bend": 0.08, "wide": 0.014, "high": 0.014, "bow": 0.42}),
        5500.0,
        (4, 4, 48),
    ),
    _SlenderPart(
        "bent pipe", ("elbow", {"bend": 0.12, "radius": 0.02, "bore": 0.012}), 14000.0, (3, 24, 18)
    ),
    _SlenderPart(
        "bent rod", ("elbow", {"bend": 0.1, "radius": 0.012, "bore": 0.004}), 14000.0, (3, 20, 20)
    ),
    _SlenderPart(
        "hairpin",
        ("hairpin", {"bend": 0.04, "leg": 0.06, "wide": 0.014, "high": 0.02}),
        9000.0,
        (4, 6, 36),
    ),
)
SMOKE_PARTS = (PARTS[0], PARTS[7])
# drawn up before any of them was computed; of the rules only that of a second mesh is younger
FRESH_PARTS = (
    _SlenderPart(
        "elliptical ring",
        ("oval", {"long": 0.1, "short": 0.06, "wall": 0.01, "height": 0.02}),
        6000.0,
        (4, 48, 4),
    ),
    _SlenderPart(
        "frustum",
        ("cone", {"radius": 0.05, "top": 0.04, "bore": 0.03, "height": 0.12}),
        14000.0,
        (4, 32, 10),
    ),
    _SlenderPart(
        "S-bent pipe",
        ("swan", {"bend": 0.08, "radius": 0.016, "bore": 0.011}),
        9000.0,
        (3, 20, 28),
    ),
    _SlenderPart(
        "slotted tube",
        ("bow", {"bend": 0.04, "wide": 0.006, "high": 0.1, "bow": 0.23}),
        5000.0,
        (3, 14, 36),
    ),
    _SlenderPart(
        "U-bar",
        ("hairpin", {"bend": 0.05, "leg": 0.08, "wide": 0.035, "high": 0.04}),
        9000.0,
        (5, 6, 30),
    ),
    _SlenderPart("wheel", Tube(0.3, 0.24, 0.05), 6000.0, (4, 48, 5)),
    _SlenderPart("sleeve", Tube(0.08, 0.066, 0.1), 9000.0, (3, 48, 10)),
    _SlenderPart(
        "thin bent pipe",
        ("elbow", {"bend": 0.1, "radius": 0.02, "bore": 0.016}),
        9000.0,
        (2, 28, 20),
    ),
)


@dataclass(frozen=True, eq=False)
class _SlenderTruth:
    """What is true of a part.

    Attributes:
        frequencies_hz: ``(n,)`` elastic ones.
        doubt: ``(n,)`` how well they are known [Hz].
    """

    frequencies_hz: FloatArray
    doubt: FloatArray


@dataclass(frozen=True, eq=False)
class _SearchedPart:
    """How a search ended.

    Attributes:
        met: The search says that the accuracy is kept.
        errors: ``(n,)`` true errors over the numbers.
        given: ``(n,)`` ± over the numbers; NaN where there is none.
        unsure: ``(n,)`` how well the truth is known, over the numbers.
        seconds: Processor time of all its stages.
        failure: What ended the search; empty for nothing.
    """

    name: str
    met: bool
    errors: FloatArray
    given: FloatArray
    unsure: FloatArray
    seconds: float
    failure: str = ""


def _evaluate_searches(what: str, parts: Sequence[_SearchedPart]) -> list[ValidationRow]:
    """Compare how searches ended with the truth."""
    errors, given, unsure = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("errors", "given", "unsure")
    )
    sure = unsure <= SURE * given
    furthest = max(parts, key=lambda part: part.errors.max(initial=0.0))
    short = [part.name for part in parts if not part.met]
    wrong = [part.name for part in parts if part.met and part.errors.max() > ASKED]
    return [
        compare_bound(
            f"parts that a search for {100.0 * ASKED:g} % does not reach, or calls met that are not",
            len(short) + len(wrong),
            0.0,
            f"{len(parts)} parts; {', '.join([*short, *wrong]) or 'none'}; furthest: {furthest.name},"
            f" {100.0 * furthest.errors.max(initial=0.0):.2g} %",
        ),
        *CoverageCase(CLEAR, LARGEST_MEDIAN).evaluate(
            "",
            errors[sure],
            given[sure],
            f"{sure.sum()} numbers, of {(~sure).sum()} the truth is not sure enough or ± is unknown;"
            f" {_by_part(parts)}",
        ),
        show(
            "processor time of a search, median",
            np.median([part.seconds for part in parts]),
            "s",
            ", ".join(f"{part.name} {part.seconds:.2g}" for part in parts),
        ),
    ]


def _by_part(parts: Sequence[_SearchedPart]) -> str:
    return ", ".join(
        f"{part.name} {np.mean(part.errors[sure] <= part.given[sure]):.2f}"
        for part in parts
        if (sure := part.unsure <= SURE * part.given).any()
    )


def _measure(part: _SlenderPart, scratch: Scratch) -> _SearchedPart:
    """Search a part whose truth is kept on its own, as no search changes it."""
    key = measurement_key(repr(part), Path(__file__).read_text())
    truth = keep_measured(key, _SlenderTruth, lambda: _find_truth(part))
    return _search_part(part, _make_scene(part, scratch.folder), truth)


def _make_scene(part: _SlenderPart, folder: Path) -> Scene:
    """Return a part alone, whose frequencies are asked for.

    Args:
        folder: For its STEP file, where it has one.
    """
    solid: Solid
    if isinstance(part.solid, Tube):
        solid = part.solid
    else:
        file = folder / "part.step"
        write_step(file, part.solid[0], **part.solid[1])
        solid = StepFile(file)
    machine = Machine(part.name, {"part": Component("part", solid, STEEL)}, {}, {})
    return Scene(
        part.name,
        folder / "part.toml",
        machine,
        {"reference": Pose("reference")},
        Analyses(None, ModalRequest(up_to_hz=part.up_to_hz)),
        frozenset(),
        (),
        {},
        model_errors=False,
    )


def _find_truth(part: _SlenderPart) -> _SlenderTruth:
    """Return the frequencies of a part from two swept grids."""
    coarse, fine = (
        _grid_frequencies(part, tuple(math.ceil(factor * count) for count in part.grid))
        for factor in (1.0, FINER)
    )
    count = min(len(coarse), len(fine))
    moved = coarse[:count] - fine[:count]
    left, most = (moved / (FINER**rate - 1.0) for rate in (RATE, SLOW_RATE))
    return _SlenderTruth(fine[:count] - left, np.abs(most - left))


def _grid_frequencies(part: _SlenderPart, counts: tuple[int, ...]) -> FloatArray:
    mesh = _sweep_grid(counts, functools.partial(_place_section, part.solid), part.is_round)
    body = Component("part", Tube(1.0, 0.5, 1.0), STEEL)  # its shape is that of the mesh
    target = ModeTarget(up_to_hz=1.1 * part.up_to_hz)
    request = ReductionRequest(target, recovery=False, errors=False)
    return reduce_elastic(body, mesh, comm=MPI.COMM_SELF, request=request).modal_frequencies_hz


def _place_section(solid: Tube | tuple[str, dict[str, float]], places: FloatArray) -> FloatArray:
    """Points ``(n, 3)`` of a swept solid [m].

    Args:
        places: ``(n, 3)`` through its section, across or around it, and along, 0 to 1; of a tube
            around and along.
    """
    first, second, third = places.T
    turn = 2.0 * np.pi * second
    walls = _find_walls(solid, third)
    if walls is not None:
        inner, outer, length = walls
        radii = inner + (outer - inner) * first
        return np.column_stack([radii[0] * np.cos(turn), radii[1] * np.sin(turn), length * third])
    assert not isinstance(solid, Tube)
    kind, sizes = solid
    bend, leg = sizes["bend"], sizes.get("leg", 0.0)
    if kind == "swan":
        # its second half is the first one after half a turn about where they meet
        later = third > 0.5
        around = np.where(later, 0.5 - second, second)
        bow_places = np.column_stack([first, around, 2.0 * np.minimum(third, 1.0 - third)])
        points = _place_section(("elbow", sizes), bow_places)
        points[later] = [0.0, 2.0 * bend, 0.0] + points[later] * [-1.0, -1.0, 1.0]
        return points
    if kind == "elbow":
        radius = sizes["bore"] + (sizes["radius"] - sizes["bore"]) * first
        out, up = radius * np.cos(turn), -radius * np.sin(turn)
        bow = 0.5 * np.pi * bend
    else:
        out, up = sizes["wide"] * (first - 0.5), sizes["high"] * (0.5 - second)
        bow = sizes.get("bow", np.pi * bend)
    # along straight legs on both sides of the bend, whose ends lie on edges of the grid by thirds
    reach = np.interp(third, [0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0], [-leg, 0.0, bow, bow + leg])
    if leg == 0.0:
        reach = bow * third
    angle = np.clip(reach, 0.0, bow) / bend
    straight = reach - np.clip(reach, 0.0, bow)
    radial = np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    tangent = np.column_stack([-np.sin(angle), np.cos(angle), 0.0 * angle])
    upright = np.array([0.0, 0.0, 1.0])
    return (bend + out)[:, None] * radial + straight[:, None] * tangent + up[:, None] * upright


def _find_walls(
    solid: Tube | tuple[str, dict[str, float]], along: FloatArray
) -> tuple[FloatArray, FloatArray, float] | None:
    """Inner and outer half axes, ``(2, n)`` or ``(2, 1)``, of the sections along a straight axis, and
    its length [m]; None of a bent one.
    """
    both = np.ones((2, 1))
    if isinstance(solid, Tube):
        inner, outer = (0.5 * size * both for size in (solid.inner_diameter, solid.outer_diameter))
        return inner, outer, solid.length
    kind, sizes = solid
    if kind == "cone":
        outer = (sizes["radius"] + (sizes["top"] - sizes["radius"]) * along) * both
        return sizes["bore"] * both, outer, sizes["height"]
    if kind == "oval":
        outer = np.array([[sizes["long"]], [sizes["short"]]])
        return outer - sizes["wall"], outer, sizes["height"]
    return None


def _sweep_grid(
    counts: Sequence[int], place: Callable[[FloatArray], FloatArray], closed: bool
) -> ComponentMesh:
    """Build a grid of hexahedra with 27 nodes on an exact shape.

    Args:
        counts: Hexahedra along each of the three coordinates.
        place: From ``(n, 3)`` coordinates, 0 to 1, to points [m].
        closed: The second coordinate goes round.
    """
    number = np.array(counts)
    cells = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, 3)
    nodes = 2 * cells[:, None] + np.round(2.0 * node_places("hex27")).astype(int)
    lengths = 2 * number + 1
    if closed:
        nodes[..., 1] %= 2 * number[1]
        lengths[1] -= 1
    grid = np.stack(np.meshgrid(*map(np.arange, lengths), indexing="ij"), axis=-1).reshape(-1, 3)
    points = place(grid / (2.0 * number))
    flat = np.asarray(np.ravel_multi_index(tuple(np.moveaxis(nodes, -1, 0)), tuple(lengths)))
    volume = mesh_volume(points, flat, "hex27")
    quality = MeshQuality(1.0, 0, volume, float("nan"))
    return ComponentMesh(points, flat, "hex27", straight=False, patches={}, quality=quality)


def _search_part(part: _SlenderPart, scene: Scene, truth: _SlenderTruth) -> _SearchedPart:
    """Return how far a search for an accuracy is off."""
    goal = dataclasses.replace(scene, accuracy=AccuracyGoal(ASKED))
    try:
        results = run_afresh(goal)
    except HeadstockError as error:
        nothing = np.zeros(0)
        return _SearchedPart(part.name, False, nothing, nothing, nothing, 0.0, str(error))
    (modes,) = results.modal
    values = np.asarray(modes.frequencies_hz[modes.rigid_count :])
    given = np.array(
        [
            np.nan if one.total is None else one.total
            for one in modes.list_errors()[modes.rigid_count :]
        ]
    )
    count = min(len(values), len(truth.frequencies_hz))
    values, given = values[:count], given[:count]
    return _SearchedPart(
        part.name,
        not results.failures,
        np.abs(values - truth.frequencies_hz[:count]) / values,
        given / values,
        truth.doubt[:count] / values,
        sum(record.cpu_seconds or 0.0 for record in results.stages),
    )


SUITE = CoverageSuite(
    _measure,
    _SearchedPart,
    lambda part: (repr(part), Path(__file__).read_text(), code_fingerprint(headstock.pipeline)),
    _evaluate_searches,
)

"""What results of a scene say about a beam of the paper, and their deviations from the references
along a series of models.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, cast

import numpy as np

from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Component
from headstock.geometry.parts.solids import Box
from headstock.pipeline.results.results import Results
from headstock.scene.scene import Scene
from headstock.studies.parameters.records import Measured, StudyRecord
from headstock.studies.parameters.tables import median_seconds
from headstock.validation.refinement.references import (
    FORCE,
    MOMENT,
    OFFSET,
    UM,
    Group,
    ReferenceBeam,
    reference_beam,
)
from headstock.validation.refinement.theory_shapes import (
    find_theory_shapes,
    read_shape,
    section_motions,
)

ModelKind = Literal["segmented", "tet4", "hex8", "tet10", "hex27", "wilson8"]
KINDS: tuple[ModelKind, ...] = ("segmented", "tet4", "hex8", "tet10", "hex27", "wilson8")
LINEAR: tuple[ModelKind, ...] = ("wilson8", "tet4", "hex8")
QUADRATIC: tuple[ModelKind, ...] = ("tet10", "hex27")
SAME = 1e-6
Against = Literal["analytic", "beam", "solid"]
CELL_NODES = {("tet", 1): 4, ("tet", 2): 10, ("hex", 1): 8, ("hex", 2): 27}


class _RefinementError(HeadstockError):
    """A scene is not what a published study is about."""


@dataclass(frozen=True, eq=False)
class RefinementPoint:
    """A model of a beam.

    Attributes:
        kind: Segmented bodies, or the finite elements; ``wilson8`` are the paper's own, which
            Headstock has not.
        ndof: As the paper counts: 6 per segment, 3 per node.
        values: By quantity [um, Hz]; a mode that no shape of the model resembles is missing.
        macs: Likeness of each mode to the shape it is named after.
        seconds: From the scene to the results [s]; NaN for the paper's own elements.
        cpu_seconds: Processor time of the same [s].
    """

    kind: ModelKind
    ndof: int
    group: Group
    values: dict[str, float]
    macs: dict[str, float]
    seconds: float
    cpu_seconds: float


def measure_beam(reference: str, scene: Scene, results: Results) -> Measured:
    """Return what a scene's results say about a beam, for the record of a study's point.

    Args:
        results: What its run found.

    Raises:
        LadderError: The scene is not the beam of the reference.
    """
    beam = reference_beam(reference)
    component = _check_beam(beam, scene)
    facts = results.components[component.name]
    mesh = component.mesh
    kind = (
        component.fidelity
        if component.fidelity != "elastic"
        else f"{mesh.cells}{CELL_NODES[mesh.cells, mesh.order]}"
    )
    values: dict[str, float] = {}
    macs: dict[str, float] = {}
    if results.static and beam.ends == "clamped-free":
        points = next(iter(results.static.values()))
        first = points[next(iter(scene.machine.points))]  # six loads act there
        values = cantilever_displacements(first.compliance)
    elif results.static:
        values = _fixed_beam_statics(component, scene, results)
    if results.modal:
        modal, macs = _beam_modes(beam, component, results)
        values |= modal
    return {"kind": kind, "ndof": facts.full_dofs, "values": values, "macs": macs}


def collect_points(beam: ReferenceBeam, records: Sequence[StudyRecord]) -> list[RefinementPoint]:
    """Return the models of a series from a study's records; a point with static and modal results
    is two models, a failed one is none.
    """
    found: list[RefinementPoint] = []
    for record in records:
        seconds, cpu = median_seconds(record), median_seconds(record, "cpu_seconds")
        if record.status == "failed" or seconds is None or cpu is None:
            continue
        measured = record.measured
        for group in ("static", "modal"):
            own = {
                name: value
                for name, value in measured["values"].items()
                if beam.references[name].group == group
            }
            if own:
                macs = measured["macs"] if group == "modal" else {}
                found.append(
                    RefinementPoint(
                        cast(ModelKind, measured["kind"]),
                        measured["ndof"],
                        group,
                        own,
                        macs,
                        seconds[0],
                        cpu[0],
                    )
                )
    return found


def _check_beam(beam: ReferenceBeam, scene: Scene) -> Component:
    """Find the one component of a scene, which must be the beam."""
    components = list(scene.machine.components.values())
    solid = components[0].solid
    right = (
        isinstance(solid, Box)
        and len(components) == 1
        and np.allclose(solid.size, beam.size, rtol=SAME, atol=0.0)
    )
    own, wanted = (
        dataclasses.astuple(material)[1:] for material in (components[0].material, beam.material)
    )
    if not right or not np.allclose(own, wanted, rtol=SAME, atol=0.0):
        sides = " x ".join(f"{1e3 * side:g}" for side in beam.size)
        raise _RefinementError(
            f"{scene.path} is compared with {beam.name}, which is one box of {sides} mm with E = {beam.material.youngs_modulus:g} Pa, "
            f"nu = {beam.material.poisson_ratio:g}, rho = {beam.material.density:g} kg/m^3; take those, or vary without `reference`"
        )
    return components[0]


def cantilever_displacements(compliance: FloatArray) -> dict[str, float]:
    """Displacements [um] under the paper's loads by the compliance ``(6, 6)`` of the top face [m/N,
    1/N, 1/(N m)].
    """
    c = np.abs(compliance) * UM
    half = reference_beam("kono-cantilever").size[1] / 2.0
    return {
        "dx(Fx)": FORCE * float(c[0, 0]),
        "dy(Fy)": FORCE * float(c[1, 1]),
        "dz(Fz)": FORCE * float(c[2, 2]),
        "dy(Ma)": MOMENT * float(c[1, 3]),
        "dx(Mb)": MOMENT * float(c[0, 4]),
        "dx(Mc)": MOMENT * half * float(c[5, 5]),
    }


def _fixed_beam_statics(component: Component, scene: Scene, results: Results) -> dict[str, float]:
    """Motion of the loaded patch, and of the one behind it, under the scene's force."""
    found: dict[str, float] = {}
    for name, answer in next(iter(results.static.values())).items():
        patch = component.interfaces[str(scene.machine.points[name].tool.interface)].patches[0]
        height = patch.center[2] - 0.5 * reference_beam("kono-fixed-beam").size[2]
        label = "0" if abs(height) < SAME else "100 mm" if abs(height - OFFSET) < SAME else ""
        if not label or answer.displacement is None:
            raise _RefinementError(
                f"point {name!r}: the paper's force of 1 kN along x acts at 0 or 100 mm above the middle of the front face"
            )
        shift = np.abs(answer.displacement) * UM
        back = ", back face" if patch.face == "x-" else ""
        found[f"dx(Fx), h_F = {label}{back}"] = float(shift[0])
        if label != "0" and not back:
            found[f"dz(Fx), h_F = {label}"] = float(shift[2])
    return found


def _beam_modes(
    beam: ReferenceBeam, component: Component, results: Results
) -> tuple[dict[str, float], dict[str, float]]:
    """Frequencies of the modes the paper names, found by their shapes, and how alike those are."""
    modes = results.modal[0]
    pose = results.view.poses[modes.pose.name]
    low = -0.5 * beam.size[beam.axis] if beam.axis < 2 else 0.0
    sections = section_motions(
        results.view.skins[component.name].points,
        pose.shifts[component.name] @ pose.placements[component.name].rotation,
        axis=beam.axis,
        span=(low, low + beam.size[beam.axis]),
        sides=beam.size,
    )
    names = [name for name, reference in beam.references.items() if reference.group == "modal"]
    paired = find_theory_shapes(
        sections, tuple(read_shape(name, beam.axis) for name in names), beam.ends
    )
    frequencies = {name: float(modes.frequencies_hz[mode.index]) for name, mode in paired.items()}
    return frequencies, {name: mode.mac for name, mode in paired.items()}


@dataclass(frozen=True, eq=False)
class RefinementSeries:
    """Models of some kinds by rising nDOF, static or modal.

    Attributes:
        beam: What they are models of.
    """

    beam: ReferenceBeam
    kinds: tuple[ModelKind, ...]
    group: Group
    points: tuple[RefinementPoint, ...]

    @property
    def models(self) -> str:
        """Their kinds, in short."""
        return " + ".join(self.kinds)

    @property
    def figure(self) -> int:
        """Number of the paper's figure."""
        return self.beam.figures[
            (0 if self.kinds == ("segmented",) else 1) + (0 if self.group == "static" else 2)
        ]


@dataclass(frozen=True)
class _Deviation:
    """A relative deviation of one quantity of one model [-]."""

    value: float
    quantity: str
    point: RefinementPoint

    def __str__(self) -> str:
        """As a reader takes it in: ``dy(Fy) +3.06 % at nDOF 30 (hex8)``."""
        return f"{self.quantity} {100 * self.value:+.3g} % at nDOF {self.point.ndof} ({self.point.kind})"


def pick_series(
    beam: ReferenceBeam, points: Sequence[RefinementPoint], group: Group, *kinds: ModelKind
) -> RefinementSeries:
    """Return the models of some kinds, by rising nDOF.

    Args:
        beam: What they are models of.
    """
    own = sorted(
        (point for point in points if point.group == group and point.kind in kinds),
        key=lambda point: point.ndof,
    )
    return RefinementSeries(beam, kinds, group, tuple(own))


def deviations(
    series: RefinementSeries,
    quantities: Sequence[str],
    *,
    above: float = 0.0,
    against: Against = "analytic",
) -> list[_Deviation]:
    """Return every deviation of some quantities in models of at least so many dofs.

    Args:
        series: Models by rising nDOF.
        quantities: Names of the quantities; those that a model has not are left out.
        against: Reference: the paper's analytic value, Timoshenko's, or that of converged 3D
            elasticity.

    Returns:
        Value over reference less one [-], with its quantity and model.
    """
    return [
        _Deviation(
            point.values[name] / reference_value(series.beam, name, against) - 1.0, name, point
        )
        for point in series.points
        if point.ndof >= above
        for name in quantities
        if name in point.values
    ]


def reference_value(beam: ReferenceBeam, quantity: str, against: Against) -> float:
    """Return the value that a quantity of a beam is compared with, in the unit of the quantity.

    Args:
        against: Reference: the paper's analytic value, Timoshenko's, or that of converged 3D
            elasticity.
    """
    value: float = getattr(beam.references[quantity], against)
    return value


def worst_of(found: Sequence[_Deviation]) -> _Deviation:
    """Return the largest deviation, whatever its sign."""
    return max(found, key=lambda deviation: abs(deviation.value))


def worst_by_ndof(
    series: RefinementSeries,
    quantities: Sequence[str],
    *,
    above: float = 0.0,
    against: Against = "analytic",
) -> dict[int, _Deviation]:
    """Return the largest deviation at each nDOF, by rising nDOF; models of equal nDOF count
    together.

    Args:
        series: Models by rising nDOF.
        against: Reference: the paper's analytic value, Timoshenko's, or that of converged 3D
            elasticity.
    """
    grouped: dict[int, list[_Deviation]] = {}
    for deviation in deviations(series, quantities, above=above, against=against):
        grouped.setdefault(deviation.point.ndof, []).append(deviation)
    return {ndof: worst_of(found) for ndof, found in grouped.items()}


def ndof_within(
    series: RefinementSeries,
    quantities: Sequence[str],
    limit: float,
    *,
    against: Against = "analytic",
) -> int | None:
    """Smallest nDOF from which on every deviation is within a limit; None where the largest model
    is outside.

    Args:
        series: Models by rising nDOF.
        limit: Largest relative deviation [-].
        against: Reference: the paper's analytic value, Timoshenko's, or that of converged 3D
            elasticity.
    """
    enough: int | None = None
    for ndof, worst in reversed(worst_by_ndof(series, quantities, against=against).items()):
        if abs(worst.value) > limit:
            break
        enough = ndof
    return enough


def nearest_rung(series: RefinementSeries, ndof: int, quantity: str) -> RefinementPoint | None:
    """Return the model with this quantity whose nDOF comes nearest, by ratio.

    Args:
        series: Models by rising nDOF.
        quantity: The model must have it.
    """
    own = [point for point in series.points if quantity in point.values]
    distances = [abs(math.log(point.ndof / ndof)) for point in own]
    return own[distances.index(min(distances))] if own else None

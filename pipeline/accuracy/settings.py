"""Mesh and modes of a component for a stated accuracy: the settings to start with, and
finer ones.
"""

import dataclasses
import math
from collections.abc import Container, Mapping
from dataclasses import dataclass

import numpy as np

from headstock.geometry.machine.carriages import rail_pieces
from headstock.geometry.parts.components import (
    CellShape,
    Component,
    MeshSettings,
)
from headstock.geometry.parts.mass_properties import solid_volume
from headstock.geometry.parts.plane_shapes import patch_width
from headstock.geometry.parts.size_field import SizeField
from headstock.geometry.parts.solids import (
    Box,
    MeshFile,
    ParametricSolid,
    PointMass,
    StepFile,
    SuperelementFile,
    Tube,
)
from headstock.meshing.components.meshing import automatic_size, count_hexes, grid_of
from headstock.meshing.sizing import (
    DEFAULT_CELLS,
    DETAIL_SHARE,
    SIZE_STEP,
    estimate_tets,
    largest_extent,
    thinnest_feature,
)
from headstock.pipeline.planning.analyses import EXACT_MARGIN
from headstock.reduction.components.polynomial_space import polynomial_limit
from headstock.reduction.components.rail_fits import longest_elements, merge_spans
from headstock.solvers.recovery.discretisation_error import STOUT, UNSEEN_SHARE, WIDE

# Just below the thickness: two hexes across, of which recovery finds the error of torsion (one hex
# across: a quarter of it).
START_SHARE = 0.95
# Two tets through a wall, where they are few: of single ones as thick as long recovery finds 0.6 of
# the error of shear through the wall.
TWO_THROUGH, MOST_TWO_THROUGH = 0.45, 8_000
WALL = 3.0  # least width of a wall, over its thickness: narrower parts are bars
START_ACCURACY = 0.01  # accuracy that first meshes may reach; a tighter one starts with finer ones
COARSE_ACCURACY = 0.03
FEWEST_ALONG = 3
MOST_ACROSS = 40
# of a first mesh: where thin walls ask for more, elements are wider than the walls are thick
MOST_START_HEXES, MOST_START_TETS = 1_500, 30_000
# hexes between the edges of small patches, for accuracies of one percent and more
ROUGH_ACCURACY, ROUGH_ACROSS, MOST_ROUGH_HEXES = 0.01, 2, 400
# along the longest side: for an accuracy, and for a finer one, from which a second round is needed
ROUGH_ALONG, FINE_ALONG, FINE_ACCURACY = 7, 8, 0.03
PATCHES_ADD = 2.0  # hexes that grid lines of patches may add before tetrahedra are cheaper
COARSER_PART = 2.4  # over the size of the rule, of STEP parts, which are graded later on
# a column with two rigid faces: error 0.6 % with modes up to 3 times the wanted range, 1.5 % with 2
# times (`validate reduction`)
MODE_MARGIN, MODE_ERROR, MODE_RATE = 3.0, 0.006, 2.3
REDUCTION_SHARE = 0.25  # of the accuracy, left to the modes
# convergence rates: about 2, between smooth fields (4) and the rims of rigid interfaces in blocks
# of hexes (about 1)
DEFAULT_RATE, SLOWEST_RATE, FASTEST_RATE = 2.2, 0.8, 4.0
RIM_RATE = 1.5  # below it, rims dominate the errors of even meshes
# five times the dofs: where errors fall slowly, more would overshoot
LEAST_STEP, LARGEST_STEP = 0.85, 0.6
# Tets grow from the rims of patches and of rigid interfaces. Next to a rim stresses grow without
# limit, and errors fall like the first or second power of the size there, which falls faster than
# the size elsewhere; grading makes that cheap.
LEAST_GROWTH, RIM_POWER = 0.25, 1.5
LEAST_DETAIL_RATIO = 0.1  # of the error by features left out: below it all features are meshed


@dataclass(frozen=True)
class _Grading:
    """Define elements across imprints, growth from rims, and size at the rims of rigid interfaces
    as a share of the size elsewhere.
    """

    across: int
    growth: float
    rim_share: float


# for coarse accuracies, for finer ones, and where rims make the error
COARSE_GRADING, START_GRADING = _Grading(6, 0.5, 0.3), _Grading(8, 0.45, 0.27)
FINE_GRADING = _Grading(12, 0.35, 0.2)


@dataclass(frozen=True)
class Trial:
    """Store a mesh size that was tried [m] and the largest relative error by it, as estimated and
    with its safety factor.
    """

    size: float
    error: float
    counted: float


def is_chosen(component: Component) -> bool:
    """Tell whether mesh and modes of a component are selectable."""
    return component.fidelity in ("elastic", "polynomial") and not isinstance(
        component.solid, SuperelementFile
    )


def suits_polynomials(component: Component, highest_hz: float) -> bool:
    """Tell whether polynomials are a cheap substitute for the finite elements of a component:
    tubes, whose curved walls need many, constrained at whole faces and far from ovalizing.

    Args:
        highest_hz: Highest frequency wanted [Hz]; 0 where it is unknown.
    """
    patches = [patch for item in component.interfaces.values() for patch in item.patches]
    return (
        isinstance(component.solid, Tube)
        and highest_hz < polynomial_limit(component.solid, component.material)
        and all(patch.shape == "whole" and ":" not in patch.face for patch in patches)
        and not any(item.flexible for item in component.interfaces.values())
    )


def start_component(
    component: Component,
    accuracy: float,
    modes_to_hz: float | None,
    *,
    modes: int | None = None,
    rough_for: float | None = None,
) -> Component:
    """Return a component with the cheapest settings that are likely to suffice.

    Args:
        accuracy: Relative error allowed.
        modes_to_hz: Frequency up to which fixed-interface modes are kept [Hz]; None for a number.
        modes: That number; None for one chosen by the planner.
        rough_for: Accuracy of the machine for which an even grid along the edges of small patches
            suffices, too; None for none.
    """
    reduction = dataclasses.replace(
        component.reduction, modes_to_hz=modes_to_hz, modes=modes, correct_mesh=True
    )
    if isinstance(component.solid, MeshFile):
        return dataclasses.replace(component, reduction=reduction)
    if component.fidelity == "polynomial":
        return dataclasses.replace(component, reduction=reduction, mesh=MeshSettings())
    mesh = None if rough_for is None else _rough_grid(component, rough_for)
    mesh = _resolve_rails(component, mesh or _start_mesh(component, accuracy))
    return dataclasses.replace(component, reduction=reduction, mesh=mesh)


def mode_margin(component: Component, accuracy: float) -> float:
    """Return the frequency range of a component's modes, over the highest frequency wanted, for
    their share of the error; modes without interfaces are those of the machine itself.
    """
    if not component.interfaces:
        return EXACT_MARGIN
    return MODE_MARGIN * max(
        1.0, math.pow(MODE_ERROR / (REDUCTION_SHARE * accuracy), 1.0 / MODE_RATE)
    )


def refine_mesh(component: Component, *, ratio: float, trials: tuple[Trial, ...]) -> Component:
    """Return the component with a mesh size at which its error should fall by a ratio.

    Args:
        component: Elastic component with a mesh size.
        ratio: Error wanted over the present one [-]; below one refines.
        trials: Its meshes so far, from which the convergence rate is observed; the expected rate
            where they are few.
    """
    mesh = component.mesh
    if mesh.size is None:
        raise ValueError("a mesh without a size cannot be refined")
    step = float(
        np.clip(
            ratio
            ** (1.0 / _observed_rate(trials, RIM_RATE if _is_rough(component) else DEFAULT_RATE)),
            LARGEST_STEP,
            LEAST_STEP,
        )
    )
    finer = _shrink(component, mesh, step)
    if _is_rough(component) and _outgrows_grid(component, finer):
        # tetrahedra graded from rims are cheaper
        finer = _start_mesh(component, COARSE_ACCURACY)
    elif (
        isinstance(component.solid, Box)
        and mesh.cells == "hex"
        and len(trials) > 1
        and _observed_rate(trials) < RIM_RATE
    ):
        # the remaining error is at the rims, where all hexahedra would have to be small
        size = min(mesh.size, WIDE * thinnest_feature(component.solid))
        finer = grade_mesh(component, size, FINE_GRADING)
    return dataclasses.replace(component, mesh=_resolve_rails(component, finer))


def _rail_limit(component: Component) -> float:
    """Return the largest element size that resolves the control points of a component's rails [m];
    inf without rails.
    """
    found = [math.inf]
    for interface in component.interfaces.values():
        pieces = None if interface.rail is None else rail_pieces(component.solid, interface)
        if pieces is not None and interface.rail is not None:
            count = interface.rail.control_points
            found.append(
                longest_elements(merge_spans(pieces), count, MeshSettings().order) or math.inf
            )
    return min(found)


def _resolve_rails(component: Component, mesh: MeshSettings) -> MeshSettings:
    """Return the mesh, or a finer one that resolves the control points of rails."""
    limit = _rail_limit(component)
    if mesh.size is None or mesh.size <= limit:
        return mesh
    return dataclasses.replace(mesh, size=limit)


def follows_errors(component: Component) -> bool:
    """Tell whether the sizes of a mesh vary with the errors of its cells."""
    meshed = component.fidelity == "elastic" and not isinstance(component.solid, MeshFile)
    return meshed and component.mesh.cells == "tet"


def give_sizes(component: Component, sizes: SizeField) -> Component:
    """Return the component with other locally varying element sizes."""
    limit = _rail_limit(component)
    sizes = dataclasses.replace(sizes, sizes=np.minimum(sizes.sizes, limit))
    mesh = MeshSettings(float(sizes.sizes.max()), sizes=sizes, details=component.mesh.details)
    return dataclasses.replace(component, mesh=mesh)


def _shrink(component: Component, mesh: MeshSettings, step: float) -> MeshSettings:
    """Return a mesh with sizes times a step, and as much finer where stresses are singular."""
    size = step * (mesh.size or 0.0)
    if mesh.cells == "hex" and isinstance(component.solid, Box):
        size = _not_single(size, min(component.solid.size))
    finer = dataclasses.replace(
        mesh,
        size=_round(size),
        across_patches=_shrink_imprints(component, mesh, step),
    )
    if mesh.growth is not None:
        finer = dataclasses.replace(
            finer, growth=_round(max(LEAST_GROWTH, np.sqrt(step) * mesh.growth))
        )
    if mesh.rim_size is not None:
        finer = dataclasses.replace(finer, rim_size=_round(step**RIM_POWER * mesh.rim_size))
    return finer


def _shrink_imprints(component: Component, mesh: MeshSettings, step: float) -> int:
    """Return the number of elements across imprints after a refinement: unchanged in a block of
    hexes whose imprints are wider than elements, which follow the size there.
    """
    narrowest = _narrowest_patch(component)
    if not np.isfinite(narrowest) or (mesh.growth is None and narrowest >= (mesh.size or 0.0)):
        return mesh.across_patches
    return min(MOST_ACROSS, math.ceil(mesh.across_patches / step))


def keep_details(component: Component, *, ratio: float) -> Component:
    """Return the component with fewer small features left out of its mesh.

    Args:
        component: STEP part with a mesh size.
        ratio: Wanted error by those features, over the present one [-].
    """
    mesh = component.mesh
    present = DETAIL_SHARE * (mesh.size or 0.0) if mesh.details is None else mesh.details
    # the change by features of a kind is proportional to their volume
    step = float(np.clip(np.cbrt(ratio), 0.0, LEAST_STEP)) if ratio > LEAST_DETAIL_RATIO else 0.0
    return dataclasses.replace(
        component, mesh=dataclasses.replace(mesh, details=_round(step * present))
    )


def refine_modes(
    component: Component, *, ratio: float, cutoff_hz: float, highest_hz: float
) -> Component:
    """Return the component with modes up to where their error should fall by a ratio.

    Args:
        ratio: Error wanted over the present one [-]; below one keeps more modes.
        cutoff_hz: Frequency up to which its modes are complete [Hz].
        highest_hz: Highest reported frequency of the machine [Hz].
    """
    factor = min(4.0, max(1.3, (1.0 / ratio) ** (1.0 / MODE_RATE))) if ratio > 0.0 else 2.0
    margin = MODE_MARGIN if component.interfaces else EXACT_MARGIN
    reach = max(factor * cutoff_hz, margin * highest_hz)
    settings = dataclasses.replace(
        component.reduction, modes_to_hz=float(f"{reach:.3g}"), modes=None
    )
    return dataclasses.replace(component, reduction=settings)


def _observed_rate(trials: tuple[Trial, ...], expected: float = DEFAULT_RATE) -> float:
    """Return the power of the mesh size with which the error of the last two trials fell; the
    expected one for the first trial.

    Where numbers converge faster than their estimates, the observed rate is limited to the expected
    one.
    """
    if len(trials) < 2:
        return expected
    before, after = trials[-2:]
    estimated = _rate(before.size / after.size, before.error / after.error)
    counted = _rate(before.size / after.size, before.counted / after.counted)
    return max(estimated, min(counted, expected))


def _rate(finer: float, smaller: float) -> float:
    if finer <= 1.0 or smaller <= 1.0:
        return SLOWEST_RATE
    return float(np.clip(math.log(smaller) / math.log(finer), SLOWEST_RATE, FASTEST_RATE))


def _start_mesh(component: Component, accuracy: float) -> MeshSettings:
    solid = component.solid
    step = min(1.0, (accuracy / START_ACCURACY) ** (1.0 / DEFAULT_RATE))
    if isinstance(solid, StepFile):
        size = COARSER_PART * automatic_size(component)
        return MeshSettings(_round(size), details=_round(DETAIL_SHARE * size))
    if isinstance(solid, MeshFile | SuperelementFile | PointMass):
        raise ValueError("the mesh of a file is not ours to choose")
    thinnest = thinnest_feature(solid)
    size = _round(min(START_SHARE * thinnest, largest_extent(solid) / FEWEST_ALONG))
    cells = _choose_cells(component, size)
    size = _round(
        _widen_hexes(component, solid, size)
        if cells == "hex"
        else _size_tets(solid, size, fine=accuracy <= START_ACCURACY)
    )
    grading = COARSE_GRADING if accuracy >= COARSE_ACCURACY else START_GRADING
    while step < 1.0 and estimate_tets(solid_volume(solid), thinnest, step * size) > DEFAULT_CELLS:
        step = min(1.0, SIZE_STEP * step)
    return _shrink(
        component,
        MeshSettings(size, cells=cells) if cells == "hex" else grade_mesh(component, size, grading),
        step,
    )


def _widen_hexes(component: Component, solid: ParametricSolid, size: float) -> float:
    """Return the size of a first mesh of a box: where it would have many hexes they are as flat as
    patches allow.
    """
    thinnest = thinnest_feature(solid)
    most = max(size, min(_narrowest_patch(component), largest_extent(solid) / ROUGH_ALONG))
    while size < most and count_hexes(component, size) > MOST_START_HEXES:
        size = max(SIZE_STEP * size, thinnest / STOUT)
    return min(size, most)


def _size_tets(solid: ParametricSolid, size: float, *, fine: bool) -> float:
    """Return the size of a first mesh of tets: two through a wall where such a mesh has few of
    them; where it would have many they are up to three times as wide as walls are thick, with
    little loss of accuracy.
    """
    volume, thinnest = solid_volume(solid), thinnest_feature(solid)
    # for bars recovery finds the error at their sides
    walled = (
        isinstance(solid, Tube) and solid.inner_diameter > 0.0 and solid.length > WALL * thinnest
    )
    if (
        fine
        and walled
        and estimate_tets(volume, thinnest, TWO_THROUGH * thinnest) <= MOST_TWO_THROUGH
    ):
        return min(size, TWO_THROUGH * thinnest)
    while size < WIDE * thinnest and estimate_tets(volume, thinnest, size) > MOST_START_TETS:
        size = min(SIZE_STEP * size, WIDE * thinnest)
    return size


def _rough_grid(component: Component, accuracy: float) -> MeshSettings | None:
    """Return hexes between the edges of patches that are too small for the usual rule, where they
    are few: cheaper than the start of a mesh generator. None where they are not.
    """
    solid = component.solid
    patches = [patch for interface in component.interfaces.values() for patch in interface.patches]
    if not isinstance(solid, Box) or not all(patch.is_grid_aligned for patch in patches):
        return None
    thinnest = min(solid.size)
    along = FINE_ALONG if accuracy <= FINE_ACCURACY else ROUGH_ALONG
    size = _round(_not_single(max(solid.size) / along, thinnest))
    if _narrowest_patch(component) >= size:
        return None
    if count_hexes(component, size, ROUGH_ACROSS) > MOST_ROUGH_HEXES:
        return None
    return MeshSettings(size, cells="hex", across_patches=ROUGH_ACROSS)


def _outgrows_grid(component: Component, mesh: MeshSettings) -> bool:
    """Tell whether hexes between the edges of small patches are too many, or single ones across the
    wall nearly as thick as long, of which estimates of the error are rough.
    """
    size = mesh.size or 0.0
    if count_hexes(component, size, mesh.across_patches) > 2 * MOST_ROUGH_HEXES:
        return True
    lines = grid_of(component, size, mesh.across_patches)
    sides = np.stack(np.meshgrid(*map(np.diff, lines), indexing="ij"))
    single = [axis for axis, line in enumerate(lines) if len(line) == 2]
    stout = (sides[single] >= STOUT * sides.max(axis=0)).any(axis=0)
    volumes = sides.prod(axis=0)
    return float(volumes[stout].sum()) > UNSEEN_SHARE * float(volumes.sum())


def _is_rough(component: Component) -> bool:
    mesh = component.mesh
    return mesh.cells == "hex" and _narrowest_patch(component) < (mesh.size or 0.0)


def _not_single(size: float, thinnest: float) -> float:
    """Return a size without rows of single hexes that are about as thick as long, whose error
    cannot be estimated.
    """
    return START_SHARE * thinnest if thinnest <= size < thinnest / STOUT else size


def grade_mesh(component: Component, size: float, grading: _Grading) -> MeshSettings:
    """Return tets of a size that grow from the rims of patches and of rigid interfaces.

    Args:
        size: Element size away from rims [m].
    """
    imprinted = np.isfinite(_narrowest_patch(component))
    # stresses grow without limit at the rim of an area that is fixed rigidly
    rigid = any(end.coupling == "rigid" for end in component.interfaces.values())
    if not imprinted and not rigid:
        return MeshSettings(size)
    across = grading.across if imprinted else MeshSettings().across_patches
    rim_size = _round(grading.rim_share * size) if rigid else None
    return MeshSettings(size, across_patches=across, growth=grading.growth, rim_size=rim_size)


def _choose_cells(component: Component, size: float) -> CellShape:
    """Choose hexes, which are cheaper at the same error, where patches are not small and do not
    fill the block with grid lines; else tets.
    """
    solid = component.solid
    patches = [patch for interface in component.interfaces.values() for patch in interface.patches]
    aligned = all(patch.is_grid_aligned for patch in patches)
    if not isinstance(solid, Box) or not aligned or _narrowest_patch(component) < size:
        return "tet"
    plain = math.prod(math.ceil(side / size) for side in solid.size)
    return "hex" if count_hexes(component, size) <= PATCHES_ADD * plain else "tet"


def _narrowest_patch(component: Component) -> float:
    """Return the width of the narrowest imprint of a component [m]; inf without any."""
    patches = [patch for interface in component.interfaces.values() for patch in interface.patches]
    return min((patch_width(one) for one in patches if one.shape != "whole"), default=math.inf)


def _round(value: float) -> float:
    return float(f"{value:.3g}")


def group_equals(parts: Mapping[str, Component], *, apart: Container[str] = ()) -> list[list[str]]:
    """Group components that are equal, in their order.

    Args:
        apart: Components that are equal to none.
    """
    groups: list[list[str]] = []
    for name, part in parts.items():
        alike = (
            group
            for group in groups
            if not (name in apart or group[0] in apart) and are_equal(parts[group[0]], part)
        )
        group = next(alike, None)
        if group is None:
            groups.append([name])
        else:
            group.append(name)
    return groups


def list_equals(parts: Mapping[str, Component], name: str) -> list[str]:
    """List the components that are equal to one of them, itself among them."""
    return [other for other, part in parts.items() if are_equal(parts[name], part)]


def are_equal(first: Component, second: Component) -> bool:
    """Tell whether two components are equal but for their name and place, so that the store serves one
    with the superelement of the other.
    """
    return all(
        getattr(first, name) == getattr(second, name)
        for name in ("solid", "material", "interfaces", "mass", "fidelity")
    )

"""Warnings to the reader of results: frequencies near or beyond what a reduction or a mesh can
show, poor cells, large errors.
"""

import math

import numpy as np

from headstock.geometry.parts.components import Component
from headstock.geometry.parts.skins import Skin
from headstock.geometry.parts.solids import MeshFile, StepFile
from headstock.meshing.component_mesh import POOR_QUALITY, MeshQuality
from headstock.meshing.length_units import doubt_mesh_size, doubt_size
from headstock.pipeline.answers.accuracy import InterfaceErrorsAnswer
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.answers.modal import FREQUENCY
from headstock.pipeline.numbers.estimates import DISCRETISATION, REDUCTION, Estimate
from headstock.pipeline.planning.interfaces import find_glued_joints, find_reach
from headstock.pipeline.planning.locking import (
    LOCKED,
    describe_locking,
    locking_share,
    write_finer_mesh,
)
from headstock.pipeline.stages.run_state import ReducedComponent, RunState
from headstock.scene.analyses.frf import FrfRequest

CUTOFF_MARGIN = 1.5
FEWEST_NODES = 6.0  # per wavelength: three second-order elements
# Rigid joints over areas that reach from their middle over this share of a wavelength were 5 to 30 %
# off in plates and blocks, beams of the same share under 1 % (`validate flexible-interfaces`)
LARGE_REACH = 0.2
STRAINED = 0.2  # share of a mode's strain energy in the two bodies of a joint
LARGE_ERROR = 0.5  # of a number
# a thousandth of the volume in elements that are wrong by all of their energy moves no frequency by
# more than 0.05 %
POOR_SHARE = 1e-3
BAD_QUALITY = 2e-3  # below a thousandth elements are refused
REPAIRED_SHARE = 1e-3  # per dof; there are about six dofs per element


def _warn_of_cutoff(name: str, reduced: ReducedComponent, highest_hz: float) -> list[str]:
    """A warning where frequencies come near the first fixed-interface mode left out.

    Source: the margin is that of Code_Aster R4.06.02 for dynamic substructuring.
    """
    truncation = reduced.superelement.errors.truncation
    # without any mode kept the moments still tell where the first one lies
    cutoff = (
        reduced.superelement.cutoff_hz
        if truncation is None
        else math.sqrt(truncation.limit) / (2.0 * math.pi)
    )
    if not highest_hz > cutoff / CUTOFF_MARGIN:
        return []
    text = (
        f"component {name!r} keeps its fixed-interface modes complete up to {cutoff:.4g} Hz only, and frequencies up to"
        f" {highest_hz:.4g} Hz are reported: those above {cutoff / CUTOFF_MARGIN:.4g} Hz are too high"
    )
    if highest_hz > cutoff:
        text += (
            f", for those above {cutoff:.4g} Hz there is no error estimate, and some may be missing"
        )
    return [f'{text}; write reduction = {{ modes_to = "{3 * highest_hz:.0f} Hz" }}']


def _warn_of_mesh(component: Component, reduced: ReducedComponent, highest_hz: float) -> list[str]:
    """A warning where waves are too short for the mesh: under six nodes on the shortest."""
    if (
        reduced.quality is None
        or reduced.skin is None
        or not highest_hz > 0.0
        or component.material.density <= 0.0
    ):
        return []
    thickness = _wall_thickness(reduced.skin, reduced.quality)
    length = _shortest_wave(component, thickness, highest_hz)
    spacing = _node_spacing(reduced.superelement.full_dofs // 3, reduced.quality.volume, thickness)
    if length >= FEWEST_NODES * spacing:
        return []
    return [
        f"component {component.name!r}: at {highest_hz:.4g} Hz the bending wavelength of its walls (about {1e3 * thickness:.3g} mm thick) is"
        f" {1e3 * length:.3g} mm, {length / spacing:.2g} nodes of its mesh, so frequencies there are too high;"
        f" {write_finer_mesh(component, float(f'{2.0 * length / FEWEST_NODES:.2g}'))}"
    ]


def _warn_of_locking(
    component: Component, reduced: ReducedComponent, highest_hz: float, error: float | None
) -> list[str]:
    """A warning where single tetrahedra across thin walls lock in bending waves as short as those
    of the highest frequency.

    Args:
        highest_hz: As in ``locking_share``.
        error: Largest share of a result that its mesh may be off by; None where unknown. Walls that
            carry loads along their plane do not lock, and this is how they are known.
    """
    quality = reduced.quality
    if (
        quality is None
        or reduced.skin is None
        or not quality.flatness > 0.0
        or (error is not None and error < LOCKED)
    ):
        return []
    share = locking_share(
        component.material,
        quality.flatness,
        highest_hz,
        extent=float(np.ptp(reduced.skin.points, axis=0).max()),
        thickness=_wall_thickness(reduced.skin, quality),
    )
    size, thickness = quality.flat_size, quality.flat_thickness
    if share < LOCKED:
        return []
    return [describe_locking(component, share, size=size, thickness=thickness)]


def _wall_thickness(skin: Skin, quality: MeshQuality) -> float:
    """Twice the volume over the surface [m]: the thickness of a component that is all walls, less
    than that of a block.
    """
    corners = skin.points[skin.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return 2.0 * quality.volume / float(0.5 * np.linalg.norm(normals, axis=1).sum())


def _shortest_wave(component: Component, thickness: float, hz: float) -> float:
    """Length of the shorter of a shear wave and of a bending wave in a plate of the walls'
    thickness [m].

    Args:
        component: For its material; the density is above zero.
        thickness: Of the walls [m].
        hz: Frequency of the waves [Hz].

    Source: Cremer, Heckl and Petersson (2005), Structure-Borne Sound, eqs. 3.36 and 3.83.
    """
    material, omega = component.material, 2.0 * math.pi * hz
    shear = (
        math.sqrt(
            material.youngs_modulus / (2.0 * (1.0 + material.poisson_ratio)) / material.density
        )
        / hz
    )
    plate = (
        material.youngs_modulus
        * thickness**2
        / (12.0 * (1.0 - material.poisson_ratio**2) * material.density)
    )
    bending = 2.0 * math.pi * math.sqrt(math.sqrt(plate) / omega)
    return min(shear, bending)


def _node_spacing(nodes: int, volume: float, thickness: float) -> float:
    """Distance of the nodes of a mesh along its walls [m], at least three of them through the
    thickness.

    Args:
        volume: Of the component [m^3].
        thickness: Of the walls [m].
    """
    even = math.cbrt(volume / nodes)
    across = max(3.0, thickness / even + 1.0)
    return max(even, math.sqrt(volume / thickness * across / nodes))


def find_warnings(state: RunState) -> list[str]:
    """Warnings about the superelements and about frequencies beyond their reach."""
    highest = max(
        (float(modes.frequencies_hz.max(initial=0.0)) for modes in state.modal), default=0.0
    )
    frf = state.scene.analyses.get(FrfRequest)
    highest = max(highest, frf.to_hz if frf is not None else 0.0)
    warnings: list[str] = []
    for name, reduced in state.reduced.items():
        warnings += _component_warnings(name, reduced) + _size_warnings(
            state.plan.components[name], reduced
        )
        warnings += _warn_of_cutoff(name, reduced, highest)
        component = state.plan.components[name]
        warnings += _warn_of_locking(
            component, reduced, highest, _mesh_share(state, name)
        ) or _warn_of_mesh(component, reduced, highest)
    return warnings + _warn_of_large_interfaces(state) + _warn_of_large_errors(state)


def _warn_of_large_interfaces(state: RunState) -> list[str]:
    """A warning per rigid joint between elastic bodies whose area is no longer small beside the
    waves of a mode that strains them, and has six motions only.
    """
    if find_answers(state.answers, InterfaceErrorsAnswer):
        return []
    components, warnings = state.plan.components, []
    for joint in find_glued_joints(state.scene.machine, components):
        plain = [
            (components[name], interface)
            for name, interface in joint.ends
            if not components[name].interfaces[interface].flexible
        ]
        modes = [
            float(modes.frequencies_hz[index])
            for modes in state.modal
            for index, shares in enumerate(modes.energy_share)
            if index >= modes.rigid_count
            and sum(shares.get(name, 0.0) for name, _ in joint.ends) > STRAINED
        ]
        waves = [_count_waves(state, *end, max(modes)) for end in plain] if modes else []
        if max(waves, default=0.0) > LARGE_REACH:
            warnings.append(
                f"joint {joint.name}: {joint} move as one in six motions, but reach over {max(waves):.2g} of the bending wavelength at"
                f" {max(modes):.4g} Hz; frequencies may be several percent off. interface_errors = true, above the first table of"
                f" {state.scene.path.name}, computes by how much; coupling = {{ flexible = 24 }} in both interfaces lets them deform"
            )
    return warnings


def _count_waves(state: RunState, component: Component, interface: str, hz: float) -> float:
    """How far an interface reaches from its middle, over the shortest wavelength in its component;
    0 where the mesh is not known.
    """
    reduced = state.reduced[component.name]
    if reduced.skin is None or reduced.quality is None or component.material.density <= 0.0:
        return 0.0
    reach = find_reach(component, interface, reduced.quality.cad_areas.get(interface, 0.0))
    return reach / _shortest_wave(component, _wall_thickness(reduced.skin, reduced.quality), hz)


def _mesh_share(state: RunState, component: str) -> float | None:
    """Largest share of a number that a component's mesh may be off by; None where nobody knows."""
    shares = [
        error.parts.get(DISCRETISATION, {}).get(component, 0.0) / abs(value)
        for _, value, error in _stated_errors(state)
        if error.total is not None and value
    ]
    return max(shares, default=None)


def _stated_errors(state: RunState, *kinds: str) -> list[tuple[str, float, Estimate]]:
    """Return frequencies, compliances and numbers of other kinds with their names and ±."""
    several = len(state.plan.poses) > 1
    return [
        (number.describe(several_poses=several), number.value, number.error)
        for answer in (*state.modal, *state.static, *find_answers(state.answers, PoseResponse))
        for number in answer.list_numbers()
        if number.key.kind in (FREQUENCY, "compliance", *kinds) and number.error is not None
    ]


def _warn_of_large_errors(state: RunState) -> list[str]:
    """A warning per component that makes what stands behind ± as large as the numbers, with the
    worst of them and a remedy.
    """
    worst: dict[tuple[str, str], tuple[float, str]] = {}
    for what, value, error in _stated_errors(state, "peak", "level"):
        parts = {
            (name, source): size
            for source, sizes in error.parts.items()
            for name, size in sizes.items()
        }
        if error.total is not None and parts and error.total > LARGE_ERROR * abs(value) > 0.0:
            owner = max(parts, key=lambda key: parts[key])
            worst[owner] = max(worst.get(owner, (0.0, "")), (error.total / abs(value), what))
    return [
        f"component {name!r}: {what} is a rough estimate only: its ± is {share:.2g} times its value, most of it {source}; write"
        f" {'a higher reduction.modes_to' if source == REDUCTION else 'a smaller mesh size'}"
        for (name, source), (share, what) in worst.items()
    ]


def _size_warnings(component: Component, reduced: ReducedComponent) -> list[str]:
    """What makes the unit of a STEP or mesh file doubtful."""
    solid, skin = component.solid, reduced.skin
    if not isinstance(solid, StepFile | MeshFile) or skin is None:
        return []
    extent = float(np.ptp(skin.points, axis=0).max())
    doubt = (
        doubt_size(solid.path, extent)
        if isinstance(solid, StepFile)
        else doubt_mesh_size(solid, extent, reduced.superelement.mass_kg)
    )
    return [] if doubt is None else [f"component {component.name!r}: {doubt}"]


def _component_warnings(name: str, reduced: ReducedComponent) -> list[str]:
    warnings = [f"component {name!r}: {message}" for message in reduced.superelement.warnings]
    if reduced.superelement.free_dofs:
        warnings.append(
            f"component {name!r}: interface dofs without mass and stiffness: {', '.join(reduced.superelement.free_dofs)}"
        )
    if reduced.quality is not None:
        warnings += [
            f"component {name!r}: {message}"
            for message in _mesh_warnings(reduced.quality, reduced.superelement.full_dofs)
        ]
    return warnings


def _mesh_warnings(quality: MeshQuality, dofs: int) -> list[str]:
    """What is said of a mesh; a few poor or straightened elements among thousands move no
    result.
    """
    warnings = list(quality.remarks)
    if quality.repaired > REPAIRED_SHARE * dofs:
        warnings.append(
            f"{quality.repaired} curved elements were inverted as meshed and were repaired"
        )
    if quality.poor_share > POOR_SHARE or quality.minimum_scaled_jacobian < BAD_QUALITY:
        position = ", ".join(f"{value:.4g}" for value in quality.worst_place)
        face = f", {quality.worst_face}" if quality.worst_face else ""
        warnings.append(
            f"elements with {quality.poor_share:.2g} of the volume have a scaled Jacobian below {POOR_QUALITY:g} (1 is ideal), the"
            f" worst {quality.minimum_scaled_jacobian:.2g} at ({position}) m{face}; a smaller mesh size may help"
        )
    return warnings

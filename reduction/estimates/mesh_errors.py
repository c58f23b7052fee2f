"""Errors of a coupled machine's frequencies and compliances by the meshes of its components and by
the kind of their interfaces.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.geometry.parts.components import Material
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.dof_layout import turn_dofs
from headstock.reduction.superelement_checks import rigid_motions
from headstock.solvers.linear.modal_analysis import ModalResult
from headstock.solvers.second_order import ComplexArray

# share of the strain energy in dofs whose mesh error is unknown: beyond it a number has no
# estimate
SILENT_SHARE = 0.01
# of what the true surface changes to first order in its distance from the mesh (`validate
# coverage`)
SHAPE_SAFETY = 1.5
# A round punch of radius a on a half-space gives 0.5 (1 - nu^2) / (E a) under a force along its
# normal, even pressure 0.54 in the mean (Johnson 1985, Contact Mechanics, sections 3.2 and 3.4).
# Moments and the other directions give about as much: two halves of a bar came out within a factor
# of two of what both kinds give.
FORCE_DOUBT, MOMENT_DOUBT = 0.04, 0.12


@dataclass(frozen=True, eq=False)
class _PartChange:
    """Store changes of the matrices of a component where its mesh deviates from its geometry.

    Attributes:
        stiffness: ``(n_c, n_c)``.
        mass: ``(n_c, n_c)``.
    """

    stiffness: FloatArray
    mass: FloatArray


@dataclass(frozen=True, eq=False)
class MeshedPart:
    """Describe a component with an estimate of its mesh, and its dofs in the machine.

    Attributes:
        energy: ``(n_c, n_c)`` energy products of the discretisation error, times the safety factor
            that covers 95 % of true errors.
        stiffness: ``(n_c, n_c)`` of the component.
        rows: ``(n_c, n)``.
        silent: ``(n_c,)`` dofs without an estimate: some files estimate the lower modal dofs only,
            and some meshes have no estimate at all.
        reach_hz: Lowest fixed-interface frequency among these dofs [Hz], inf with none, 0 where all
            are silent.
        faces: Changes by the part's curved faces, likewise times a factor; None where these faces
            are unknown.
        left_out: Changes by small features that its mesh lacks, likewise; None for none.
        corrected: Its stiffness is corrected by the estimate: the error may have either sign.
        rigid: ``(n_c, r)`` orthonormal rigid motions of its dofs; None where supports constrain it.
    """

    energy: FloatArray
    stiffness: FloatArray
    rows: FloatArray
    silent: BoolArray
    reach_hz: float = np.inf
    faces: _PartChange | None = None
    left_out: _PartChange | None = None
    corrected: bool = False
    rigid: FloatArray | None = None

    def strain[Motions: (FloatArray, ComplexArray)](self, motions: Motions) -> Motions:
        """Return its dofs ``(n_c, m)`` under motions of the machine ``(n, m)``, without its rigid
        motions: these miss no energy, but their roundoff would look large compared with a soft
        mount.
        """
        return self.without_rigid(self.rows @ motions)

    def without_rigid[Motions: (FloatArray, ComplexArray)](self, motions: Motions) -> Motions:
        """Return the motions of its dofs, ``(n_c,)`` or ``(n_c, m)``, without their rigid part."""
        return motions if self.rigid is None else motions - self.rigid @ (self.rigid.T @ motions)

    @property
    def shape(self) -> _PartChange | None:
        """Return the changes by faces and features together; None where both are unknown."""
        changes = [change for change in (self.faces, self.left_out) if change is not None]
        if not changes:
            return None
        return _PartChange(
            np.sum([change.stiffness for change in changes], axis=0),
            np.sum([change.mass for change in changes], axis=0),
        )


def meshed_parts(coupled: CoupledMachine) -> dict[str, MeshedPart]:
    """List the components of a machine whose mesh has an estimate."""
    parts = {}
    for name, part in coupled.layout.superelements.items():
        errors = part.errors
        if errors.missing_energy is not None:
            rows = turn_dofs(part, coupled.placements[name]) @ coupled.basis[coupled.offsets[name]]
            # a fixed-interface mode is strained, so a mesh misses some of its energy
            silent = np.diag(errors.missing_energy) <= 0.0
            unidentifiable = bool(silent.all())
            silent[: part.boundary_size] &= unidentifiable
            reach = (
                0.0
                if unidentifiable
                else part.modal_frequencies_hz[silent[part.boundary_size :]].min(initial=np.inf)
            )
            parts[name] = MeshedPart(
                energy=errors.mesh_safety * errors.missing_energy,
                stiffness=part.stiffness,
                rows=rows,
                silent=silent,
                reach_hz=float(reach),
                faces=_scale_change(errors.shape_stiffness, errors.shape_mass),
                left_out=_scale_change(errors.left_out_stiffness, errors.left_out_mass),
                corrected=errors.corrected,
                rigid=None
                if part.supported
                else np.linalg.qr(rigid_motions(part, part.center_of_mass))[0],
            )
    return parts


def _scale_change(stiffness: FloatArray | None, mass: FloatArray | None) -> _PartChange | None:
    if stiffness is None or mass is None:
        return None
    return _PartChange(SHAPE_SAFETY * stiffness, SHAPE_SAFETY * mass)


def _missing_energies(coupled: CoupledMachine, motions: FloatArray) -> dict[str, FloatArray]:
    """Return the energy products of the discretisation errors of each meshed component under
    motions of the machine.

    Args:
        motions: ``(n, m)`` generalised displacements.

    Returns:
        Component to ``(m, m)``; components without an estimate are left out.
    """
    strained = {
        name: (part.energy, part.strain(motions)) for name, part in meshed_parts(coupled).items()
    }
    return {name: strains.T @ energy @ strains for name, (energy, strains) in strained.items()}


def frequency_mesh_errors(coupled: CoupledMachine, modes: ModalResult) -> dict[str, FloatArray]:
    """Return how much each mesh overestimates the natural frequencies, ``(m,)`` per component [Hz];
    NaN where unknown.

    The inertial loads ``omega_h^2 M phi`` of a mode move the true body by ``w``, whose energy exceeds
    that of the mode by the energy that meshes miss, a share ``e`` of it. The Rayleigh quotient of
    ``w`` is at most ``omega_h^2 / (1 + e)``, and the lowest true frequency is no higher.

    Source: Strang and Fix (1973), An Analysis of the Finite Element Method, sections 1.6 and 6.3.
    """
    elastic = np.arange(len(modes.frequencies_hz)) >= modes.rigid_count
    squares = np.where(elastic, (2.0 * np.pi * modes.frequencies_hz) ** 2, np.inf)
    shares = {
        name: np.diag(energy) / squares
        for name, energy in _missing_energies(coupled, modes.shapes).items()
    }
    total = np.sum([np.zeros(len(squares)), *shares.values()], axis=0)
    drop = modes.frequencies_hz * (1.0 - 1.0 / np.sqrt(1.0 + total))
    unknown = elastic & (silent_energies(coupled, modes.shapes) > SILENT_SHARE * squares)
    drop = np.where(unknown, np.nan, drop)
    return {
        name: drop * share / np.where(total > 0.0, total, 1.0) for name, share in shares.items()
    }


def silent_energies(coupled: CoupledMachine, motions: FloatArray) -> FloatArray:
    """Return twice the strain energies ``(m,)`` of motions in dofs of unknown mesh error."""
    total = np.zeros(motions.shape[1])
    for part in meshed_parts(coupled).values():
        silent = (part.rows @ motions)[part.silent]
        total += np.einsum(
            "im,ij,jm->m", silent, part.stiffness[np.ix_(part.silent, part.silent)], silent
        )
    return total


def frequency_shape_errors(coupled: CoupledMachine, modes: ModalResult) -> dict[str, FloatArray]:
    """Return the change of natural frequencies by curved faces that meshes approximate by facets,
    ``(m,)`` per component [Hz].

    Source: Rayleigh; to first order ``omega^2`` changes by ``phi^T (dK - omega^2 dM) phi``.
    """
    return {
        name: _frequency_change(part, part.faces, modes)
        for name, part in meshed_parts(coupled).items()
        if part.faces is not None and part.faces.stiffness.any()
    }


def frequency_feature_errors(coupled: CoupledMachine, modes: ModalResult) -> dict[str, FloatArray]:
    """Return the change of natural frequencies by small features that meshes lack, ``(m,)`` per
    component [Hz].

    Source: As ``frequency_shape_errors``.
    """
    return {
        name: _frequency_change(part, part.left_out, modes)
        for name, part in meshed_parts(coupled).items()
        if part.left_out is not None
    }


def _frequency_change(part: MeshedPart, change: _PartChange, modes: ModalResult) -> FloatArray:
    elastic = np.arange(len(modes.frequencies_hz)) >= modes.rigid_count
    squares = np.where(elastic, (2.0 * np.pi * modes.frequencies_hz) ** 2, np.inf)
    stiffer, heavier = (
        np.einsum("im,ij,jm->m", local, matrix, local)
        for local, matrix in (
            (part.strain(modes.shapes), change.stiffness),
            (part.rows @ modes.shapes, change.mass),
        )
    )
    share = stiffer / squares - np.where(elastic, heavier, 0.0)
    return 0.5 * modes.frequencies_hz * np.abs(share)


def compliance_shape_errors(
    coupled: CoupledMachine, displacements: FloatArray
) -> dict[str, FloatArray]:
    """Return the change of static compliances by curved faces that meshes approximate by facets,
    ``(m,)`` per component.

    Args:
        displacements: ``(n, m)`` responses to unit loads.
    """
    return {
        name: _compliance_change(part, part.faces, displacements)
        for name, part in meshed_parts(coupled).items()
        if part.faces is not None and part.faces.stiffness.any()
    }


def compliance_feature_errors(
    coupled: CoupledMachine, displacements: FloatArray
) -> dict[str, FloatArray]:
    """Return the change of static compliances by small features, ``(m,)`` per component.

    Args:
        displacements: ``(n, m)`` responses to unit loads.
    """
    return {
        name: _compliance_change(part, part.left_out, displacements)
        for name, part in meshed_parts(coupled).items()
        if part.left_out is not None
    }


def product_errors(
    coupled: CoupledMachine, left: FloatArray, right: FloatArray
) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Return the changes of products of static responses with loads by each mesh, and by the curved
    faces and small features that it lacks, ``(m,)`` per component.

    Args:
        left: ``(n, m)`` adjoint responses: to the loads whose work is the quantity of interest.
        right: ``(n,)`` response whose quantity is wanted.

    Source: Prudhomme and Oden (1999), Comput. Methods Appl. Mech. Engrg. 176, 313-331: the error of
    a linear quantity is the energy product of the errors of both responses.
    """
    meshes, faces = {}, {}
    for name, part in meshed_parts(coupled).items():
        left_strain, right_strain = part.strain(left), part.strain(right)
        meshes[name] = left_strain.T @ part.energy @ right_strain
        if part.shape is not None:
            faces[name] = left_strain.T @ part.shape.stiffness @ right_strain
    return meshes, faces


def _compliance_change(
    part: MeshedPart, change: _PartChange, displacements: FloatArray
) -> FloatArray:
    strains = part.strain(displacements)
    return np.abs(np.einsum("im,ij,jm->m", strains, change.stiffness, strains))


def compliance_mesh_errors(
    coupled: CoupledMachine, displacements: FloatArray
) -> dict[str, FloatArray]:
    """Return how much each mesh underestimates a static compliance.

    Args:
        displacements: ``(n, 6)`` responses to unit loads at a point.

    Returns:
        Component to ``(6, 6)``, to be added to the compliance: its diagonal is never negative; NaN
        where that is not known.

    Source: Clapeyron; the energy of a finite element solution under given loads is too small by the
    energy of its error.
    """
    soft = np.einsum("im,ij,jm->m", displacements, coupled.system.stiffness, displacements)
    unknown = silent_energies(coupled, displacements) > SILENT_SHARE * soft
    blank = np.where(unknown[:, None] | unknown, np.nan, 0.0)
    return {
        name: energy + blank for name, energy in _missing_energies(coupled, displacements).items()
    }


def interface_kind_energies(
    coupled: CoupledMachine,
    motions: FloatArray,
    squares: FloatArray,
    areas: Mapping[tuple[str, str], float],
    parts: Mapping[str, Material],
) -> dict[str, FloatArray]:
    """Return twice the energies ``(m,)`` by which the kind of each interface, rigid or average, may
    change motions, by ``component.interface``.

    Args:
        motions: ``(n, m)`` generalised displacements.
        squares: ``(m,)`` squares of the angular frequencies of the motions, 0 at rest.
        areas: Area of fixed interfaces by component and interface [m^2].
        parts: Meshed components, with their materials.
    """
    energies: dict[str, FloatArray] = {}
    for (name, interface), area in areas.items():
        element = coupled.layout.superelements[name]
        if interface not in element.interface_maps:
            continue
        local_rows = (
            turn_dofs(element, coupled.placements[name])
            @ coupled.basis[coupled.offsets[name]]
            @ motions
        )
        node = element.interface_maps[interface].node
        rows = slice(6 * node, 6 * node + 6)
        forces = element.stiffness[rows] @ local_rows - (element.mass[rows] @ local_rows) * squares
        radius = np.sqrt(area / np.pi)
        modulus = parts[name].youngs_modulus / (1.0 - parts[name].poisson_ratio ** 2)
        forces_2, moments_2 = (forces[:3] ** 2).sum(axis=0), (forces[3:] ** 2).sum(axis=0)
        energies[f"{name}.{interface}"] = (
            FORCE_DOUBT * forces_2 / radius + MOMENT_DOUBT * moments_2 / radius**3
        ) / modulus
    return energies

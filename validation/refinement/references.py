"""References of the two beams of Kono et al.: the paper's closed forms, the same with shear, and
converged 3D elasticity.
"""

from dataclasses import dataclass
from typing import Literal

from headstock.geometry.parts.components import Material
from headstock.validation.parts.closed_form_cases import CANTILEVER, FIXED_BEAM, STEEL
from headstock.validation.references.beam_theory import (
    EndConditions,
    axial_extension,
    cantilever_force_deflection,
    cantilever_moment_deflection,
    cantilever_shear_deflection,
    cantilever_twist,
    euler_bernoulli_frequencies,
    fixed_beam_deflection,
    fixed_beam_shear_deflection,
    fixed_beam_twist,
    timoshenko_frequencies,
    torsional_frequencies,
    turn_section,
)
from headstock.validation.references.rows import reference_case

FORCE, MOMENT, OFFSET = 1e3, 1.0, 0.1  # N, N m, m
UM = 1e6
Group = Literal["static", "modal"]

SHEAR = "Euler-Bernoulli leaves out shear"
SHEAR_AND_ROTARY = "Euler-Bernoulli leaves out shear and rotary inertia"
WARPING = "Saint-Venant lets the clamped ends warp"
CLAMP = "beam theory lets the section contract at the clamp"


@dataclass(frozen=True)
class _BeamReference:
    """What a quantity should be, by three methods.

    Attributes:
        quantity: ``dx(Fx)`` [um] or a natural frequency such as ``X1`` [Hz].
        analytic: The paper's analytic value: Euler-Bernoulli bending, Saint-Venant torsion.
        beam: Timoshenko's in place of Euler-Bernoulli's: what exact beam springs tend to.
        solid: Converged 3D elasticity: what finite elements tend to.
        note: Why the first is off, where it is.
    """

    quantity: str
    group: Group
    analytic: float
    beam: float
    solid: float
    note: str = ""


@dataclass(frozen=True, eq=False)
class ReferenceBeam:
    """A beam of the paper.

    Attributes:
        name: As a scene's study names it.
        size: Sides of its box [m].
        axis: Direction of the beam, 0..2.
        ends: How they are fixed.
        references: By quantity, in the paper's order.
        figures: Numbers of the paper's figures: segmented static, FEM static, segmented modal, FEM
            modal.
    """

    name: str
    title: str
    size: tuple[float, float, float]
    axis: int
    ends: EndConditions
    material: Material
    references: dict[str, _BeamReference]
    figures: tuple[int, int, int, int]


def _cantilever_references() -> dict[str, _BeamReference]:
    """Six loads and six modes of the column clamped at its foot."""
    thin, wide = CANTILEVER, turn_section(CANTILEVER)
    solid = list(reference_case("kono-cantilever-static").values.values())
    twist = cantilever_twist(thin, MOMENT) * thin.width / 2.0
    moment_y, moment_x = (cantilever_moment_deflection(beam, MOMENT) for beam in (wide, thin))
    extension = axial_extension(thin, FORCE)
    static = [
        (
            "dx(Fx)",
            cantilever_force_deflection(thin, FORCE),
            cantilever_shear_deflection(thin, FORCE),
            CLAMP,
        ),
        (
            "dy(Fy)",
            cantilever_force_deflection(wide, FORCE),
            cantilever_shear_deflection(wide, FORCE),
            SHEAR,
        ),
        ("dz(Fz)", extension, extension, CLAMP),
        ("dy(Ma)", moment_y, moment_y, CLAMP),
        ("dx(Mb)", moment_x, moment_x, CLAMP),
        ("dx(Mc)", twist, twist, WARPING),
    ]
    found = [
        _BeamReference(name, "static", UM * analytic, UM * beam, right, note)
        for (name, analytic, beam, note), right in zip(static, solid, strict=True)
    ]
    slender_x = euler_bernoulli_frequencies(thin, "clamped-free", 3)
    slender_y = euler_bernoulli_frequencies(wide, "clamped-free", 2)
    deep_x = timoshenko_frequencies(thin, "clamped-free", 3)
    deep_y = timoshenko_frequencies(wide, "clamped-free", 2)
    torsion = float(torsional_frequencies(thin, "clamped-free", 1)[0])
    modal = [
        ("X1", slender_x[0], deep_x[0], CLAMP),
        ("Y1", slender_y[0], deep_y[0], SHEAR_AND_ROTARY),
        ("X2", slender_x[1], deep_x[1], SHEAR_AND_ROTARY),
        ("T1", torsion, torsion, WARPING),
        ("Y2", slender_y[1], deep_y[1], SHEAR_AND_ROTARY),
        ("X3", slender_x[2], deep_x[2], SHEAR_AND_ROTARY),
    ]
    return _by_name(
        found + _modal_references(modal, list(reference_case("kono-cantilever").values.values()))
    )


def _fixed_beam_references() -> dict[str, _BeamReference]:
    """Return a force at and above the middle of the front face, and three modes, of the beam
    clamped at both ends.
    """
    flat = FIXED_BEAM
    bending, sheared = fixed_beam_deflection(flat, FORCE), fixed_beam_shear_deflection(flat, FORCE)
    twist = fixed_beam_twist(flat, FORCE * OFFSET)
    high, tilt = OFFSET * twist, flat.depth / 2.0 * twist
    solid = reference_case("kono-fixed-beam-static").values
    at, above = "dx(Fx), h_F = 0", "dx(Fx), h_F = 100 mm"
    both = f"{WARPING}; {SHEAR}; a section this wide bends like a plate"
    wide = f"{SHEAR}; a section this wide bends like a plate"
    static = [
        (at, bending, sheared, solid["dx patch average, h_F=0"], wide),
        (above, bending + high, sheared + high, solid["dx patch average, h_F=100mm"], both),
        ("dz(Fx), h_F = 100 mm", tilt, tilt, solid["|dz| patch average, h_F=100mm"], WARPING),
        (f"{at}, back face", bending, sheared, solid["dx back face, h_F=0"], wide),
        (
            f"{above}, back face",
            bending + high,
            sheared + high,
            solid["dx back face, h_F=100mm"],
            both,
        ),
    ]
    found = [
        _BeamReference(name, "static", UM * a, UM * b, c, note) for name, a, b, c, note in static
    ]
    slender = euler_bernoulli_frequencies(flat, "clamped-clamped", 2)
    deep = timoshenko_frequencies(flat, "clamped-clamped", 2)
    torsion = float(torsional_frequencies(flat, "clamped-clamped", 1)[0])
    modal = [
        ("X1", slender[0], deep[0], wide),
        ("T1", torsion, torsion, WARPING),
        ("X2", slender[1], deep[1], wide),
    ]
    return _by_name(
        found
        + _modal_references(modal, list(reference_case("kono-fixed-beam").values.values())[:3])
    )


def reference_beam(name: str) -> ReferenceBeam:
    """Return the beam of a name.

    Raises:
        KeyError: There is none.
    """
    return {
        "kono-cantilever": ReferenceBeam(
            name,
            "cantilever",
            (0.038, 0.1, 0.5),
            2,
            "clamped-free",
            STEEL,
            _cantilever_references(),
            (6, 7, 8, 9),
        ),
        "kono-fixed-beam": ReferenceBeam(
            name,
            "beam fixed at both ends",
            (0.032, 0.75, 0.25),
            1,
            "clamped-clamped",
            STEEL,
            _fixed_beam_references(),
            (11, 12, 13, 14),
        ),
    }[name]


def _modal_references(
    modal: list[tuple[str, float, float, str]], solid: list[float]
) -> list[_BeamReference]:
    return [
        _BeamReference(name, "modal", float(analytic), float(beam), right, note)
        for (name, analytic, beam, note), right in zip(modal, solid, strict=True)
    ]


def _by_name(references: list[_BeamReference]) -> dict[str, _BeamReference]:
    return {reference.quantity: reference for reference in references}

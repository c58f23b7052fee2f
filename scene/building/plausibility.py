"""Numbers of a scene that look wrong: densities, sizes, weights, and frequencies far above anything
useful. What joints and weights do to each other is in ``pipeline/preview/doubts.py``.
"""

import math
from collections.abc import Iterator

from headstock.geometry.parts.components import weigh_modes
from headstock.geometry.parts.mass_properties import solid_volume
from headstock.geometry.parts.solids import Box, HollowColumn, Plate, Solid, Tube
from headstock.scene.building.components import bounding_box
from headstock.scene.building.draft import Draft
from headstock.scene.reading.findings import Findings
from headstock.scene.reading.positions import KeyPath
from headstock.scene.schema.components import ComponentTable
from headstock.scene.schema.scene import SceneTable

SOUND_SPEEDS = (500.0, 15000.0)
DENSITIES = (100.0, 25000.0)
# of the thinnest and the longest side, and of the longest at least [m]
SIZES, LEAST_LENGTH = (1e-5, 50.0), 1e-4
MASS_RATIOS = (0.05, 20.0)  # of a written mass to that of the solid
MOST_MODES = 3000
DEFORMING = ("elastic", "polynomial")


def check_numbers(draft: Draft) -> None:
    """Warn of materials, sizes and weights that no machine part has, and of elements that lock."""
    scene, solids = draft.table, draft.solids
    for name, material in scene.materials.items():
        speed = math.sqrt(material.E / material.rho)
        key: KeyPath = ("materials", name)
        low, high = SOUND_SPEEDS
        if not low <= speed <= high:
            hint = "check E and rho"
            if material.E < 1e7 or material.rho < 1e-3:
                hint = "these look like mm-t-s numbers: write MPa and t/mm^3"
            draft.findings.warn(
                (*key, "E"),
                f"sound would travel at {speed:.3g} m/s, outside {low:g} to {high:g} m/s; {hint}",
            )
        if not DENSITIES[0] <= material.rho <= DENSITIES[1]:
            draft.findings.warn(
                (*key, "rho"),
                f"{material.rho:.3g} kg/m^3 is outside {DENSITIES[0]:g} to {DENSITIES[1]:g} kg/m^3",
            )
    for name, solid in solids.items():
        box = bounding_box(solid)
        sizes = [high - low for low, high in box] if box else []
        if sizes and not (
            SIZES[0] <= min(sizes) and max(sizes) >= LEAST_LENGTH and max(sizes) <= SIZES[1]
        ):
            text = " x ".join(f"{size:.3g}" for size in sizes)
            draft.findings.warn(
                ("components", name, "solid"),
                f"measures {text} m; a machine part is {LEAST_LENGTH:g} to {SIZES[1]:g} m long and no thinner than {SIZES[0]:g} m; check the units",
            )
        _check_weight(name, solid, scene, draft.findings)
        if scene.components[name].mesh.order == 1 and scene.components[name].fidelity == "elastic":
            draft.findings.warn(
                ("components", name, "mesh"),
                "linear elements lock: they come out too stiff; order = 2 is the default",
            )


def check_unused_interfaces(draft: Draft) -> None:
    """Warn of areas of deforming bodies that are held rigid for nothing."""
    named = set(_texts({key: value for key, value in draft.raw.items() if key != "components"}))
    for name, component in draft.table.components.items():
        unused = [one for one in component.interfaces if f"{name}.{one}" not in named]
        # a part of which nothing is named is described for its own sake
        if component.fidelity not in DEFORMING or len(unused) == len(component.interfaces):
            continue
        for interface in unused:
            table = component.interfaces[interface]
            if table.coupling == "rigid" and table.rail is None:
                draft.findings.warn(
                    ("components", name, "interfaces", interface),
                    f'nothing refers to "{name}.{interface}", which yet holds its area rigid and stiffens the part; '
                    'remove it, name it in a joint, point or load, or write coupling = "average"',
                )


def _texts(value: object) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for inner in value.values():
            yield from _texts(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _texts(inner)


def check_mode_counts(draft: Draft) -> None:
    """How high an analysis looks: nobody can use the modes of a solid by the thousands.

    Source: Weyl (1911): the number of natural frequencies below ``f`` of a volume ``V`` grows like
    ``4 pi/3 V f^3 (1/c_p^3 + 2/c_s^3)``.
    """
    scene, solids = draft.table, draft.solids
    requested: dict[KeyPath, float | None] = {
        ("analyses", name, table.highest): getattr(table, table.highest)
        for name, table in scene.analyses.requested.items()
        if table.highest
    }
    limits = {
        name: _highest_frequency(scene.components[name], solid, scene)
        for name, solid in solids.items()
    }
    elastic = {
        name: limit
        for name, limit in limits.items()
        if limit is not None and scene.components[name].fidelity == "elastic"
    }
    for name, limit in elastic.items():
        own = scene.components[name].reduction.modes_to
        if own is not None and own > limit:
            draft.add(("components", name, "reduction", "modes_to"), _too_high(own, name, limit))
    # a component with a cut-off or a number of modes of its own does not follow the analyses
    tables = scene.components
    following = {
        name: limit
        for name, limit in elastic.items()
        if tables[name].reduction.modes_to is tables[name].reduction.modes is None
    }
    lowest = min(following, key=lambda name: following[name], default=None)
    for place, wanted in requested.items():
        if lowest is not None and wanted is not None and wanted > following[lowest]:
            draft.add(place, _too_high(wanted, lowest, following[lowest]))


def _check_weight(name: str, solid: Solid, scene: SceneTable, findings: Findings) -> None:
    """A mass that is written is about that of the solid: a slip of units is off by a thousand."""
    table = scene.components[name]
    own = _own_mass(table, solid, scene)
    if table.mass is None or own is None:
        return
    low, high = MASS_RATIOS
    if not low <= table.mass / own <= high:
        findings.warn(
            ("components", name, "mass"),
            f"{table.mass:.3g} kg for a solid that weighs {own:.3g} kg; check the unit",
        )


def _own_mass(table: ComponentTable, solid: Solid, scene: SceneTable) -> float | None:
    """Mass of a parametric solid of its material [kg]; None where the solid or the material is not
    known here.
    """
    material = scene.materials.get(table.material or "")
    if material is None or not isinstance(solid, Box | Tube | Plate | HollowColumn):
        return None
    return material.rho * solid_volume(solid)


def _too_high(wanted: float, component: str, limit: float) -> str:
    return f"{wanted:.3g} Hz: {component} alone has more than {MOST_MODES} natural frequencies up to there; write {limit:.2g} Hz at most"


def _highest_frequency(table: ComponentTable, solid: Solid, scene: SceneTable) -> float | None:
    """Frequency [Hz] up to which a solid has ``MOST_MODES`` natural frequencies; None where its
    volume is not known here.
    """
    material = scene.materials.get(table.material or "")
    if (
        material is None
        or not isinstance(solid, Box | Tube | Plate | HollowColumn)
        or not -1.0 < material.nu < 0.5
    ):
        return None
    if not SOUND_SPEEDS[0] <= math.sqrt(material.E / material.rho) <= SOUND_SPEEDS[1]:
        return None  # a slip of units, warned of elsewhere
    return float(
        (MOST_MODES / (solid_volume(solid) * weigh_modes(material.E, material.nu, material.rho)))
        ** (1.0 / 3.0)
    )

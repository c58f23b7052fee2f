"""Numbers of a scene that look wrong: densities, sizes, weights, and frequencies far above anything
useful. What joints and weights do to each other is in ``pipeline/preview/doubts.py``.
"""

import math
from collections.abc import Iterator

from headstock.geometry.parts.components import weigh_modes
from headstock.geometry.parts.mass_properties import solid_volume
from headstock.geometry.parts.solids import ParametricSolid, Solid
from headstock.scene.building.components import bounding_box
from headstock.scene.building.draft import Draft
from headstock.scene.reading.findings import Findings, KeyPath
from headstock.scene.schema.components import ComponentTable, MaterialTable
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
    for name, material in draft.table.materials.items():
        _check_material(("materials", name), material, draft.findings)
    for name, solid in draft.solids.items():
        table = draft.table.components[name]
        _check_size(("components", name, "solid"), solid, draft.findings)
        _check_weight(name, solid, draft.table, draft.findings)
        if table.mesh.order == 1 and table.fidelity == "elastic":
            draft.findings.warn(
                ("components", name, "mesh"),
                "linear elements lock: they come out too stiff; order = 2 is the default",
            )


def _check_material(key: KeyPath, table: MaterialTable, findings: Findings) -> None:
    speed = math.sqrt(table.E / table.rho)
    low, high = SOUND_SPEEDS
    if not low <= speed <= high:
        hint = "check E and rho"
        if table.E < 1e7 or table.rho < 1e-3:
            hint = "these look like mm-t-s numbers: write MPa and t/mm^3"
        findings.warn(
            (*key, "E"),
            f"sound would travel at {speed:.3g} m/s, outside {low:g} to {high:g} m/s; {hint}",
        )
    low, high = DENSITIES
    if not low <= table.rho <= high:
        findings.warn(
            (*key, "rho"), f"{table.rho:.3g} kg/m^3 is outside {low:g} to {high:g} kg/m^3"
        )


def _check_size(key: KeyPath, solid: Solid, findings: Findings) -> None:
    thinnest, longest = SIZES
    sizes = [high - low for low, high in bounding_box(solid) or ()]
    if sizes and not (thinnest <= min(sizes) and LEAST_LENGTH <= max(sizes) <= longest):
        text = " x ".join(f"{size:.3g}" for size in sizes)
        findings.warn(
            key,
            f"measures {text} m; a machine part is {LEAST_LENGTH:g} to {longest:g} m long and no thinner than {thinnest:g} m; check the units",
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
    """Report frequencies up to which a solid has modes by the thousands, which nobody can use.

    Source: Weyl (1911): the number of natural frequencies below ``f`` of a volume ``V`` grows like
    ``4 pi/3 V f^3 (1/c_p^3 + 2/c_s^3)``.
    """
    scene = draft.table
    limits = {
        name: limit
        for name, solid in draft.solids.items()
        if scene.components[name].fidelity == "elastic"
        and (limit := _highest_frequency(scene.components[name], solid, scene)) is not None
    }
    for name, limit in limits.items():
        cut_off = scene.components[name].reduction.modes_to
        if cut_off is not None and cut_off > limit:
            key: KeyPath = ("components", name, "reduction", "modes_to")
            draft.add(key, _too_high(cut_off, name, limit))
    # a component with a cut-off or a number of modes of its own does not follow the analyses
    following = {
        name: limit
        for name, limit in limits.items()
        if not scene.components[name].reduction.given(("modes_to", "modes"))
    }
    lowest = min(following, key=lambda name: following[name], default=None)
    for name, table in scene.analyses.requested.items() if lowest is not None else ():
        wanted = getattr(table, table.highest) if table.highest else None
        if lowest is not None and wanted is not None and wanted > following[lowest]:
            key = ("analyses", name, table.highest)
            draft.add(key, _too_high(wanted, lowest, following[lowest]))


def _check_weight(name: str, solid: Solid, scene: SceneTable, findings: Findings) -> None:
    """A mass that is written is about that of the solid: a slip of units is off by a thousand."""
    table = scene.components[name]
    material = scene.materials.get(table.material or "")
    if table.mass is None or material is None or not isinstance(solid, ParametricSolid):
        return
    weight = material.rho * solid_volume(solid)
    low, high = MASS_RATIOS
    if not low <= table.mass / weight <= high:
        findings.warn(
            ("components", name, "mass"),
            f"{table.mass:.3g} kg for a solid that weighs {weight:.3g} kg; check the unit",
        )


def _too_high(wanted: float, component: str, limit: float) -> str:
    return f"{wanted:.3g} Hz: {component} alone has more than {MOST_MODES} natural frequencies up to there; write {limit:.2g} Hz at most"


def _highest_frequency(table: ComponentTable, solid: Solid, scene: SceneTable) -> float | None:
    """Frequency [Hz] up to which a solid has ``MOST_MODES`` natural frequencies; None where its
    volume is not known here.
    """
    material = scene.materials.get(table.material or "")
    if material is None or not isinstance(solid, ParametricSolid) or not -1.0 < material.nu < 0.5:
        return None
    if not SOUND_SPEEDS[0] <= math.sqrt(material.E / material.rho) <= SOUND_SPEEDS[1]:
        return None  # a slip of units, warned of elsewhere
    return float(
        (MOST_MODES / (solid_volume(solid) * weigh_modes(material.E, material.nu, material.rho)))
        ** (1.0 / 3.0)
    )

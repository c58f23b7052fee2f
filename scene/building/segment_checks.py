"""Checks that a component can be cut into segments, and that loads can act on what is not meshed."""

from headstock.geometry.parts.prismatic_bars import patch_span, prismatic_bar
from headstock.geometry.parts.solids import Solid
from headstock.scene.building.components import build_patch
from headstock.scene.reading.positions import KeyPath
from headstock.scene.schema.components import ComponentTable
from headstock.scene.schema.connections import LoadTable


def find_segment_faults(table: ComponentTable, solid: Solid) -> list[tuple[KeyPath, str]]:
    """Why a segmented component cannot be one: the key below it and what to write."""
    if table.fidelity != "segmented" or table.solid.superelement is not None:
        return []
    try:
        bar = prismatic_bar(solid, table.segments.along)
    except ValueError as error:
        return [(("fidelity",), f'cannot be segmented: {error}; write "elastic" or "rigid"')]
    faults: list[tuple[KeyPath, str]] = []
    for name, interface in table.interfaces.items():
        for patch in interface.patch_tables():
            try:
                patch_span(bar, build_patch(patch, solid))
            except ValueError as error:
                faults.append((("interfaces", name), f"cannot hang on segments: {error}"))
    return faults


def find_load_fault(load: LoadTable, component: ComponentTable | None) -> str:
    """Why a load cannot act on its component; empty when it can."""
    if component is None or component.solid.superelement is not None or load.kind != "pressure" or component.fidelity == "elastic":
        return ""
    return f"a pressure needs a mesh and the component is {component.fidelity}; write a traction or a force, or make it elastic"

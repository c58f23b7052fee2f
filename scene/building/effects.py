"""Effects: what may be written for them, and which act in no analysis of a scene."""

from headstock.scene.building.draft import Draft
from headstock.scene.reading.findings import Findings
from headstock.scene.schema.effects import CONTOUR_EFFECTS, find_effect_fault


def check_effects(draft: Draft, findings: Findings) -> None:
    """Report effects that cannot be switched on, and those of contours that nothing obeys."""
    scene = draft.table
    for name, value in scene.effects.items():
        if fault := find_effect_fault(name, value):
            findings.add(("effects", name), fault)
    acting, on_path = scene.analyses.effects, "path" in scene.analyses.requested
    if scene.mechanism is not None:
        # its variants may name effects for contours that they leave out
        acting |= {*CONTOUR_EFFECTS} - ({"regeneration"} if on_path else set())
    for name in set(CONTOUR_EFFECTS) - acting:
        if scene.effects.get(name):
            findings.add(("effects", name), _explain_effect(name, on_path=on_path))


def _explain_effect(name: str, *, on_path: bool) -> str:
    """What to say of an effect that does not act."""
    if name == "coriolis":
        return (
            "needs no switch here: linear axes do not turn what they carry, and what a guide that tilts does to a body that slides along it"
            " is part of every way that follows its poses; remove it"
        )
    if name == "cutting_force":
        return "acts in [analyses.contouring] and along [analyses.path], and this scene has neither; remove it"
    if not on_path:
        return "acts in [analyses.contouring] only, and this scene has none; remove it"
    return (
        "acts along contours, where teeth meet the waves of those before them; give the line of this path as polyline in [analyses.contouring],"
        " or its corners in a CSV file as polyline_file, or remove the effect"
    )

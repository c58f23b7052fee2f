"""The volumetric analysis: built from its table, and what may be wrong with it."""

import math

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.scene.building.draft import Draft, check_name
from headstock.scene.reading.findings import Findings
from headstock.scene.requests import VolumetricRequest
from headstock.scene.schema.effects import GUIDE_ERRORS
from headstock.scene.schema.scene import SceneTable

MAX_POSES = 20_000


def build_volumetric(scene: SceneTable) -> VolumetricRequest | None:
    """The volumetric analysis a scene asks for: the axes of its sweep with several positions, the
    others where they stand.
    """
    request = scene.analyses.volumetric
    if request is None:
        return None
    spans: dict[str, FloatArray] = {
        name: np.asarray(np.linspace(span.low.value, span.high.value, span.positions), dtype=float)
        for name, span in (scene.sweeps[request.sweep].axes or {}).items()
    }
    return VolumetricRequest(
        at=tuple(request.at or scene.points),
        axes=tuple((name, values) for name, values in spans.items() if len(values) > 1),
        fixed={name: float(values[0]) for name, values in spans.items() if len(values) == 1},
    )


def check_volumetric(draft: Draft, findings: Findings) -> None:
    """Report unknown points and sweeps, sweeps of another form, and a machine that nothing moves."""
    scene = draft.table
    request = scene.analyses.volumetric
    if request is None:
        return
    key = ("analyses", "volumetric")
    for index, point in enumerate(request.at or ()):
        check_name((*key, "at", index), point, "points", draft, findings)
    if request.at is None and not scene.points:
        findings.add(
            key,
            'there is no point whose error is wanted; write [points] tcp = { tool = "component.interface", work = "ground" }',
        )
    effects = {name for name, value in scene.effects.items() if value is not False}
    if not effects & {GUIDE_ERRORS, "gravity"} and not scene.loads:
        findings.add(
            key,
            "nothing moves the tool: there are no errors of guides, no gravity and no loads; write [effects] gravity = true or guide_errors = true",
        )
    check_name((*key, "sweep"), request.sweep, "sweeps", draft, findings)
    sweep = scene.sweeps.get(request.sweep)
    if sweep is None:
        return
    counts = [span.positions for span in (sweep.axes or {}).values()]
    if sum(count > 1 for count in counts) not in (2, 3):
        findings.add(
            (*key, "sweep"),
            "a volumetric map needs a sweep of axes in which two or three have more than one position",
        )
    elif math.prod(counts) > MAX_POSES:
        findings.add(
            (*key, "sweep"),
            f"has {math.prod(counts)} poses; a volumetric map takes {MAX_POSES} at most",
        )

"""The contours behind the table of marks: the same faces, entered from corners, and one change each."""

import dataclasses

import numpy as np

from headstock.scene.analyses.contouring import ContouringRequest
from headstock.solvers.milling.tool_path import plan_contour
from headstock.validation.mechanisms.contouring_cases import AT_CORNERS, _vary_contour


def test_a_line_from_corners_mills_the_faces_of_the_block() -> None:
    contours = dict(_vary_contour())
    block, line = (
        plan_contour(contours[name].contour) for name in ("straight into face 1", AT_CORNERS)
    )
    # it begins with the last face
    assert [cut.at for cut in block.cuts] != [cut.at for cut in line.cuts]
    for ours, theirs in zip(line.cuts[1:], block.cuts[:3], strict=True):
        np.testing.assert_allclose(ours.outward, theirs.outward, atol=1e-12)
        np.testing.assert_allclose(ours.start, theirs.start, atol=1e-9)
        assert abs(ours.length - theirs.length) < 1e-9


def test_each_contour_changes_what_it_is_called_by_and_nothing_else() -> None:
    contours = dict(_vary_contour())
    changes = {
        name: {field for field in _fields() if _differs(request, contours[AT_CORNERS], field)}
        for name, request in contours.items()
    }
    assert changes == {
        "straight into face 1": {"contour"},
        AT_CORNERS: set(),
        "with axial force": {"cut", "material"},
        "1 % damping": {"damping"},
        "runout of 5 um": {"cut"},
        "regeneration": {"regeneration"},
        "spindle and tool": {"tool_modes"},
        "spindle, tool and regeneration": {"regeneration", "tool_modes"},
    }


def _fields() -> list[str]:
    return [field.name for field in dataclasses.fields(ContouringRequest)]


def _differs(one: ContouringRequest, other: ContouringRequest, field: str) -> bool:
    return bool(getattr(one, field) != getattr(other, field))

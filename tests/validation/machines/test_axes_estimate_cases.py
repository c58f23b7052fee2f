"""± of a contour covers what fine meshes say."""

from headstock.validation.machines.axes_estimate_cases import check_contour_smoke


def test_errors_of_a_contour_cover_what_fine_meshes_say() -> None:
    beyond, ratio = check_contour_smoke()
    assert beyond.passed and ratio.passed
    judged = int(ratio.note.split("; ")[1].split()[0])
    assert judged > 30

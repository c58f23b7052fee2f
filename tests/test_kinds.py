"""What a quick run takes (tests/conftest.py): kinds are found through all that a test may load."""

from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parent


@pytest.mark.parametrize(
    ("file", "kind"),
    [
        ("pipeline/stages/test_prescribed_displacements.py", "scenes"),  # loads elements by name
        ("public/test_smoke.py", "smoke"),
        ("reduction/components/test_probes.py", "fem"),
        ("solvers/state_spaces/test_time_response.py", None),
        ("scene/reading/test_units.py", None),
    ],
)
def test_what_may_load_finite_elements_is_found(
    request: pytest.FixtureRequest, file: str, kind: str | None
) -> None:
    (conftest,) = (
        plugin
        for plugin in request.config.pluginmanager.get_plugins()
        if getattr(plugin, "__file__", None) == str(TESTS / "conftest.py")
    )
    kinds = conftest.kinds_of(TESTS / file)
    assert kinds == frozenset() if kind is None else kind in kinds

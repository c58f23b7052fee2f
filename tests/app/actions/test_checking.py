"""The scene that a command line asks for."""

from pathlib import Path

import pytest

from headstock.app.actions.checking import load_chosen
from headstock.pipeline.storage.provenance import SceneChoice

CANTILEVER = Path(__file__).parents[3] / "machines" / "cantilever.toml"


@pytest.mark.parametrize(
    ("written", "settings", "models"),
    [
        ("", (), "deforming"),
        ('accuracy = "3 %"\n', (), "deforming"),
        ("", ("accuracy=2%",), "deforming"),
        ('accuracy = { to = "3 %", models = "none" }\n', (), "none"),
    ],
)
def test_an_accuracy_of_the_command_line_replaces_the_number_alone(
    tmp_path: Path, written: str, settings: tuple[str, ...], models: str
) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(written + CANTILEVER.read_text())
    chosen = load_chosen(SceneChoice(scene, None, settings), "1%")
    assert chosen.accuracy is not None
    assert (chosen.accuracy.to, chosen.accuracy.models) == (0.01, models)

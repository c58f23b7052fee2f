"""Keys that have changed their name are refused under the old one, with the new one."""

from pathlib import Path

import pytest

from cases import cases
from fixture_machines import stored_scene, write_scene
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from headstock.scene.reading.names import SCENE_KEYS
from headstock.scene.schema.validation import known_keys, unknown_key

SCENE = stored_scene("overrides").partition("[variants.stiff]")[0]
TABLES = {
    "Frf": ("analyses", "frf"),
    "Interface": ("components", "bar", "interfaces", "tip"),
    "Mesh": ("components", "bar", "mesh"),
    "Modal": ("analyses", "modal"),
    "Path": ("analyses", "path"),
    "Rail": ("components", "bar", "interfaces", "tip", "rail"),
    "Screw": ("joints", "clamp", "screw"),
    "Study": ("studies", "size"),
}


@pytest.mark.parametrize("old", sorted(SCENE_KEYS))
def test_every_old_key_names_one_that_the_schema_has(old: str) -> None:
    table, key = old.split(".")
    path, new = TABLES[table], SCENE_KEYS[old]
    keys = known_keys(path) or []
    assert new in keys
    assert key not in keys
    assert f"write {new}" in unknown_key((*path, key))


@cases
def test_an_old_key_in_a_scene_is_refused_at_its_line(
    tmp_path: Path, added: str, line: int, new: str
) -> None:
    path = write_scene(tmp_path, SCENE + added, name="bar")
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    (problem,) = [found for found in caught.value.problems if new in found.message]
    assert (problem.file, problem.line) == (str(path), line)


def test_an_old_key_of_a_setting_is_refused(tmp_path: Path) -> None:
    path = write_scene(tmp_path, SCENE, name="bar")
    with pytest.raises(SceneError, match=r"(?s)--set .*write allow_locking"):
        load_scene(path, overrides=["components.bar.mesh.force=true"])

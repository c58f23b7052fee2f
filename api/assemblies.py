"""Scenes of CAD assemblies: ``new_from_assembly``."""

from pathlib import Path

from headstock.arguments import read_path_argument
from headstock.pipeline.preview.assemblies import draft_assembly
from headstock.pipeline.storage.outputs import fill_new_folder, require_new_folder


def new_from_assembly(folder: str | Path, file: str | Path) -> Path:
    """Make a folder with the scene of a STEP assembly, and return the scene's file.

    Its values that are not sure are open: ``check`` lists them, ``load`` takes other values for them, or
    ``accept_defaults``.

    Args:
        folder: It is made, and must not hold anything yet.
        file: STEP file, which is copied.

    Raises:
        HeadstockError: The file cannot be read, or the folder not be made.
    """
    target = read_path_argument(folder, "new_from_assembly", "folder").absolute()
    source = read_path_argument(file, "new_from_assembly", "file")
    require_new_folder(target)
    name = f"{target.name}.toml"
    fill_new_folder(target, draft_assembly(source, name).draft.texts, [source])
    return target / name

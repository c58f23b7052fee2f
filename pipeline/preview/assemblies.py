"""An assembly file as a scene: its solids, where they touch, how they can move, and what is asked."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from headstock.geometry.assemblies.contacts import Contact
from headstock.geometry.assemblies.pair_motions import PairMotion, find_pair_motions
from headstock.geometry.assemblies.parts import Assembly
from headstock.geometry.parts.cad_faces import find_ends
from headstock.geometry.parts.solids import StepFile
from headstock.meshing.assemblies.contact_search import find_contacts
from headstock.meshing.assemblies.survey import survey_assembly
from headstock.meshing.components.survey import survey_step
from headstock.scene.assemblies.drafting import DraftedScene, draft_scene


@dataclass(frozen=True, eq=False)
class AssemblyScene:
    """An assembly, what was found in it, and its scene."""

    assembly: Assembly
    contacts: tuple[Contact, ...]
    motions: tuple[PairMotion, ...]
    draft: DraftedScene


def draft_assembly(
    file: Path, scene: str, progress: Callable[[str], None] = lambda text: None
) -> AssemblyScene:
    """Read an assembly file and write its scene.

    Args:
        scene: Name of the scene's file.
        progress: Called with what is done next.

    Raises:
        MeshError: The file is no STEP file, or holds no solids, or too many.
    """
    progress("solids")
    assembly = survey_assembly(file)
    progress("contacts")
    contacts = find_contacts(assembly)
    motions = find_pair_motions(assembly, contacts)

    def list_ends(number: int) -> list[str]:
        progress(f"faces of solid {number}")
        chosen = number if len(assembly.solids) > 1 else None
        return [*find_ends(survey_step(StepFile(file.absolute(), chosen)).faces)]

    draft = draft_scene(assembly, contacts, motions, scene=scene, name=file.stem, ends_of=list_ends)
    return AssemblyScene(assembly, contacts, motions, draft)

"""What is known of a part before it is meshed: mass properties, kept in the store where the CAD
kernel or a mesh file has to be asked for them, and patches that its file does not have.
"""

import importlib
from collections.abc import Callable

from headstock.geometry.parts.components import Component
from headstock.geometry.parts.mass_properties import SolidProperties, closed_form_properties
from headstock.geometry.parts.solids import MeshFile
from headstock.meshing.components.mesh_request import require_sound
from headstock.meshing.errors import MeshError, PartFileError, PatchError
from headstock.pipeline.storage.content_keys import properties_key
from headstock.pipeline.storage.store import Store, read_entry, write_entry
from headstock.scene.reading.findings import KeyPath, Problem
from headstock.scene.scene import Scene

# loaded where a part has no closed form
MESH_MODULE = "headstock.meshing.components.meshing"


def describe_solid(
    component: Component, store: Store, warn: Callable[[str | None], None] = lambda message: None
) -> SolidProperties:
    """Properties of a component's solid and interfaces for unit density.

    Args:
        component: Its material and placement play no part.
        store: Where they are kept; those with a closed form are not.
        warn: Called with warnings of a store that cannot be read or written, and remarks on the part's file.

    Raises:
        MeshError: The solid cannot be built or a patch does not exist.
    """
    closed = closed_form_properties(component)
    if closed is not None:
        require_sound(component)
        return closed
    key = properties_key(component)
    read = read_entry(store, key, SolidProperties)
    warn(read.warning)
    properties = read.value
    if properties is None:
        properties = importlib.import_module(MESH_MODULE).describe_component(component)
        warn(write_entry(store, key, properties))
    for remark in properties.remarks:
        warn(f"component {component.name!r}: {remark}")
    return properties


def find_missing_patches(scene: Scene) -> tuple[list[Problem], list[str]]:
    """Find what is wrong with the mesh files of a scene and the patches on them, and remark on files
    that could not be read for another reason; STEP files are left to the mesher.
    """
    problems, remarks = [], []
    supports, loads = tuple(scene.machine.supports.values()), tuple(scene.machine.loads.values())
    for name, component in scene.machine.components.items():
        if not isinstance(component.solid, MeshFile):
            continue
        try:
            meshing = importlib.import_module(MESH_MODULE)
            faults, notes = meshing.find_file_faults(component, supports, loads)
        except PartFileError as error:
            key = ("components", name, "solid", "mesh")
            problems.append(scene.findings.describe(key, str(error)))
        except MeshError as error:
            remarks.append(f"patches are not checked: {error}")
        else:
            remarks += [f"component {name!r}: {note}" for note in notes]
            problems += [_describe(scene, component, fault) for fault in faults]
    return problems, remarks


def locate_patch(scene: Scene, component: str, error: PatchError) -> PatchError:
    """The error of a patch that a part's file does not have, with its place in the scene."""
    problem = _describe(scene, scene.machine.components[component], error)
    return PatchError(str(problem), error.group, error.patch)


def _describe(scene: Scene, component: Component, error: PatchError) -> Problem:
    owner, _, name = error.group.rpartition(":")
    key: KeyPath = (
        (f"{owner}s", name) if owner else ("components", component.name, "interfaces", name)
    )
    within = scene.findings.origins
    if (*key, "face") in within or (*key, "patches") not in within:
        key = (*key, "face")
    elif error.patch is not None:
        key = (*key, "patches", error.patch, "face")
    return scene.findings.describe(key, str(error))

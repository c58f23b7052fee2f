"""Keys of the store: SHA-256 of everything that a mesh or a superelement depends on, and of nothing
else.

Beside the scene's text these are the code of this program, its libraries, the files of solids and
measured forces.
"""

import dataclasses
import functools
import hashlib
import importlib
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import ModuleType

import numpy as np

import headstock.geometry
import headstock.meshing
import headstock.pipeline
import headstock.reduction
import headstock.scene
import headstock.solvers
from headstock.geometry.machine.machine import Probe, Sensor
from headstock.geometry.parts.components import (
    DEFAULT_EIGENSOLVER,
    SUPPORT_GROUP,
    Component,
    Load,
    Support,
)
from headstock.geometry.parts.skins import Skin
from headstock.geometry.parts.solids import MeshFile, Solid, StepFile, SuperelementFile
from headstock.meshing.formats import MESH_SUFFIXES
from headstock.meshing.process.strangers import files_beside
from headstock.pipeline.storage.json_texts import JsonValue
from headstock.scene.reading.files import TomlTable
from headstock.scene.reading.keys import find_keys, split_key, value_at
from headstock.scene.scene import Scene, list_analyses

SIGNIFICANT_DIGITS = 12
# of a scene, of no influence on what is found in one of its points or poses
UNUSED_SECTIONS = ("name", "studies", "sweeps", "variants", "compare", "exports")
MESH_LIBRARIES = ("gmsh", "meshio", "numpy", "vtk")
REDUCTION_LIBRARIES = ("fenics-dolfinx", "petsc4py", "slepc4py", "gmsh", "numpy", "scipy")
# a build from pip that holds these and says nothing of their versions, which are then those of other
# builds that it hides
DOLFINX_BUILD = "dolfinx-solver-real"
BUILT_TOGETHER = ("fenics-dolfinx", "petsc4py", "slepc4py")
PACKAGES = (
    headstock.geometry,
    headstock.meshing,
    headstock.solvers,
    headstock.reduction,
    headstock.scene,
    headstock.pipeline,
)
# what meshing and reducing a component import, and nothing else: a change in milling or control
# keeps what is stored
MESH_CODE = (headstock.geometry, headstock.meshing)
REDUCTION_ROOMS = (
    (headstock.solvers, "elastic"),
    (headstock.solvers, "recovery"),
    (headstock.reduction, "components"),
)
FILE_KEYS = [
    split_key(key)
    for key in (
        *(f"components.*.solid.{kind}" for kind in ("step", "mesh", "superelement")),
        *("components.*.mesh.sizes", "sensors.*.file", "masses.*.file"),
        *(f"analyses.contouring.{name}" for name in ("forces", "polyline_file", "traces")),
    )
]


def mesh_key(component: Component, supports: Sequence[Support], loads: Sequence[Load]) -> str:
    """Key of a component's mesh: shape, sizes and patches; not its place, material, coupling or
    name.

    Args:
        component: Its solid, mesh settings and interfaces.
        supports: On this component; their patches count.
        loads: On this component; their patches count.
    """
    return _mesh_digest(
        {
            "solid": _solid_content(component),
            "settings": component.mesh,
            "interfaces": {
                name: (interface.patches, interface.allow_singular)
                for name, interface in component.interfaces.items()
            },
            "supports": {
                name.removeprefix(SUPPORT_GROUP): patches
                for support in supports
                for name, patches in support.groups.items()
            },
            "loads": {load.name: load.patches for load in loads if load.patches},
        }
    )


def skin_key(component: Component) -> str:
    """Key of what is drawn of a solid from a file."""
    return _mesh_digest(
        {
            "skin of": _solid_content(component),
        }
    )


def properties_key(component: Component) -> str:
    """Key of the mass properties of a solid and of its interfaces."""
    return _mesh_digest(
        {
            "properties of": _solid_content(component),
            # an imported mesh is judged and described with its settings
            "settings": component.mesh,
            "interfaces": {name: item.patches for name, item in component.interfaces.items()},
        }
    )


def thinned_skin_key(skin: Skin, *, largest: int, pixel: float) -> str:
    """Key of a surface that was made coarser.

    Args:
        largest: How many triangles are requested.
        pixel: Largest invisible deviation [m].
    """
    return _mesh_digest(
        {
            "coarser than": skin,
            "largest": largest,
            "pixel": pixel,
        }
    )


def superelement_key(
    component: Component,
    supports: Sequence[Support],
    loads: Sequence[Load],
    probes: Sequence[Probe] = (),
    sensors: Sequence[Sensor] = (),
) -> str:
    """Key of the superelements of an elastic component, or one of polynomials: its mesh settings,
    couplings, supports, loads and Poisson's ratio, then behind ``_`` modulus, density and mass.

    How much a superelement holds of them (fixed-interface modes, gravity) is not in it: one that
    holds more serves for less.

    Args:
        loads: On this component; of tractions and body loads only the place counts, as a
            superelement holds their unit loads.
        sensors: On this component; of an elastic one only places at which forces act count, with the
            modes that are kept beside: its recovery shows all others.
    """
    material = component.material
    amounts = (material.youngs_modulus, material.density, component.mass)
    family = _digest(
        {
            "mesh": mesh_key(component, supports, loads),
            "algorithm": [_room_fingerprint(package, room) for package, room in REDUCTION_ROOMS],
            "libraries": library_versions(REDUCTION_LIBRARIES),
            "poisson": material.poisson_ratio,
            # only where another is requested: what was stored before there was a choice stays good
            **(
                {}
                if component.reduction.eigensolver == DEFAULT_EIGENSOLVER
                else {"eigensolver": component.reduction.eigensolver}
            ),
            **({"solver": "iterative"} if component.reduction.solver == "iterative" else {}),
            **({} if component.fidelity == "elastic" else {"fidelity": component.fidelity}),
            "couplings": {
                name: (interface.coupling, interface.rail, *filter(None, [interface.flexible]))
                for name, interface in component.interfaces.items()
            },
            "supports": {
                support.name: sorted(map(str, support.directions)) for support in supports
            },
            "loads": {
                load.name: (load.kind, load.magnitude) for load in loads if load.kind != "force"
            },
            # only where there are some: what was stored before stays good
            **({"probes": {one.name: one.position for one in probes}} if probes else {}),
            **_sensor_content(component, sensors),
        }
    )
    return f"{family}_{','.join(str(_canonical(amount)) for amount in amounts)}"


def _sensor_content(component: Component, sensors: Sequence[Sensor]) -> dict[str, object]:
    """Return what the superelement of a component knows of its sensors; without any the key is that
    of before.
    """
    content: dict[str, object] = {}
    if sensors and component.fidelity != "elastic":
        content["sensors"] = {one.name: one.position for one in sensors}
    if loaded := sorted({one.position for one in sensors if one.is_loaded}):
        content["attached"] = loaded, component.reduction.modes, component.reduction.modes_to_hz
    return content


def search_key(scene: Scene) -> str:
    """Key of the settings that a search found for a scene: all that it says, its files, the analyses
    of this run, code and libraries.
    """
    return _digest(
        {
            "algorithm": [code_fingerprint(package) for package in PACKAGES],
            "libraries": library_versions((*MESH_LIBRARIES, *REDUCTION_LIBRARIES)),
            "scene": scene.raw,
            "files": dict(file_digests(scene.path.parent, scene.raw)),
            "analyses": sorted(list_analyses(scene)),
            "models": scene.accuracy,
        }
    )


def hash_dependencies(
    folder: Path, raw: TomlTable, *, without: Sequence[str] = (), **more: object
) -> str:
    """Return the key of everything results of a scene depend on: the scene, its files, this program.

    Args:
        without: Further sections of no influence.
        more: What they depend on besides.
    """
    left_out = (*UNUSED_SECTIONS, *without)
    return _digest(
        {
            "scene": {key: value for key, value in raw.items() if key not in left_out},
            "files": dict(file_digests(folder, raw)),
            "algorithm": [code_fingerprint(package) for package in PACKAGES],
            "libraries": library_versions(REDUCTION_LIBRARIES),
            **more,
        }
    )


@functools.cache
def library_versions(names: tuple[str, ...]) -> dict[str, str]:
    """Versions of installed libraries, read from their metadata without importing them;
    ``"unknown"`` where there is none.
    """
    return {name: _library_version(name) for name in names}


@functools.cache
def code_fingerprint(package: ModuleType) -> str:
    """SHA-256 over the source files of a sub-package and its rooms, the catalogue and templates: a
    changed algorithm never meets results of the old one.
    """
    return _fingerprint(package, ("**/*.py", "**/*.toml", "**/*.html", "**/*.css", "**/*.js"))


@functools.cache
def _room_fingerprint(package: ModuleType, room: str) -> str:
    """The same over one room and the sub-package's own files, on which its rooms stand."""
    return _fingerprint(package, ("*.py", f"{room}/**/*.py"))


def _fingerprint(package: ModuleType, patterns: tuple[str, ...]) -> str:
    digest = hashlib.sha256()
    for folder in package.__path__:
        for path in sorted(path for pattern in patterns for path in Path(folder).glob(pattern)):
            digest.update(
                path.relative_to(folder).as_posix().encode() + b"\0" + path.read_bytes() + b"\0"
            )
    return digest.hexdigest()


def canonical_json(value: object) -> str:
    """JSON that is equal for equal content: sorted keys, floats to 12 significant digits."""
    return json.dumps(_canonical(value), sort_keys=True, allow_nan=False, separators=(",", ":"))


def _digest(content: Mapping[str, object]) -> str:
    return hashlib.sha256(canonical_json(content).encode()).hexdigest()


def _mesh_digest(content: Mapping[str, object]) -> str:
    """Return the digest of what meshing makes of something, with this program and its libraries."""
    fingerprints = [code_fingerprint(package) for package in MESH_CODE]
    libraries = library_versions(MESH_LIBRARIES)
    return _digest({"algorithm": fingerprints, "libraries": libraries, **content})


def _canonical(value: object) -> JsonValue:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields: dict[str, JsonValue] = {
            field.name: _canonical(getattr(value, field.name))
            for field in dataclasses.fields(value)
        }
        return {"type": type(value).__name__, **fields}
    if isinstance(value, dict):
        return {str(key): _canonical(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_canonical(item) for item in value]
    if isinstance(value, np.ndarray):
        return hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
    if isinstance(value, float | np.floating):
        # as a word: json would write infinities, which are legal for open limits, as invalid
        # tokens; + 0.0 drops the sign of zero
        return repr(float(f"{float(value):.{SIGNIFICANT_DIGITS}g}") + 0.0)
    if value is None or isinstance(value, bool | int | str):
        return value
    raise TypeError(f"a {type(value).__name__} has no canonical form")


def _solid_content(component: Component) -> Solid | dict[str, JsonValue]:
    solid = component.solid
    if isinstance(solid, StepFile | MeshFile | SuperelementFile):
        details = {
            name: value
            for name, value in dataclasses.asdict(solid).items()
            if name not in ("path", "beside")
        }
        # the arrays of an XDMF file lie in others, which it names
        beside = solid.beside if isinstance(solid, MeshFile) else ()
        if beside:
            details["beside"] = {path.name: file_digest(path) for path in beside}
        return {
            "type": type(solid).__name__,
            "content": file_digest(solid.path),
            "suffix": solid.path.suffix.lower(),
            **details,
        }
    return solid


def _library_version(name: str) -> str:
    if name in BUILT_TOGETHER and (build := _find_version(DOLFINX_BUILD)):
        return f"{DOLFINX_BUILD} {build}"
    return _find_version(name) or "unknown"


def _find_version(name: str) -> str | None:
    metadata = importlib.import_module("importlib.metadata")
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def file_digests(folder: Path, raw: TomlTable) -> Iterator[tuple[str, str]]:
    """Files that solids and measured forces are read from and their SHA-256."""
    for name in [
        str(value_at(raw, key)) for pattern in FILE_KEYS for key in find_keys(raw, pattern)
    ]:
        path = folder / name
        yield name, file_digest(path)
        if path.suffix.lower() in MESH_SUFFIXES:
            for other in files_beside(path):
                yield str(Path(name).parent / other), file_digest(path.parent / other)


def file_digest(path: Path) -> str:
    """SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()

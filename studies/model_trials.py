"""Which other models of a machine are compared with the scene as written, one change at a time:
elasticity and interfaces of bodies, their modes and meshes, the pose along a path.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from headstock.geometry.parts.components import Component, Fidelity
from headstock.geometry.parts.solids import MeshFile, PointMass, SuperelementFile
from headstock.meshing.components.meshing import automatic_size
from headstock.pipeline.planning.plan import Plan
from headstock.scene.analyses.path import PathRequest
from headstock.scene.reading.keys import write_size
from headstock.scene.scene import Scene

ModelKind = Literal["elasticity", "interfaces", "modes", "mesh", "pose", "several"]
MODEL_KINDS: tuple[ModelKind, ...] = ("elasticity", "interfaces", "modes", "mesh", "pose")
# what is tried leaves something out of what is written, adds to it, or is neither
Sense = Literal["simpler", "richer", "other"]
FINER = 0.7  # times the mesh size: nearly three times the elements; coarser is one over it
SHAPES = 12  # deformation shapes of a flexible interface
RICHNESS: tuple[Fidelity, ...] = ("rigid", "segmented", "polynomial", "elastic")
# fields of components that are tried together
SAME = ("solid", "material", "interfaces", "mass", "fidelity", "mesh", "reduction", "segments")


@dataclass(frozen=True)
class ModelTrial:
    """One change of the model.

    Attributes:
        bodies: Of which components, equal ones together; empty for the whole machine.
        written: What the scene has.
        settings: ``key=value`` overrides that make it so.
        sense: Whether it leaves something out.
    """

    kind: ModelKind
    bodies: tuple[str, ...]
    written: str
    tried: str
    settings: tuple[str, ...]
    sense: Sense

    @property
    def subject(self) -> str:
        """The changed part in words."""
        names = ", ".join(self.bodies)
        return {
            "elasticity": names,
            "interfaces": f"interfaces of {names}",
            "modes": f"modes of {names}",
            "mesh": f"mesh of {names}",
            "pose": "pose along the path",
            "several": "all of it",
        }[self.kind]

    @property
    def name(self) -> str:
        """The change in words."""
        return f"{self.subject}: {self.tried} in place of {self.written}"


def list_model_trials(
    scene: Scene, plan: Plan, kinds: Sequence[ModelKind] = MODEL_KINDS
) -> list[ModelTrial]:
    """Changes of the model of a scene, in the order of its components.

    Args:
        plan: Its plan, which knows the modes that are kept where the scene says nothing.
        kinds: What may be changed.

    Returns:
        None of a lumped mechanism, whose bodies do not deform, and of a scene with an ``accuracy``,
        which chooses all of this itself.

    Raises:
        MeshError: A STEP file whose mesh has no size cannot be read.
    """
    if scene.accuracy is not None:
        return []
    trials: list[ModelTrial] = []
    if not scene.is_lumped:
        for names in _group_equals(scene):
            part = scene.machine.components[names[0]]
            trials += _vary_elasticity(part, names)
            if part.fidelity == "elastic":
                trials += _vary_interfaces(part, names)
                trials += _vary_modes(part, plan.components[part.name], names)
                trials += _vary_mesh(part, names) if "mesh" in kinds else []
    trials += _vary_pose(scene)
    return [trial for trial in trials if trial.kind in kinds]


def _group_equals(scene: Scene) -> list[tuple[str, ...]]:
    groups: list[tuple[str, ...]] = []
    for name, part in scene.machine.components.items():
        if isinstance(part.solid, SuperelementFile | PointMass):
            continue
        for index, group in enumerate(groups):
            if are_alike(scene.machine.components[group[0]], part):
                groups[index] = (*group, name)
                break
        else:
            groups.append((name,))
    return groups


def are_alike(first: Component, second: Component) -> bool:
    """Tell whether two components are one model at two places."""
    return all(getattr(first, field) == getattr(second, field) for field in SAME)


def _set(names: Sequence[str], key: str, value: str) -> tuple[str, ...]:
    return tuple(f"components.{name}.{key}={value}" for name in names)


def _vary_elasticity(part: Component, names: tuple[str, ...]) -> Iterator[ModelTrial]:
    """Every other fidelity; of a rigid body the finite elements alone, which show what it leaves
    out.
    """
    written = RICHNESS.index(part.fidelity)
    for richness, fidelity in enumerate(RICHNESS):
        if richness != written and (part.fidelity != "rigid" or fidelity == "elastic"):
            yield ModelTrial(
                "elasticity",
                names,
                part.fidelity,
                fidelity,
                _set(names, "fidelity", f'"{fidelity}"'),
                "simpler" if richness < written else "richer",
            )


def _vary_interfaces(part: Component, names: tuple[str, ...]) -> Iterator[ModelTrial]:
    """All interfaces but rails of one kind; those that are so already stay."""
    fixed = {
        name: interface for name, interface in part.interfaces.items() if interface.rail is None
    }
    words = {
        name: f"flexible ({interface.flexible})" if interface.flexible else interface.coupling
        for name, interface in fixed.items()
    }
    kinds = {
        "rigid": '"rigid"',
        "average": '"average"',
        f"flexible ({SHAPES})": f"{{ flexible = {SHAPES} }}",
    }
    for kind, value in kinds.items():
        others = [name for name, word in words.items() if word.split()[0] != kind.split()[0]]
        if others:
            yield ModelTrial(
                "interfaces",
                names,
                " and ".join(dict.fromkeys(words[name] for name in others)),
                kind,
                tuple(
                    setting
                    for name in others
                    for setting in _set(names, f"interfaces.{name}.coupling", value)
                ),
                _compare_kinds([words[name] for name in others], kind),
            )


def _compare_kinds(written: Iterable[str], tried: str) -> Sense:
    """Deformation shapes are added to rigid motions; a rigid and an averaging interface are two
    bounds.
    """
    if tried.startswith("flexible"):
        return "richer"
    return "simpler" if any(word.startswith("flexible") for word in written) else "other"


def _vary_modes(
    part: Component, planned: Component, names: tuple[str, ...]
) -> Iterator[ModelTrial]:
    """Modes up to half and double the frequency, or half and double their number."""
    kept = planned.reduction
    for factor, sense in ((0.5, "simpler"), (2.0, "richer")):
        richer: Sense = "richer" if sense == "richer" else "simpler"
        if part.reduction.modes is None and kept.modes_to_hz is not None:
            hz = kept.modes_to_hz
            settings = _set(names, "reduction.modes_to", f'"{factor * hz:g} Hz"')
            written, tried = f"up to {hz:g} Hz", f"up to {factor * hz:g} Hz"
        elif kept.modes:
            count = int(factor * kept.modes)
            settings = _set(names, "reduction.modes", str(count))
            written, tried = str(kept.modes), str(count)
        else:
            return
        yield ModelTrial("modes", names, written, tried, settings, richer)


def _vary_mesh(part: Component, names: tuple[str, ...]) -> Iterator[ModelTrial]:
    """One step coarser and one step finer; elements at rims follow."""
    if isinstance(part.solid, MeshFile):
        return
    size, rim = part.mesh.size or automatic_size(part), part.mesh.rim_size
    steps: tuple[tuple[float, Sense], ...] = ((1.0 / FINER, "simpler"), (FINER, "richer"))
    for factor, sense in steps:
        other = write_size(factor * size)
        settings = _set(names, "mesh.size", f'"{other}"')
        if rim is not None:
            settings += _set(names, "mesh.rim_size", f'"{write_size(factor * rim)}"')
        yield ModelTrial("mesh", names, write_size(size), other, settings, sense)


def _vary_pose(scene: Scene) -> Iterator[ModelTrial]:
    request = scene.analyses.get(PathRequest)
    if request is None or scene.is_lumped:
        return
    written, tried = ("pose_dependent", "frozen")
    if not request.follows_pose:
        written, tried = tried, written
    yield ModelTrial(
        "pose",
        (),
        written,
        tried,
        (f'analyses.path.pose_model="{tried}"',),
        "simpler" if tried == "frozen" else "richer",
    )

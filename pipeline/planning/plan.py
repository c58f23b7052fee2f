"""Stages of a run: what is planned, why, and what then took place."""

from dataclasses import dataclass
from typing import Literal

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Pose
from headstock.geometry.parts.components import Component

StageKind = Literal[
    "mesh",
    "reduce",
    "refine",
    "rigid",
    "segment",
    "expand",
    "load",
    "couple",
    "static",
    "recover",
    "modal",
    "spread",
    "models",
    "joints",
    "frf",
    "path",
    "control",
    "volumetric",
    "lobes",
    "respond",
    "place",
    "map",
    "contour",
    "write",
]


@dataclass(frozen=True)
class Stage:
    """One step of a run.

    Attributes:
        kind: ``mesh`` and ``reduce`` an elastic component, ``refine`` its settings for an accuracy,
            make a ``rigid`` one from its mass properties, ``segment`` one into a row of rigid
            bodies, ``expand`` its displacements in polynomials, ``load`` an imported superelement, ``couple`` the machine in a pose, ``place`` a
            lumped mechanism in one, ``map`` it over many, ``contour`` a block with it, ``static``
            analysis, ``recover`` the response at probes, ``modal`` analysis, ``spread`` of its
            frequencies with the kind of interfaces, ``models``: what rigid and segmented bodies
            leave out, ``joints``: what rigid ones do, ``frf`` frequency response, ``path``
            deviation from a line, ``control`` closed loops of drives, ``volumetric`` errors of the
            tool over many poses, ``lobes`` limit depths of cut, ``respond`` to loads over time,
            ``write`` the results.
        component: The component it works on; None for the machine.
        reason: Why the scene calls for it, in plain words.
        pose: The pose it works in; None for components.
        estimated_dofs: Degrees of freedom it will meet; None where nothing can be said beforehand.
        estimated_memory_mb: Peak memory [MB].
        estimated_seconds: Processor time, right within a factor of about two [s].
        kernels: Number of kernels of finite elements that it compiles first; the time counts them.
    """

    kind: StageKind
    component: str | None
    reason: str
    pose: str | None = None
    estimated_dofs: int | None = None
    estimated_memory_mb: float | None = None
    estimated_seconds: float | None = None
    kernels: int = 0


@dataclass(frozen=True, eq=False)
class Plan:
    """What a scene calls for.

    Attributes:
        stages: In the order in which they run.
        components: By name, with the reduction settings the plan decided on.
        poses: The poses the stages name.
        with_modes: A dynamic analysis asks for mass and fixed-interface modes.
        gravity: ``(3,)`` acceleration in machine axes [m/s^2] when the effect is named, else None.
        warnings: What the plan itself gives reason to warn of.
    """

    stages: tuple[Stage, ...]
    components: dict[str, Component]
    poses: dict[str, Pose]
    with_modes: bool
    gravity: FloatArray | None = None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class StageRecord:
    """A stage that took place.

    Attributes:
        stage: As planned.
        seconds: Wall-clock time [s].
        cached: Its result came from the store.
        peak_rss_mb: Peak resident memory while it ran, of rank 0 or of the child process it started
            [MB].
        detail: What came out, in a few words, for the console.
        cpu_seconds: Processor time of all threads and of children that have ended [s].
    """

    stage: Stage
    seconds: float
    cached: bool
    peak_rss_mb: float
    detail: str = ""
    cpu_seconds: float = 0.0

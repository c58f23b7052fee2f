"""Stages of a run: what is planned, why, and what then took place."""

from dataclasses import dataclass

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Pose
from headstock.geometry.parts.components import Component


@dataclass(frozen=True)
class Stage:
    """One step of a run.

    Attributes:
        kind: Of a component: ``mesh`` and ``reduce``, ``rigid``, ``segment``, ``expand`` (polynomials)
            or ``load``, and ``refine``, its settings for an accuracy. Of the machine: ``couple`` or
            ``place`` in a pose, those of ``analyses.RECORDS``, ``spread``, ``models`` and ``joints`` for
            the ± of modelling choices, and ``write``.
        component: The component it works on; None for the machine.
        reason: Why the scene calls for it, in plain words.
        pose: The pose it works in; None for components.
        estimated_dofs: Degrees of freedom it will meet; None where nothing can be said beforehand.
        estimated_memory_mb: Peak memory [MB].
        estimated_seconds: Processor time, right within a factor of about two [s].
        kernels: Number of kernels of finite elements that it compiles first; the time counts them.
    """

    kind: str
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

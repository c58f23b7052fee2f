"""What fillets, holes and pins of STEP parts matter: a mesh with and without them."""

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from headstock.geometry.parts.components import Component
from headstock.geometry.parts.solids import StepFile
from headstock.meshing.components.survey import survey_step
from headstock.scene.reading.files import TomlValue
from headstock.scene.reading.keys import write_size
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root
from headstock.studies.parameters.convergence import (
    Convergence,
    ConvergenceGoal,
    watch_numbers,
)
from headstock.studies.parameters.limits import Limit, MeshedNumber, MeshNeed
from headstock.studies.parameters.records import StudyRecord
from headstock.studies.parameters.runs import StudyJob, StudyProgress, run_study

FAMILY = "without features"
DETAIL_SHARE = 0.1  # of a part's longest side: a larger radius is no detail
MOST_RADII = 4
HARMLESS = 0.5  # of the accuracy asked for: what changes numbers by less does not matter
NOTHING_LEFT_OUT = "could be left out"  # of what a run says where the CAD kernel fails


@dataclass(frozen=True, eq=False)
class FeatureTrial:
    """A mesh without features up to a radius, beside the same with them.

    Attributes:
        radius: Largest radius that was left out [m].
        change: Largest relative change of a number, the errors of both meshes taken off.
        matters: The change is more than half of the accuracy asked for.
    """

    radius: float
    change: float
    decisive: str
    dofs: int
    dofs_with: int
    matters: bool


@dataclass(frozen=True, eq=False)
class MeshAdvice:
    """How fine a scene must be meshed.

    Attributes:
        found: What meshes of all sizes say.
        needs: The mesh that each of some accuracies takes; the one that was asked for first.
        trials: What became of numbers without small features.
    """

    found: Convergence
    needs: tuple[MeshNeed, ...]
    trials: tuple[FeatureTrial, ...] = ()


@dataclass(frozen=True, eq=False)
class _Trials:
    """What is to be tried: radii from large to small [m], the settings and the record of the mesh
    to compare with, and the components that have features.
    """

    radii: tuple[float, ...]
    settings: dict[str, TomlValue]
    record: StudyRecord
    parts: tuple[str, ...]


def try_features(
    job: StudyJob,
    found: Convergence | None,
    goal: ConvergenceGoal,
    folder: Path,
    *,
    comm: MPI.Comm,
    observer: Callable[[StudyProgress], None] = lambda progress: None,
) -> list[FeatureTrial]:
    """Leave out features from large to small radii until numbers stay as they are; collective.

    Args:
        found: What the meshes say, on rank 0.
        folder: Holds ``points.jsonl``.
        comm: Ranks that compute together.
        observer: Called with each mesh on rank 0.

    Returns:
        What was tried, on rank 0; nothing where no part has such features or no limit is known.
    """
    planned = make_on_root(comm, lambda: None if found is None else _plan_trials(found))
    trials: list[FeatureTrial] = []
    if planned is None:
        return trials
    for radius in planned.radii:
        (family,) = job.study.families
        family = dataclasses.replace(
            family,
            name=FAMILY,
            settings=planned.settings,
            vary={
                f"components.{name}.mesh.leave_out": (write_size(radius),) for name in planned.parts
            },
            pairwise=True,
        )
        study = dataclasses.replace(job.study, families=(family,))
        records = run_study(
            dataclasses.replace(job, study=study),
            folder,
            comm=comm,
            observer=observer,
            warm_up=False,
        )

        def compare(
            records: list[StudyRecord] = records, radius: float = radius
        ) -> FeatureTrial | None:
            if found is None or records[0].status == "failed":
                return None
            return _compare(found, planned.record, records[0], radius, goal.accuracy)

        trial = make_on_root(comm, compare)
        trials += [] if trial is None else [trial]
        if trial is not None and not trial.matters:
            break
    return trials


def _plan_trials(found: Convergence) -> _Trials | None:
    """The radii, and the finest mesh but one: its errors are known, and it costs a third."""
    parts = {
        name: part
        for name, part in found.series.parts.items()
        if isinstance(part.solid, StepFile) and part.mesh.leave_out is None
    }
    converges = any(limit.order is not None for limit in found.limits)
    if not parts or not converges:
        return None
    index = max(0, len(found.records) - 2)
    return _Trials(
        _find_radii(parts),
        found.series.settings(found.costs.factors[index]),
        found.records[index],
        tuple(parts),
    )


def _find_radii(parts: Mapping[str, Component]) -> tuple[float, ...]:
    """Radii of round faces that may be details, a few of them from large to small [m]."""
    radii: set[float] = set()
    for part in parts.values():
        if isinstance(part.solid, StepFile):
            survey = survey_step(part.solid)
            most = DETAIL_SHARE * max(survey.size)
            radii |= {
                float(f"{face.radius:.3g}") for face in survey.faces if 0.0 < face.radius <= most
            }
    ordered = sorted(radii, reverse=True)
    step = max(1, -(-(len(ordered) - 1) // (MOST_RADII - 1)))
    return tuple(dict.fromkeys([*ordered[::step], *ordered[-1:]]))


def _compare(
    found: Convergence, base: StudyRecord, record: StudyRecord, radius: float, accuracy: float
) -> FeatureTrial | None:
    """A mesh without features beside the same with them; None where nothing could be left out."""
    if record.summary is None or base.summary is None:
        return None
    if any(NOTHING_LEFT_OUT in warning for warning in record.summary["warnings"]):
        return None
    slopes = {
        each.name: _error_slope(each, limit)
        for each, limit in zip(found.watched, found.limits, strict=True)
        if limit.order is not None
    }
    changes = {
        each.name: change
        for each in watch_numbers([record, base])
        if each.name in slopes and (change := _change(each, slopes[each.name])) is not None
    }
    if not changes:
        return None
    worst = max(changes, key=lambda name: changes[name])
    return FeatureTrial(
        radius,
        changes[worst],
        worst,
        record.summary["totals"]["full_dofs"],
        base.summary["totals"]["full_dofs"],
        changes[worst] > HARMLESS * accuracy,
    )


def _error_slope(series: MeshedNumber, limit: Limit) -> float:
    """True error of the finest mesh over its estimate; 0 where there is none."""
    value, error = series.values[-1], series.mesh_errors[-1]
    return 0.0 if value is None or not error else (value - limit.value) / error


def _change(series: MeshedNumber, slope: float) -> float | None:
    """Relative difference of the first mesh from the second, errors taken off by their
    estimates.
    """
    limits = [
        None if value is None else value - slope * (error or 0.0)
        for value, error in zip(series.values, series.mesh_errors, strict=True)
    ]
    without, whole = limits
    return None if without is None or not whole else abs(without / whole - 1.0)

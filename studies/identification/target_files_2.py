"""Reads a target file: what was measured, and which numbers of the scene may be fitted; or says everything that is wrong."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from headstock.pipeline.planning.planner import is_lumped
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.files import read_scene
from headstock.scene.reading.findings import Findings, suggest_names
from headstock.scene.scene import Scene
from headstock.scene.schema.overrides import split_variant
from headstock.scene.schema.validation import validate_against
from headstock.studies.identification.parameters import read_parameters
from headstock.studies.identification.schema import CaseTable, TargetsTable
from headstock.studies.identification.target_files import read_case
from headstock.studies.identification.targets import FitSettings, IdentificationTask, Parameter, TargetCase


@dataclass(frozen=True, eq=False)
class LoadedTask:
    """A checked target file.

    Attributes:
        task: What is asked for.
        scenes: The scene in each of the variants the file names.
        findings: Lines of the file, for what only the built scene can tell.
    """

    task: IdentificationTask
    scenes: Mapping[str | None, Scene]
    findings: Findings


def load_targets(path: Path, scene: Path, *, overrides: Sequence[str] = ()) -> LoadedTask:
    """Load a target file for a scene.

    Args:
        path: Target file (``.toml``).
        scene: Scene file.
        overrides: ``key=value`` settings of the scene.

    Raises:
        SceneError: Anything is wrong with either file; holds every problem with file, line, key and what to write.
    """
    findings = Findings(str(path))
    table = validate_against(TargetsTable, read_scene(path, findings), findings)
    written = load_scene(scene, overrides=overrides)
    _check_kind(written, findings)
    if table is None:
        findings.raise_if_any()
        raise AssertionError("the schema refused a target file without saying why")
    scenes: dict[str | None, Scene] = {}
    for name, entry in table.cases.items():
        _load_variant(name, entry, written, overrides, scenes, findings)
    cases = [
        read_case(name, entry, scenes[entry.variant], table.fit, findings)
        for name, entry in table.cases.items()
        if entry.variant in scenes
    ]
    parameters = read_parameters(table, scenes or {None: written}, findings)
    _check_amount(cases, parameters, findings)
    findings.raise_if_any()
    fit = table.fit
    settings = FitSettings(fit.starts, fit.seed, fit.pairing, fit.noise, fit.method, fit.evaluations)
    return LoadedTask(IdentificationTask(table.name or path.stem, tuple(cases), parameters, settings), scenes, findings)


def _check_kind(scene: Scene, findings: Findings) -> None:
    """Refuse scenes whose parts are not placed by their own keys alone."""
    if "orientation" in scene.raw:
        findings.add_line(
            None, f"{scene.path} sets the machine up with [orientation]; take it out for the fit, it changes no frequency"
        )


def _load_variant(
    name: str, entry: CaseTable, written: Scene, overrides: Sequence[str], scenes: dict[str | None, Scene], findings: Findings
) -> None:
    if entry.variant in scenes:
        return
    unknown = [part for part in split_variant(entry.variant) if part not in written.variants]
    for part in unknown:
        text = f"unknown variant {part[:80]!r}; {suggest_names(part, written.variants, what='variants')}"
        findings.add(("cases", name, "variant"), text)
    if not unknown:
        scene = written if entry.variant is None else load_scene(written.path, variant=entry.variant, overrides=overrides)
        if is_lumped(scene):
            key = ("cases", name) if entry.variant is None else ("cases", name, "variant")
            findings.add(key, 'is a lumped mechanism, which has no joints to fit; name a variant with model = "components"')
        scenes[entry.variant] = scene


def _check_amount(cases: Sequence[TargetCase], parameters: Sequence[Parameter], findings: Findings) -> None:
    """Refuse more free parameters than there is data."""
    if findings.problems:
        return
    data = sum(not held for case in cases for held in case.held_out)
    free = [parameter for parameter in parameters if parameter.prior is None]
    if data == 0:
        findings.add(("cases",), "every target is held out, so there is nothing to fit to; keep some")
    elif data < len(free):
        findings.add(
            ("parameters",),
            f"{data} target(s) cannot fix {len(free)} parameters without a prior; add targets, fix some parameters, or give them "
            "prior and prior_sigma",
        )

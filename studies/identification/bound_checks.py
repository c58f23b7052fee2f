"""Whether a scene can be built with every parameter at its start and at either of its bounds."""

from headstock.scene.reading.findings import Findings
from headstock.scene.reading.keys import write_number
from headstock.studies.identification.identification_problem import FitProblem
from headstock.studies.identification.parametric_scene import ParameterValueError
from headstock.studies.identification.parametric_scene_2 import ParametricScene
from headstock.studies.identification.targets import Parameter


def check_bounds(problem: FitProblem, findings: Findings) -> None:
    """Refuse bounds at which a component cannot be built, the other parameters at their starts.

    Args:
        problem: Prepared.
        findings: Of the target file.

    Raises:
        SceneError: At least one bound, or the starts, cannot be built.
    """
    scenes = list({id(model.parametric): model.parametric for model in problem.cases}.values())
    starts = {parameter.name: parameter.start for parameter in problem.parameters}
    if reason := _find_reason(scenes, starts):
        findings.add(("parameters",), f"the scene cannot be built with every parameter at its start: {reason}")
        findings.raise_if_any()
    for parameter in problem.parameters:
        for index, (what, bound) in enumerate((("lower", parameter.lower), ("upper", parameter.upper))):
            touched = [scene for scene in scenes if _touches(scene, parameter)]
            if reason := _find_reason(touched, {**starts, parameter.name: bound}):
                shown = write_number(bound, parameter.unit, 6)
                text = f"at its {what} bound {shown} the scene cannot be built: {reason}; narrow the bounds, or let what is in the way follow"
                findings.add(("parameters", parameter.name, "bounds", index), text)
    findings.raise_if_any()


def _touches(scene: ParametricScene, parameter: Parameter) -> bool:
    touched = scene.touched[parameter.name]
    return bool(touched.components or touched.joints)


def _find_reason(scenes: list[ParametricScene], values: dict[str, float]) -> str:
    for scene in scenes:
        try:
            scene.build(values)
        except ParameterValueError as error:
            return str(error)
    return ""

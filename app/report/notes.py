"""Remarks on the accuracy of the numbers in a report, in plain words."""

from dataclasses import dataclass

from headstock.app.texts.bounded_values import accuracy_words, model_words
from headstock.pipeline.answers.accuracy import AccuracyAnswer, ModelErrorsAnswer
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.answers.static import StaticAnswer
from headstock.pipeline.results.results import Results


@dataclass(frozen=True)
class Note:
    """A remark: about what, and what is to be said."""

    subject: str
    text: str


NAMES_OF_MODES = Note(
    "Names of modes",
    "X, Y, Z are translations and A, B, C rotations about the machine axes; a component is said to bend or twist when it holds"
    " a good part of the strain energy. Below the first structural mode the machine moves as a whole on its supports.",
)


def list_notes(run: Results) -> list[Note]:
    """Return notes on what a run found, and only on that."""
    notes = []
    for accuracy in run.find(AccuracyAnswer)[-1:]:
        words = ". ".join(accuracy_words(accuracy, run.find(PoseResponse))) + "."
        notes.append(Note("Accuracy", words))
    for models in run.find(ModelErrorsAnswer)[-1:]:
        words = f"Rigid and segmented bodies compared with elastic ones: {model_words(models)}."
        notes.append(Note("Models of bodies", words))
    if run.static:
        notes.append(_describe_compliance(run))
    if run.modal:
        notes += [_describe_frequencies(run), NAMES_OF_MODES]
    if run.frf:
        notes.append(_describe_response(run))
    if run.static:
        notes.append(
            Note(
                "Budget",
                "Shares of the strain energy under a force in that direction at the point; they add up to the whole. A part with a"
                " large share is the weak link: stiffening it pays most.",
            )
        )
    if names := _name_components(run, "rigid"):
        notes.append(
            Note(
                "Rigid components",
                f"{names}: modelled without deformation. The real machine is more compliant by their deformation.",
            )
        )
    if names := _name_components(run, "segmented"):
        notes.append(
            Note(
                "Segmented components",
                f"{names}: beams on plane sections. Bars that are short or wide for their length are stiffer in torsion than that,"
                " and softer where a joint holds only a part of their section: compare with fidelity elastic.",
            )
        )
    notes.append(
        Note(
            "Joint stiffness",
            "Taken from the scene as written: no result is better than these values.",
        )
    )
    if run.provenance is not None and run.provenance.accepted_defaults:
        accepted = "; ".join(run.provenance.accepted_defaults)
        notes.append(Note("Open values", f"Not decided, computed with their defaults: {accepted}."))
    if run.assumptions:
        notes.append(Note("From the catalogue", "; ".join(run.assumptions) + "."))
    return notes


def _name_components(run: Results, fidelity: str) -> str:
    return ", ".join(name for name, facts in run.components.items() if facts.fidelity == fidelity)


def _describe_compliance(run: Results) -> Note:
    text = "Reduction adds no error to the static compliance: the response to forces at interfaces is that of the finite element model. "
    first = run.find(StaticAnswer)[0]
    if any(
        error.total is not None
        for point in first.points
        for error in first.list_errors(point).values()
    ):
        text += (
            f"{_describe_meshes(run, 'underestimate it by about the ± value')}. It is estimated by comparing computed with"
            " smoothed stresses (Zienkiewicz-Zhu) and covers the error in 95 % of cases."
        )
    elif _name_components(run, "elastic"):
        text += "An error estimate for the mesh was not made; run again with a smaller mesh size and compare."
    return Note("Compliance", text.strip())


def _describe_meshes(run: Results, uncorrected: str) -> str:
    meshed = {
        name: facts.corrected
        for name, facts in run.components.items()
        if facts.fidelity == "elastic"
    }
    if not any(meshed.values()):
        return f"Finite meshes {uncorrected}"
    left = "What meshes miss is taken out by its estimate: the ± of what is left has either sign"
    plain = [name for name, corrected in meshed.items() if not corrected]
    return f"{left}; those of {', '.join(plain)} {uncorrected}" if plain else left


def _describe_frequencies(run: Results) -> Note:
    errors = [error for modes in run.modal for error in modes.list_errors()]
    if any(error.total is not None for error in errors):
        return Note(
            "Natural frequencies",
            "The column “± Hz” covers the error of each frequency in 95 % of cases; the line below the table names its sources."
            f" The reduction makes frequencies too high, not too low. {_describe_meshes(run, 'make them too high, too')}."
            " These modes are undamped.",
        )
    if any(error.known for error in errors):
        return Note(
            "Natural frequencies",
            "No error is known from every source: the column “± Hz” holds what is known, and + ? stands for the sources"
            " that the lines below the table name. These modes are undamped.",
        )
    return Note(
        "Natural frequencies",
        "Their error was not estimated in this run. Mesh and reduction as a rule make them come out too high: run again"
        " with a smaller mesh size and a higher modes_to and see by how much they fall. Damping is not part of these modes.",
    )


def _describe_response(run: Results) -> Note:
    text = (
        "All modes of the reduced machine are summed, so the curve equals the static compliance at 0 Hz. The height of peaks"
        " depends on the scene's damping, which is seldom known to better than a factor of two. "
    )
    if not all(response.damped for response in run.find(PoseResponse)):
        text += "This machine is undamped: peaks are unbounded. "
    text += (
        "Structural damping acts as a loss factor at every frequency above 0 Hz; where damping ratios of modes are given, a mode's loss"
        " factor counts as twice its damping ratio."
    )
    return Note("Frequency response", text)

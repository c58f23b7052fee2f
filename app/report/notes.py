"""Remarks on the accuracy of the numbers in a report, in plain words."""

from dataclasses import dataclass

from headstock.app.texts.bounded_values import accuracy_words, model_words
from headstock.pipeline.numbers.estimates import known_part
from headstock.pipeline.results.summary import RunSummary


@dataclass(frozen=True)
class Note:
    """A judgement: about what, and what is to be said."""

    subject: str
    text: str


def judge_numbers(summary: RunSummary) -> list[Note]:
    """Notes on the results that a summary holds, and only on those."""
    fidelities = {facts["fidelity"] for facts in summary["components"].values()}
    notes = []
    if "accuracy" in summary:
        notes.append(
            Note(
                "Accuracy", ". ".join(accuracy_words(summary["accuracy"], summary.get("frf"))) + "."
            )
        )
    if "model_errors" in summary:
        words = f"Rigid and segmented bodies compared with elastic ones: {model_words(summary['model_errors'])}."
        notes.append(Note("Models of bodies", words))
    if summary["static"]:
        notes.append(_judge_compliance(summary))
    if summary["modal"]:
        notes += [_judge_frequencies(summary), _judge_names()]
    if summary.get("frf"):
        notes.append(_judge_response(summary))
    if summary["static"]:
        notes.append(
            Note(
                "Budget",
                "Shares of the strain energy under a force in that direction at the point; they add up to the whole. A part with a"
                " large share is the weak link: stiffening it pays most.",
            )
        )
    if "rigid" in fidelities:
        names = ", ".join(
            name for name, facts in summary["components"].items() if facts["fidelity"] == "rigid"
        )
        notes.append(
            Note(
                "Rigid components",
                f"{names}: modelled without deformation. The real machine is more compliant by their deformation.",
            )
        )
    if "segmented" in fidelities:
        names = ", ".join(
            name
            for name, facts in summary["components"].items()
            if facts["fidelity"] == "segmented"
        )
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
    if assumed := summary.get("assumptions"):
        notes.append(Note("From the catalogue", "; ".join(assumed) + "."))
    return notes


def _judge_compliance(summary: RunSummary) -> Note:
    text = "Reduction adds no error to the static compliance: the response to forces at interfaces is that of the finite element model. "
    if any(
        error is not None
        for point in summary["static"].values()
        for error in point.get("error_um_per_kN", {}).values()
    ):
        text += (
            f"{_say_what_meshes_do(summary, 'underestimate it by about the ± value')}. It is estimated by comparing computed with"
            " smoothed stresses (Zienkiewicz-Zhu) and covers the error in 95 % of cases."
        )
    elif any(facts["fidelity"] == "elastic" for facts in summary["components"].values()):
        text += "An error estimate for the mesh was not made; run again with a smaller mesh size and compare."
    return Note("Compliance", text.strip())


def _say_what_meshes_do(summary: RunSummary, uncorrected: str) -> str:
    meshed = {
        name: facts.get("mesh_corrected", False)
        for name, facts in summary["components"].items()
        if facts["fidelity"] == "elastic"
    }
    if not any(meshed.values()):
        return f"Finite meshes {uncorrected}"
    left = "What meshes miss is taken out by its estimate: the ± of what is left has either sign"
    plain = [name for name, corrected in meshed.items() if not corrected]
    return f"{left}; those of {', '.join(plain)} {uncorrected}" if plain else left


def _judge_frequencies(summary: RunSummary) -> Note:
    if any(error is not None for modes in summary["modal"] for error in modes["error_hz"]):
        return Note(
            "Natural frequencies",
            "The column “± Hz” covers the error of each frequency in 95 % of cases; the line below the table names its sources."
            f" The reduction makes frequencies too high, not too low. {_say_what_meshes_do(summary, 'make them too high, too')}."
            " These modes are undamped.",
        )
    if any(known_part(share) for modes in summary["modal"] for share in modes["error_share"]):
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


def _judge_response(summary: RunSummary) -> Note:
    text = (
        "All modes of the reduced machine are summed, so the curve equals the static compliance at 0 Hz. The height of peaks"
        " depends on the scene's damping, which is seldom known to better than a factor of two. "
    )
    if any(not response["damped"] for response in summary["frf"].values()):
        text += "This machine is undamped: peaks are unbounded. "
    text += (
        "Structural damping acts as a loss factor at every frequency above 0 Hz; where damping ratios of modes are given, a mode's loss"
        " factor counts as twice its damping ratio."
    )
    return Note("Frequency response", text)


def _judge_names() -> Note:
    return Note(
        "Names of modes",
        "X, Y, Z are translations and A, B, C rotations about the machine axes; a component is said to bend or twist when it holds"
        " a good part of the strain energy.",
    )

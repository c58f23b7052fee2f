"""Table 3, the measured shapes and figures 17 and 18 of Kono et al. by the calibrated three-axis
machine.
"""

import dataclasses
from collections.abc import Iterator, Mapping

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.static import UM_PER_KN
from headstock.solvers.mpi import MPI
from headstock.solvers.pairing.mode_pairing import ModePair, ModeSet, match_frequencies, pair_modes
from headstock.validation.machines.axis_kit_models import (
    LISTED_TO_HZ,
    MEASURED_COMPLIANCE,
    MEASURED_MODES,
    MODE_9,
    TABLE_3,
    TABLE_3_FEM,
    VARIANTS,
    KitFidelity,
    KitModel,
    KitWorkshop,
    MeasuredMode,
)
from headstock.validation.references.rows import (
    SHOWN_ONLY,
    Target,
    ValidationRow,
    compare_bound,
    compare_value,
    show,
    verdict,
)

CASE = "axis-construction-kit"
FIDELITIES: tuple[KitFidelity, ...] = ("segmented", "elastic")
WORDS = {"segmented": "segmented", "elastic": "FE"}
TABLE_TOLERANCE, COMPLIANCE_TOLERANCE, FIDELITY_TOLERANCE, FEM_TOLERANCE = 0.03, 0.05, 0.05, 0.08
MOST_EXTRA = 2
SIMILAR_MAC = 0.9
DIRECTIONS = "XYZABC"

KitModels = Mapping[tuple[str, KitFidelity], KitModel]


def check_axis_kit(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """Check everything the paper prints of its machine, for five variants at two fidelities with
    one set of parameters.
    """
    workshop = KitWorkshop(comm)
    models = {
        (variant, fidelity): workshop.solve(variant, fidelity)
        for fidelity in FIDELITIES
        for variant in VARIANTS
    }
    yield from evaluate_table_3({variant: models[variant, "segmented"] for variant in TABLE_3})
    yield from evaluate_fidelities(models)
    yield from show_shapes(models["YCE", "segmented"])
    yield from evaluate_compliances(models)
    yield from show_statements(models)


def match_table_3(variant: str, model: KitModel) -> tuple[int, ...]:
    """Index of the mode that meets each listed one of a variant; measured mode 9 moves the Y-slider
    along Y.
    """
    penalty = np.zeros((len(TABLE_3[variant]), len(model.frequencies_hz)))
    if variant in MODE_9:
        along = np.abs(model.motions["y_slider"][:3])
        penalty[MODE_9[variant] - 1, np.argmax(along, axis=0) != 1] = 1.0
    return match_frequencies(np.log(model.frequencies_hz), np.log(TABLE_3[variant]), costs=penalty)


def evaluate_table_3(models: Mapping[str, KitModel]) -> Iterator[ValidationRow]:
    """Compare the 22 frequencies of the paper's own rigid and segmented models, and the modes below
    300 Hz that it does not list.
    """
    for variant, model in models.items():
        listed = TABLE_3[variant]
        met = match_table_3(variant, model)
        for number, (index, right) in enumerate(zip(met, listed, strict=True), start=1):
            target = Target(right, "Hz", TABLE_TOLERANCE, "published")
            yield compare_value(
                f"{variant} segmented: f{number}", model.frequencies_hz[index], target
            )
        extra = [
            f
            for index, f in enumerate(model.frequencies_hz)
            if index not in met and f < LISTED_TO_HZ
        ]
        note = ", ".join(f"{f:.1f} Hz" for f in extra)
        yield compare_bound(
            f"{variant} segmented: modes below 300 Hz not listed",
            float(len(extra)),
            MOST_EXTRA,
            note,
        )


def evaluate_fidelities(models: KitModels) -> Iterator[ValidationRow]:
    """Finite elements against segments, mode by mode as MAC pairs them, and against the paper's
    finite elements; YE as predicted.
    """
    for variant in ("CE", "YE", "YCE"):
        coarse, fine = models[variant, "segmented"], models[variant, "elastic"]
        listed = (
            match_table_3(variant, coarse)
            if variant in TABLE_3
            else range(len(coarse.frequencies_hz))
        )
        partners = {pair.first: pair for pair in pair_fidelities(coarse, fine)}
        for number, index in enumerate(listed, start=1):
            if index not in partners or coarse.frequencies_hz[index] > LISTED_TO_HZ:
                continue
            pair = partners[index]
            target = Target(
                float(coarse.frequencies_hz[index]), "Hz", FIDELITY_TOLERANCE, "segmented"
            )
            note = f"MAC {pair.correlation:.2f}" + ("" if variant in TABLE_3 else ", predicted")
            yield compare_value(
                f"{variant} FE: f{number}", fine.frequencies_hz[pair.second], target, note
            )
    fine = models["YCE", "elastic"]
    met = match_frequencies(np.log(fine.frequencies_hz), np.log(TABLE_3_FEM))
    for number, (index, right) in enumerate(zip(met, TABLE_3_FEM, strict=True), 1):
        target = Target(right, "Hz", FEM_TOLERANCE, "published FEM")
        yield compare_value(
            f"YCE FE against the paper's FEM: f{number}", fine.frequencies_hz[index], target
        )


def pair_fidelities(coarse: KitModel, fine: KitModel) -> tuple[ModePair, ...]:
    """Modes of two models of one variant that are the same."""
    return pair_modes(
        ModeSet(coarse.frequencies_hz, coarse.field), ModeSet(fine.frequencies_hz, fine.field)
    )


def show_shapes(model: KitModel) -> Iterator[ValidationRow]:
    """Show the measured modes beside those of YCE that the paper pairs with them: how far off, and
    which described motions they make.
    """
    met = match_table_3("YCE", model)
    for mode in MEASURED_MODES:
        if mode.paired is None:
            continue
        index = met[mode.paired - 1]
        missing = find_missing_motions(
            mode, {name: motion[:, index] for name, motion in model.motions.items()}
        )
        note = f"{mode.words}: " + (
            "as described" if not missing else "not seen: " + ", ".join(missing)
        )
        target = Target(mode.frequency_hz, "Hz", float("nan"), SHOWN_ONLY)
        yield compare_value(
            f"measured mode {mode.number}", model.frequencies_hz[index], target, note
        )


def find_missing_motions(mode: MeasuredMode, motions: Mapping[str, FloatArray]) -> list[str]:
    """Described motions that a mode does not make: the bodies move against each other, or in the
    wrong sense.
    """
    missing: list[str] = []
    senses: dict[str, float] = {}
    for motion in mode.motions:
        signs = {
            float(np.sign(motions[body][DIRECTIONS.index(motion.direction)]))
            for body in motion.bodies
        }
        sense = motion.sense * signs.pop() if len(signs) == 1 else 0.0
        if sense == 0.0 or senses.setdefault(motion.direction, sense) != sense:
            missing.append(f"{motion.direction} of {' + '.join(motion.bodies)}")
    return missing


def compliance_name(variant: str, fidelity: str, axis: str) -> str:
    """Return what the table calls a compliance.

    Args:
        axis: Direction of the force, ``x``, ``y`` or ``z``.
    """
    return f"{variant} {WORDS[fidelity]}: dz/F{axis}"


def evaluate_compliances(models: KitModels) -> Iterator[ValidationRow]:
    """Sizes of dz per force beside the measured ones; the fit's 151 um/kN is for YCE, everything
    else is predicted.
    """
    for fidelity in FIDELITIES:
        for variant in VARIANTS:
            for axis, value in zip("xyz", models[variant, fidelity].compliance, strict=True):
                fitted = variant == "YCE" and axis == "z"
                tolerance, kind = (
                    (COMPLIANCE_TOLERANCE, "measured") if fitted else (float("nan"), SHOWN_ONLY)
                )
                target = Target(MEASURED_COMPLIANCE[axis], "um/kN", tolerance, kind)
                yield compare_value(
                    compliance_name(variant, fidelity, axis), abs(UM_PER_KN * value), target
                )


def show_statements(models: KitModels) -> Iterator[ValidationRow]:
    """Show what the paper says of figures 17 and 18: confirmed or not."""
    deviations = {
        (fidelity, axis): np.array([abs(UM_PER_KN * models[v, fidelity].compliance["xyz".index(axis)]) for v in VARIANTS])
        / MEASURED_COMPLIANCE[axis] - 1.0
        for fidelity in FIDELITIES for axis in "xyz"
    }  # fmt: skip
    for fidelity in FIDELITIES:
        for axis in "xy":
            worst = float(np.abs(deviations[fidelity, axis]).max())
            yield _statement_row(
                f"{WORDS[fidelity]}: dz/F{axis} deviates by more than 50 %", worst, worst > 0.5
            )
        spread = {axis: float(np.ptp(deviations[fidelity, axis])) for axis in "xyz"}
        yield _statement_row(
            f"{WORDS[fidelity]}: variants differ by more than 100 % in dz/Fx",
            spread["x"],
            spread["x"] > 1.0,
        )
        yield from [
            _statement_row(
                f"{WORDS[fidelity]}: variants differ by less than 50 % in dz/F{axis}",
                spread[axis],
                spread[axis] < 0.5,
            )
            for axis in "yz"
        ]
    gap = {
        axis: np.abs(deviations["elastic", axis] - deviations["segmented", axis]) for axis in "xyz"
    }
    elastic = float(gap["x"][[VARIANTS.index("YE"), VARIANTS.index("YCE")]].min())
    yield _statement_row(
        "FE and segments differ by about 45 % in dz/Fx of YE and YCE",
        elastic,
        0.35 <= elastic <= 0.55,
    )
    others = max(float(gap["x"][:3].max()), float(gap["y"].max()), float(gap["z"].max()))
    yield _statement_row(
        "FE and segments differ by less than 15 % elsewhere", others, others < 0.15
    )
    yield evaluate_similar_modes(models)


def evaluate_similar_modes(models: KitModels) -> ValidationRow:
    """Check what section 4.2 says of the four variants besides YCE: frequencies and shapes by both
    fidelities are similar.

    Modes below 300 Hz, paired by shape; R and BE have no elastic body and agree of themselves.
    Similar: every mode has a partner, within ``FIDELITY_TOLERANCE`` in frequency and with a MAC of
    at least ``SIMILAR_MAC``.
    """
    worst, least, alone = 0.0, 1.0, []
    for variant in VARIANTS[:-1]:
        coarse, fine = models[variant, "segmented"], models[variant, "elastic"]
        partners = {pair.first: pair for pair in pair_fidelities(coarse, fine)}
        for index in np.flatnonzero(coarse.frequencies_hz < LISTED_TO_HZ):
            pair = partners.get(int(index))
            if pair is None:
                alone.append(f"{variant} {coarse.frequencies_hz[index]:.1f} Hz")
                continue
            worst = max(
                worst,
                abs(float(fine.frequencies_hz[pair.second] / coarse.frequencies_hz[index]) - 1.0),
            )
            least = min(least, pair.correlation)
    confirmed = not alone and worst < FIDELITY_TOLERANCE and least >= SIMILAR_MAC
    row = _statement_row(
        "modes of R, BE, CE and YE are similar with FE and segments", worst, confirmed
    )
    note = f"{row.note}: least MAC {least:.2f}" + (
        f", without a partner {', '.join(alone)}" if alone else ""
    )
    return dataclasses.replace(row, note=note)


def _statement_row(text: str, value: float, confirmed: bool) -> ValidationRow:
    return show(f"claim: {text}", 100.0 * value, "%", verdict(confirmed))

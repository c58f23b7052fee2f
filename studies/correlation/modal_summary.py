"""A fit of modes as ``modes.json`` has it."""

import math

from headstock.pipeline.storage.json_texts import JsonTable, JsonValue
from headstock.scene.test_data.responses import label_channel
from headstock.studies.correlation.modal_fit import ModalFit


def summarise_fit(fit: ModalFit, test: str) -> JsonTable:
    """Return the content of ``modes.json``: null for what is not known, complex numbers as pairs.

    Args:
        test: Name of the file.
    """
    modes, responses = fit.modes, fit.responses
    return {
        "test": test,
        "errors_from": fit.source,
        "scaled": modes.scaled,
        "channels": [label_channel(channel) for channel in modes.channels],
        "modes": [_summarise_mode(fit, number) for number in range(len(modes.frequencies_hz))],
        "band_hz": None
        if responses is None
        else [float(responses.frequencies_hz[0]), float(responses.frequencies_hz[-1])],
        "responses": None
        if responses is None or fit.assurance is None
        else {
            "motions": [label_channel(channel) for channel in responses.motions],
            "forces": [label_channel(channel) for channel in responses.forces],
            "frac": [[_known(value) for value in row] for row in fit.assurance],
        },
        "remarks": list(fit.remarks),
    }


def _summarise_mode(fit: ModalFit, number: int) -> JsonTable:
    shape: list[JsonValue] = [
        [float(value.real), float(value.imag)] for value in fit.modes.shapes[:, number]
    ]
    return {
        "frequency_hz": float(fit.modes.frequencies_hz[number]),
        "frequency_error_hz": _known(fit.frequency_errors[number]),
        "damping_ratio": _known(fit.modes.damping[number]),
        "damping_error": _known(fit.damping_errors[number]),
        "phase_collinearity": _known(fit.collinearity[number]),
        "mean_phase_rad": _known(fit.mean_phases[number]),
        "one_shape": _known(fit.one_shape[number]),
        "orders": int(fit.orders[number]),
        "shape": shape,
    }


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None

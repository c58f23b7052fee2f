"""A correlation as ``correlate.json`` has it, and a fit of modes as ``modes.json``."""

import dataclasses

from headstock.pipeline.storage.json_texts import JsonTable, nest_known
from headstock.scene.test_data.responses import label_channel
from headstock.studies.correlation.correlation import Correlation
from headstock.studies.correlation.modal_fit import ModalFit

FACTS = (
    *("scene", "variant", "pose", "test", "within", "range_hz"),
    *("verdict", "faults", "remarks", "warnings"),
)
# of a row of the table of modes
MODE_KEYS = (
    *("measured_hz", "measured_error_hz", "measured_damping", "number", "name", "computed_hz"),
    *("computed_error_hz", "computed_damping", "deviation", "mac", "cross_orthogonality"),
    *("phase_collinearity", "doubts"),
)


def summarise_correlation(found: Correlation) -> JsonTable:
    """Return the content of ``correlate.json``: modes as in the table, MAC by measured (rows) and computed
    modes, channels and responses in the order of the test; null for what is not known.
    """
    responses, table = found.responses, found.orthogonality
    return {
        **{key: getattr(found, key) for key in FACTS},
        "modes": [{key: getattr(row, key) for key in MODE_KEYS} for row in found.modes],
        "mac": nest_known(found.mac),
        "cross_orthogonality": None if table is None else nest_known(table),
        "channels": [
            {
                "point": row.channel.point,
                "direction": list(row.channel.direction),
                "comac": row.comac,
                "ecomac": row.ecomac,
                "distance_m": row.distance_m,
            }
            for row in found.list_channels()
        ],
        "responses": None
        if responses is None
        else {
            "damping": responses.damping,
            "motions": [" ".join(channel) for channel in responses.measured.outputs],
            "forces": [" ".join(channel) for channel in responses.measured.inputs],
            "frac": nest_known(responses.frac),
        },
    }


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
        "modes": [
            {
                **dataclasses.asdict(mode),
                "shape": [[float(value.real), float(value.imag)] for value in shape],
            }
            for mode, shape in zip(fit.list_modes(), modes.shapes.T, strict=True)
        ],
        "band_hz": None
        if responses is None
        else [float(responses.frequencies_hz[0]), float(responses.frequencies_hz[-1])],
        "responses": None
        if responses is None or fit.assurance is None
        else {
            "motions": [label_channel(channel) for channel in responses.motions],
            "forces": [label_channel(channel) for channel in responses.forces],
            "frac": nest_known(fit.assurance),
        },
        "remarks": list(fit.remarks),
    }

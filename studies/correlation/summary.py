"""A correlation as ``correlate.json`` has it."""

import math

from headstock.geometry.frames import FloatArray
from headstock.pipeline.storage.json_texts import JsonTable, JsonValue
from headstock.studies.correlation.correlation import CorrelatedMode, Correlation


def summarise_correlation(found: Correlation) -> JsonTable:
    """Return the content of ``correlate.json``: modes as in the table, MAC by measured (rows) and computed
    modes, channels and responses in the order of the test; null for what is not known.
    """
    agreement, responses = found.agreement, found.responses
    return {
        "scene": found.scene,
        "variant": found.variant,
        "pose": found.pose,
        "test": found.test,
        "within": found.within,
        "range_hz": list(found.range_hz),
        "verdict": list(found.verdict),
        "faults": list(found.faults),
        "remarks": list(found.remarks),
        "warnings": list(found.warnings),
        "modes": [_summarise_mode(found, row) for row in found.modes],
        "mac": _list_rows(found.mac),
        "cross_orthogonality": None
        if found.orthogonality is None
        else _list_rows(found.orthogonality),
        "channels": [
            {
                "point": channel.point,
                "direction": list(channel.direction),
                "comac": _known(comac),
                "ecomac": _known(ecomac),
                "distance_m": found.distances.get(channel.point),
            }
            for channel, comac, ecomac in zip(
                found.channels, agreement.comac, agreement.ecomac, strict=True
            )
        ],
        "responses": None
        if responses is None
        else {
            "damping": responses.damping,
            "motions": [" ".join(channel) for channel in responses.measured.outputs],
            "forces": [" ".join(channel) for channel in responses.measured.inputs],
            "frac": _list_rows(responses.frac),
        },
    }


def _summarise_mode(found: Correlation, row: CorrelatedMode) -> JsonTable:
    measured, computed, number = row.measured, row.computed, None
    if computed is not None:
        number = found.number(computed)
    table = found.orthogonality
    paired = measured is not None and computed is not None
    return {
        "measured_hz": None if measured is None else float(found.measured.frequencies_hz[measured]),
        "measured_error_hz": None
        if measured is None
        else _known(found.fit.frequency_errors[measured]),
        "measured_damping": None if measured is None else _known(found.measured.damping[measured]),
        "number": number,
        "name": None if computed is None else found.computed.mode_names[computed],
        "computed_hz": None if computed is None else float(found.computed.frequencies_hz[computed]),
        "computed_error_hz": None if computed is None else found.computed.error_hz[computed],
        "computed_damping": None if computed is None else found.computed.damping_ratio[computed],
        "deviation": row.deviation,
        "mac": row.mac,
        "cross_orthogonality": float(table[measured, computed])
        if paired and table is not None
        else None,
        "phase_collinearity": None
        if measured is None
        else _known(found.fit.collinearity[measured]),
        "doubts": list(row.doubts),
    }


def _list_rows(table: FloatArray) -> list[JsonValue]:
    return [[_known(value) for value in row] for row in table]


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None

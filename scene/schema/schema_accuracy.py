"""Schema of the accuracy a scene asks for."""

from typing import Annotated, Any

from pydantic import BeforeValidator

from headstock.scene.schema.types import RATIO_FORM, Flag, JsonForm, OrForm, StrictTable, problem, read_share

TIGHTEST, LOOSEST = 1e-4, 0.2


def _read_accuracy(value: object) -> float:
    share = read_share(value, "accuracy")
    if not TIGHTEST <= share <= LOOSEST:
        raise problem(
            f'is {100.0 * share:g} %; an accuracy lies between {100.0 * TIGHTEST:g} % and {100.0 * LOOSEST:g} %; write "1 %"'
        )
    return share


Accuracy = Annotated[
    float,
    BeforeValidator(_read_accuracy),
    JsonForm(
        {
            "description": f"ratio from {TIGHTEST:g} to {LOOSEST:g}",
            "examples": ["1 %", 0.01],
            **RATIO_FORM,
            "minimum": TIGHTEST,
            "maximum": LOOSEST,
        }
    ),
]


class AccuracyTable(StrictTable):
    """How far any requested number may be off: mesh sizes, cells, order and mode counts are chosen for it."""

    to: Accuracy
    fidelity: Flag = False


def _wrap_accuracy(value: Any) -> Any:
    return value if isinstance(value, dict) else {"to": value}


AccuracyEntry = Annotated[
    AccuracyTable, BeforeValidator(_wrap_accuracy), OrForm({"description": "ratio", "examples": ["1 %"], **RATIO_FORM})
]

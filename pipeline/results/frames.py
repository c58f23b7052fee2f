"""Results as pandas tables, one row per mode, entry, component, stage or line of a response."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from headstock.geometry.frames import DOF_NAMES
from headstock.pipeline.storage.frames import Frame, frame_columns

if TYPE_CHECKING:
    from headstock.pipeline.results.results import Results

type Column = list[object]


def make_frame(results: "Results", name: str) -> Frame:
    """Return a table of results.

    Args:
        name: ``modes``, ``compliance``, ``frf``, ``components`` or ``stages``.

    Raises:
        KeyError: There is no such table.
        HeadstockError: pandas is missing.
    """
    if name not in TABLES:
        raise KeyError(f"there is no table {name!r}; there are: {', '.join(TABLES)}")
    found = TABLES[name](results)
    if isinstance(found, Mapping):
        return frame_columns(found)
    return frame_columns({head: [row[head] for row in found] for head in found[0]} if found else {})


def _list_modes(results: "Results") -> list[Mapping[str, object]]:
    return [
        {
            "pose": pose,
            "mode": modes.below + number + 1,
            "frequency_hz": float(modes.frequencies_hz[number]),
            "error_hz": modes.error_hz[number],
            "error_known_hz": modes.list_errors()[number].known,
            "damping_ratio": modes.damping_ratio[number],
            "name": modes.mode_names[number],
        }
        for pose, modes in results.modes.items()
        for number in range(len(modes.frequencies_hz))
    ]


def _list_compliance(results: "Results") -> list[Mapping[str, object]]:
    return [
        {
            "pose": pose,
            "point": name,
            "output": DOF_NAMES[row],
            **dict(zip(DOF_NAMES, map(float, point.compliance[row]), strict=True)),
        }
        for pose, points in results.static.items()
        for name, point in points.items()
        for row in range(6)
    ]


def _list_responses(results: "Results") -> Mapping[str, Column]:
    columns: dict[str, Column] = {}
    for pose, response in results.frf.items():
        curves = response.curves
        found: dict[str, Column] = {
            "pose": [pose] * len(curves.frequencies_hz),
            "frequency_hz": list(map(float, curves.frequencies_hz)),
        }
        for row, output in enumerate(curves.outputs):
            for column, channel in enumerate(curves.inputs):
                name = f"{' '.join(output)} / {' '.join(channel)}"
                found[name] = list(map(complex, curves.receptance[:, row, column]))
        for name, values in found.items():
            columns.setdefault(name, []).extend(values)
    return columns


def _list_components(results: "Results") -> list[Mapping[str, object]]:
    return [
        {
            "component": name,
            "fidelity": facts.fidelity,
            "mass_kg": facts.mass_kg,
            "full_dofs": facts.full_dofs,
            "reduced_dofs": facts.reduced_dofs,
        }
        for name, facts in results.components.items()
    ]


def _list_stages(results: "Results") -> list[Mapping[str, object]]:
    return [
        {
            "stage": record.stage.kind,
            "component": record.stage.component,
            "pose": record.stage.pose,
            "seconds": record.seconds,
            "cached": record.cached,
        }
        for record in results.stages
    ]


TABLES: dict[str, Callable[["Results"], list[Mapping[str, object]] | Mapping[str, Column]]] = {
    "modes": _list_modes,
    "compliance": _list_compliance,
    "frf": _list_responses,
    "components": _list_components,
    "stages": _list_stages,
}

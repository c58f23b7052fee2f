"""The numbers of an FMU in C, and its variables: of a state space at a step, and of one that depends on
positions of axes.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import show_position
from headstock.pipeline.exchange.fmus import FmuModel, FmuVariable
from headstock.pipeline.exchange.state_spaces import MachineStateSpace, name_variable
from headstock.pipeline.exchange.varying_spaces import VaryingStateSpace
from headstock.solvers.state_spaces.rational_steps import PAIRS, list_poles
from headstock.solvers.state_spaces.varying_matrices import CONSTANT, Field, Knots

FIELD = "typedef struct {\n    int counts[AXES];\n    int level;\n    int size;\n    const double *values;\n} Field;\n"


def fixed_model(name: str, space: MachineStateSpace) -> FmuModel:
    """Return the FMU of a machine in one pose, with a step."""
    paired = 2 * space.pairs
    states = np.arange(paired).reshape(-1, 2)
    sizes = {
        "PAIRS": space.pairs,
        "DENSE": len(space.A) - paired,
        **_list_sizes(space, len(space.A)),
    }
    arrays = {
        "BLOCKS": space.A[states[:, :, None], states[:, None, :]],
        "A": space.A[paired:, paired:],
        **{letter: getattr(space, letter) for letter in "BCD"},
        "START": np.zeros(0),
    }
    return _make_model(
        name, space, "", (), _encode_sizes({**sizes, "AXES": 0}) + _encode_arrays(arrays)
    )


def varying_model(name: str, space: VaryingStateSpace) -> FmuModel:
    """Return the FMU of a machine wherever its axes stand, with a step."""
    matrices, axes = space.matrices.modal, space.axes
    fields = matrices.fields
    knots = [one for level in matrices.knots for one in level.values()]
    rows = [spring.rows.shape[0] for spring in matrices.springs]
    between = matrices.damping - np.diag(matrices.damping.diagonal())
    size = np.abs(matrices.damping).max(initial=0.0)
    coupled = len(matrices.patterns) > 0 or np.abs(between).max(initial=0.0) > CONSTANT * size
    sizes = {
        **_list_sizes(space, 2 * len(matrices.stiffness)),
        "AXES": len(axes),
        "SPRINGS": len(matrices.springs),
        "JOINT_ROWS": sum(rows),
        "MOST_ROWS": max(rows, default=0),
        "MOST_KNOTS": max(len(one.positions) for one in knots),
        "MIXED": len(matrices.patterns),
        "COUPLED": int(coupled),
        "RATE": repr(space.rate),
        "POLES": PAIRS,
    }
    travel = np.array([one.positions[[0, -1]] for one in knots[: len(axes)]])
    arrays = {
        "SQUARES": matrices.stiffness.diagonal(),
        "DAMPING": matrices.damping.T,
        "PATTERNS": matrices.patterns,
        "POLES_AND_SHARES": list_poles(),
        "START": np.array([space.positions[axis] for axis in axes]),
        "LOWEST": travel[:, 0],
        "HIGHEST": travel[:, 1],
    }
    arrays |= {f"FIELD_{number}": field.values for number, field in enumerate(fields)}
    for number, one in enumerate(knots):
        arrays |= {f"KNOTS_{number}": one.positions, f"PIECES_{number}": one.pieces()}
    header = _encode_sizes(sizes) + FIELD + _encode_arrays(arrays)
    header += _encode_lists(space, fields, knots)
    positions = tuple(
        FmuVariable(f"position.{axis}", unit, space.positions[axis])
        for axis, unit in zip(axes, space.axis_units, strict=True)
    )
    words = "; positions of axes are inputs, and their motion itself exerts no force"
    return _make_model(name, space, words, positions, header)


def _encode_lists(space: VaryingStateSpace, fields: Sequence[Field], knots: Sequence[Knots]) -> str:
    """Encode what refers to arrays: knots of both levels, messages of axes and fields."""
    numbers = range(len(knots))
    limits = [(one.positions[0], one.positions[-1]) for one in knots[: len(space.axes)]]
    lists = {
        "int COUNTS": [str(len(one.positions)) for one in knots],
        "double *const KNOTS": [f"KNOTS_{number}" for number in numbers],
        "double *const PIECES": [f"PIECES_{number}" for number in numbers],
        "char *const FAULTS": [
            f'"position.{axis} must lie between {show_position(low, unit)} and {show_position(high, unit)}"'
            for axis, (low, high), unit in zip(space.axes, limits, space.axis_units, strict=True)
        ],
        "Field FIELDS": [
            f"{{{{{', '.join(map(str, field.grid))}}}, {field.level}, {int(np.prod(field.shape))}, FIELD_{number}}}"
            for number, field in enumerate(fields)
        ],
    }
    return "".join(
        f"static const {kind}[] = {{{', '.join(values)}}};\n" for kind, values in lists.items()
    )


def _make_model(
    name: str,
    space: MachineStateSpace | VaryingStateSpace,
    words: str,
    positions: tuple[FmuVariable, ...],
    header: str,
) -> FmuModel:
    forces, motions = (
        tuple(
            FmuVariable(name_variable(kind, channel), unit, start)
            for channel, unit in zip(channels, units, strict=True)
        )
        for kind, start, channels, units in (
            ("force", 0.0, space.inputs, space.input_units),
            ("motion", None, space.outputs, space.output_units),
        )
    )
    step = space.step or 0.0
    description = f"{name}: forces in, motions out; inputs are held over {step:g} s{words}"
    return FmuModel(
        name, description, step, (*forces, *positions, *motions), header, axes=bool(positions)
    )


def _list_sizes(space: MachineStateSpace | VaryingStateSpace, states: int) -> dict[str, int | str]:
    step = space.step or 0.0
    return {
        "STATES": states,
        "INPUTS": len(space.inputs),
        "OUTPUTS": len(space.outputs),
        "STEP": repr(step),
        "STEP_TEXT": f'"{step:g}"',
    }


def _encode_sizes(sizes: Mapping[str, int | str]) -> str:
    return "".join(f"#define {name} {value}\n" for name, value in sizes.items())


def _encode_arrays(arrays: Mapping[str, FloatArray]) -> str:
    return "".join(_encode_array(name, array) for name, array in arrays.items())


def _encode_array(name: str, array: FloatArray) -> str:
    numbers = array.ravel().tolist() or [0.0]
    rows = (", ".join(map(repr, numbers[k : k + 6])) for k in range(0, len(numbers), 6))
    return f"static const double {name}[] = {{\n" + ",\n".join(rows) + "\n};\n"

"""What a machine is without a source of error: an analysis in time is repeated on it for its ±."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from headstock.geometry.parts.components import Component
from headstock.geometry.parts.solids import Box
from headstock.reduction.estimates.better_elements import (
    with_finer_mesh,
    with_modes_left_out,
    with_true_faces,
)
from headstock.reduction.superelement import Superelement


@dataclass(frozen=True)
class Improvement:
    """A source of error that a machine can be rid of, as far as its estimate says.

    Attributes:
        improve: A superelement without it; itself where it has none.
        concerns: Whether a component may have it.
        apart: Looked at one component at a time: what two of them change may cancel by chance.
    """

    improve: Callable[[Superelement], Superelement]
    concerns: Callable[[Component], bool]
    apart: bool = False


def _is_discrete(part: Component) -> bool:
    return part.fidelity in ("elastic", "polynomial")


def _is_curved(part: Component) -> bool:
    return part.fidelity == "elastic" and not isinstance(part.solid, Box)


FINER_MESH = Improvement(with_finer_mesh, _is_discrete, apart=True)
TRUE_FACES = Improvement(with_true_faces, _is_curved)
MORE_MODES = Improvement(with_modes_left_out, _is_discrete)
# meshes and reductions both make a machine too stiff
BOTH_AT_ONCE = Improvement(lambda part: with_modes_left_out(with_finer_mesh(part)), _is_discrete)
EACH = (FINER_MESH, TRUE_FACES, MORE_MODES)
ONCE = (BOTH_AT_ONCE, TRUE_FACES)  # of long analyses


def list_repeats(
    components: Mapping[str, Component], improvements: Sequence[Improvement]
) -> list[tuple[Improvement, tuple[str, ...]]]:
    """Once per improvement, or component that may have one: it and these components."""
    found: list[tuple[Improvement, tuple[str, ...]]] = []
    for each in improvements:
        names = tuple(name for name, part in components.items() if each.concerns(part))
        if each.apart:
            found += [(each, (name,)) for name in names]
        elif names:
            found.append((each, names))
    return found

"""Superelements in the store: one that holds more than is asked for serves, cut down to what was asked."""

import dataclasses
from dataclasses import dataclass

from headstock.pipeline.stages.run_state import ReducedComponent
from headstock.pipeline.storage.store import Store, StoreRead, list_keys, read_entry, write_entry
from headstock.reduction.requests import ReductionExtent, ReductionRequest, trim_superelement

STATIC = "static"
SEPARATOR = "_"  # a number may hold a minus


@dataclass(frozen=True)
class StoredRequest:
    """What is asked of the store.

    Attributes:
        key: Of everything that the superelements of a component depend on but how much they hold.
        reduction: How much is asked for.
        mass: It assembles the mass.
        verify: The number of modes is to be counted.
    """

    key: str
    reduction: ReductionRequest
    mass: bool
    verify: bool


def find_superelement(store: Store, request: StoredRequest) -> StoreRead[ReducedComponent]:
    """The smallest stored superelement that serves, as if it had been reduced for the request; warnings of entries not believed."""
    warning = None
    serving = [
        (-1 if extent.modes is None else extent.modes, key)
        for key in list_keys(store, ReducedComponent, f"{request.key}{SEPARATOR}")
        if (extent := _read_extent(key)) is not None and extent.serves(request.reduction, mass=request.mass, verify=request.verify)
    ]
    for _, key in sorted(serving):
        read = read_entry(store, key, ReducedComponent)
        warning = warning or read.warning
        if read.value is not None:
            element = trim_superelement(read.value.superelement, request.reduction, mass=request.mass)
            return StoreRead(dataclasses.replace(read.value, superelement=element), warning)
    return StoreRead(None, warning)


def keep_superelement(store: Store, request: StoredRequest, reduced: ReducedComponent) -> str | None:
    """Keep what was reduced for a request; a warning where the store cannot be written."""
    return write_entry(store, f"{request.key}{SEPARATOR}{_describe_extent(request, reduced)}", reduced)


def _describe_extent(request: StoredRequest, reduced: ReducedComponent) -> str:
    """How much a superelement holds, as the end of its key."""
    element, modes = reduced.superelement, request.reduction.modes
    parts = [STATIC] if modes is None else [str(element.modal_count), repr(float(element.cutoff_hz))]
    flags = {"mass": request.mass, "gravity": request.reduction.gravity, "verified": request.verify and modes is not None}
    return SEPARATOR.join([*parts, *(name for name, there in flags.items() if there)])


def _read_extent(key: str) -> ReductionExtent | None:
    """The inverse; None for what is no such key."""
    _, first, *rest = key.split(SEPARATOR)
    flags = {name: name in rest for name in ("mass", "gravity", "verified")}
    try:
        return ReductionExtent(None, 0.0, **flags) if first == STATIC else ReductionExtent(int(first), float(rest[0]), **flags)
    except (ValueError, IndexError):
        return None

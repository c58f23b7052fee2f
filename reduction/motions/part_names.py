"""Names of parts in texts: those that differ by a number stand together."""

from collections.abc import Iterable, Sequence

FAMILIES_SHOWN = 4


def join_names(names: Sequence[str]) -> str:
    """Return ``a + pad_1..4``: numbered names of one family together, cut with an ellipsis where
    there are many.
    """
    families: dict[str, list[int]] = {}
    for name in names:
        stem, number = split_number(name)
        families.setdefault(stem, []).extend([] if number is None else [number])
    parts = [_join_family(stem, sorted(numbers)) for stem, numbers in families.items()]
    shown = " + ".join(parts[:FAMILIES_SHOWN])
    return f"{shown} ..." if len(parts) > FAMILIES_SHOWN else shown


def name_families(names: Iterable[str]) -> dict[str, list[str]]:
    """Return names that differ by a number only, by a common name: ``pad_1..4``."""
    families: dict[str, list[str]] = {}
    for name in sorted(names):
        families.setdefault(split_number(name)[0], []).append(name)
    return {join_names(members): members for members in families.values()}


def split_number(name: str) -> tuple[str, int | None]:
    """Split ``pad_3`` into ``("pad", 3)``; a name without a number into ``(name, None)``."""
    stem, _, tail = name.rpartition("_")
    if stem and tail.isdecimal() and str(int(tail)) == tail:
        return stem, int(tail)
    return name, None


def _join_family(stem: str, numbers: Sequence[int]) -> str:
    if not numbers:
        return stem
    if len(numbers) > 1 and numbers[-1] - numbers[0] == len(numbers) - 1:
        return f"{stem}_{numbers[0]}..{numbers[-1]}"
    return f"{stem}_{','.join(str(number) for number in numbers)}"

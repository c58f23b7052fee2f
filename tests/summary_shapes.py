"""Whether a summary holds what the keys of its analyses say."""

from collections.abc import Iterator, Mapping

from headstock.pipeline.results.summary_keys import (
    ANY_NUMBER,
    ANYTHING,
    Shape,
    list_summary_keys,
)


def list_strangers(value: object, shape: Shape = None, where: str = "") -> Iterator[str]:
    """Yield where a summary leaves what its keys say; nothing where it does not."""
    shape = shape if where else list_summary_keys()
    if value is None or (isinstance(shape, tuple) and shape[0] == ANYTHING):
        return
    if isinstance(shape, dict) and isinstance(value, Mapping):
        yield from (f"{where}.{key}" for key in value.keys() - shape.keys())
        for key in value.keys() & shape.keys():
            yield from list_strangers(value[key], shape[key], f"{where}.{key}")
    elif isinstance(shape, tuple) and shape[0] == ANY_NUMBER and isinstance(value, list | tuple):
        for item in value:
            yield from list_strangers(item, shape[1], f"{where}[]")
    elif isinstance(shape, tuple) and shape[0] != ANY_NUMBER and isinstance(value, Mapping):
        for key, item in value.items():
            yield from list_strangers(item, shape[1], f"{where}.{key}")
    elif shape is not None or isinstance(value, Mapping | list | tuple):
        yield f"{where}: {type(value).__name__} for {shape}"

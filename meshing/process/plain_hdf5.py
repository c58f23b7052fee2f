"""HDF5, loaded when something of it is first used, and files of strangers: what lies in other files, or unpacks to more than there is, is refused by
name before a value is read.
"""

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from headstock.geometry.errors import HeadstockError, printable
from headstock.geometry.loading import Library

if TYPE_CHECKING:
    import h5py as h5py
else:
    h5py = Library("h5py", annotated=("Group", "Dataset"))

STORED_AS = "stored_as"  # metadata of a field: its name in files, where that is another one
# a small file can declare a data set of any size: what is not small must be there, or compressed by
# no more than this
SMALL_ARRAY = 64 << 20
SMALL_FILE = 512 << 20  # of all data sets together
LARGEST_EXPANSION = 100
MOST_OBJECTS = 100_000
MOST_AXES = 8
PLAIN_FILTERS = {1, 2, 3}  # deflate, shuffle, fletcher32 (H5Zpublic.h)


def plain_objects(
    start: h5py.Group, error: type[HeadstockError], names: Iterable[str] | None = None
) -> Iterator[tuple[str, h5py.Group | h5py.Dataset]]:
    """Yield every object below a group, with its printable path; heads of objects are all that is
    read.

    External storage, virtual data sets and links to other files would show what is in other files;
    soft links and filters from plug-ins have no place in a file of numbers either.

    Args:
        error: Raised for the first thing that is not in the file itself, or is too large.
        names: Of the members of the group to look at; None for all.
    """
    visited: set[int] = set()
    claimed, held = 0, 0
    waiting: list[tuple[h5py.Group, str]] = [
        (start, name) for name in (start if names is None else names) if name in start
    ]
    while waiting:
        group, name = waiting.pop()
        where = printable(f"{(group.name or '').rstrip('/')}/{name}")
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            raise error(
                f"{where} is a link, which is not followed; write the file again with all that belongs to it in it"
            )
        item = group[name]
        address = h5py.h5o.get_info(item.id).addr
        if address in visited or len(visited) >= MOST_OBJECTS:
            raise error(
                f"{where} is there twice, or the file holds more than {MOST_OBJECTS} objects"
            )
        visited.add(address)
        if isinstance(item, h5py.Group):
            waiting += [(item, inner) for inner in item]
        elif isinstance(item, h5py.Dataset):
            claimed += require_own_data(item, where, error)
            held += item.id.get_storage_size()
            if claimed > max(SMALL_FILE, LARGEST_EXPANSION * held):
                raise error(
                    f"{where}: the data sets up to here claim {claimed / 1e9:.3g} GB, but the file holds {held / 1e6:.3g} MB of them"
                )
        else:
            raise error(f"{where} is neither a group nor a data set")
        yield where, item


def require_own_data(item: h5py.Dataset, where: str, error: type[HeadstockError]) -> int:
    """Refuse a data set whose values lie elsewhere or unpack to more than the file could hold.

    Returns:
        Bytes of its values in memory.
    """
    settings = item.id.get_create_plist()
    if settings.get_external_count() or item.is_virtual:
        raise error(
            f"{where} takes its values from other files; write the file again with all that belongs to it in it"
        )
    filters = {settings.get_filter(number)[0] for number in range(settings.get_nfilters())}
    if not filters <= PLAIN_FILTERS:
        raise error(
            f"{where} is packed by filters {sorted(filters)}; gzip, shuffle and checksums are known"
        )
    if item.shape is None or len(item.shape) > MOST_AXES:
        raise error(
            f"{where} has {'no shape' if item.shape is None else f'more than {MOST_AXES} axes'}"
        )
    # numbers may grow to eight bytes each when they are read
    claimed, held = int(item.size) * max(item.dtype.itemsize, 8), item.id.get_storage_size()
    if claimed > max(SMALL_ARRAY, LARGEST_EXPANSION * held):
        raise error(
            f"{where} claims {item.size} values of {printable(str(item.dtype))[:60]}, but the file holds {held} bytes of them"
        )
    return int(claimed)

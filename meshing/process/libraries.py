"""HDF5, which is loaded when something of it is first used."""

from typing import TYPE_CHECKING

from headstock.geometry.loading import Library

if TYPE_CHECKING:
    import h5py as h5py
else:
    h5py = Library("h5py", annotated=("Group", "Dataset"))

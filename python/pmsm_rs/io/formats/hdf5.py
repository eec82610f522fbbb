"""HDF5 and MATLAB v7.3, with the extra `hdf5`."""

from __future__ import annotations

from pathlib import Path

from .isolated import open_isolated
from .source import Source


def open_file(file: Path, max_bytes: int) -> Source:
    """The numeric datasets of an HDF5 or MATLAB v7.3 file.

    Raises UsageError without h5py; DataError on damage, on links and storage that lead out of the file, and
    on more than `max_bytes` declared.
    """
    with file.open("rb") as handle:
        matlab = handle.read(10) == b"MATLAB 7.3"
    what = "MATLAB v7.3" if matlab else "HDF5"
    return open_isolated(file, "hdf5", what, max_bytes, needs=("h5py", "hdf5"))

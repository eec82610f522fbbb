"""Readers, one file per format.

Each turns a file into a Source; which one is chosen by content, not by name alone.
"""

from __future__ import annotations

import os
import re
from importlib import import_module
from pathlib import Path

from ..._core import DataError
from ...errors import opened, refuse
from ...mistaken import MAGIC
from .canlog import log_kind
from .gate import checked_limit
from .source import Source
from .standard_input import comes_there, kept

_STRANGERS = (
    (b"FEA1", "a Feather file of version 1", "save it again as Feather version 2 or Parquet"),
    (
        b"\x93NUMPY",
        "a single array (.npy) without column names",
        "save named columns with numpy.savez(file, t=..., i_d=...)",
    ),
    (b"\x1f\x8b", "a gzip archive", "unpack it first"),
    (b"\xd0\xcf\x11\xe0", "a spreadsheet", "export it as CSV"),
    (b"%PDF", "a PDF document", "name the recording itself"),
    (b"\x89PNG", "a picture", "name the recording itself"),
    (b"\x7fELF", "a program", "name the recording itself"),
)
# A header such as "[s], [A]" starts with a bracket too.
_BRACKET = re.compile(rb"\xef?\xbb?\xbf?\s*(\{|\[\s*[\[{])")
_SUFFIX = {
    ".parquet": "parquet",
    ".feather": "feather",
    ".arrow": "feather",
    ".npz": "npz",
    ".mat": "mat",
    ".h5": "HDF5",
    ".hdf5": "HDF5",
    ".tdms": "TDMS",
    ".mf4": "MDF",
    ".mdf": "MDF",
    ".json": "json",
    ".ulg": "ulog",
    ".bag": "ROS",
    ".db3": "ROS 2",
    ".mcap": "MCAP",
    ".blf": "BLF",
}
_DESCRIBED = frozenset({"can", "mdf"})
"""Formats whose frames of a CAN bus a description takes apart."""


def open_source(path: str | os.PathLike[str], max_bytes: int, dbc: str | None = None) -> Source:
    """The columns of the file at `path`, none of them read yet; the file `dbc` describes the frames of a CAN
    bus.

    Raises UsageError where there is no such file or `max_bytes` is no number of bytes, DataError where it is
    no recording or would take more than `max_bytes` bytes of memory.
    """
    max_bytes = checked_limit(max_bytes)
    if comes_there(Path(path)):
        path = kept(max_bytes)
    name = str(Path(path))
    with opened(name, "recording") as file:
        size = file.stat().st_size
        with file.open("rb") as handle:
            head = handle.read(128)
    if size == 0:
        raise refuse(DataError, "the file is empty", file=name, fix="record or export it again")
    if size > max_bytes:
        raise refuse(
            DataError,
            f"the file has {size} bytes, more than the {max_bytes} allowed",
            file=name,
            fix="cut the recording, or raise max_bytes",
        )
    for magic, what, fix in _STRANGERS:
        if head.startswith(magic):
            raise refuse(DataError, f"this is {what}, which is not read here", file=name, fix=fix)
    kind = next((kind for magic, kind in MAGIC if head.startswith(magic)), "csv")
    if kind == "csv" and _BRACKET.match(head):
        kind = "json"
    if kind == "csv" and log_kind(head) is not None:
        kind = "can"
    claimed = _SUFFIX.get(file.suffix.lower())
    if kind == "csv" and claimed is not None:
        raise refuse(
            DataError,
            f"the name says {claimed} but the content is not",
            file=name,
            fix="export it again; it may be cut short or damaged",
        )
    given = {"dbc": dbc} if kind in _DESCRIBED else {}
    source: Source = import_module(f".{kind}", __name__).open_file(file, max_bytes, **given)
    return source


__all__ = ["Source", "open_source"]

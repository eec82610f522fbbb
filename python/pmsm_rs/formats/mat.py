"""MATLAB .mat of version 5 (-v6, -v7) through scipy.io, with sizes checked before anything is unpacked."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Literal

import numpy as np

from .._core import DataError
from ..errors import refuse
from .source import Source, from_arrays

_FIX = "save it again from MATLAB with save(..., '-v7')"
_COMPRESSED, _HEADER_BYTES, _CHUNK = 15, 128, 1 << 20


def _unpacked(file: Path, max_bytes: int) -> int:
    """Bytes of all variables once unpacked, given up as soon as they pass `max_bytes`.

    Source: MathWorks, "MAT-File Format", level 5: each element is a type, a length and data; type 15 is
    deflated.
    """
    total = 0
    with file.open("rb") as handle:
        head = handle.read(_HEADER_BYTES)
        order: Literal["little", "big"] = "little" if head[126:128] == b"IM" else "big"
        if head[126:128] not in (b"IM", b"MI"):
            raise ValueError("the byte-order mark is missing")
        while len(tag := handle.read(8)) == 8:
            kind = int.from_bytes(tag[:4], order)
            left = int.from_bytes(tag[4:], order)
            if kind != _COMPRESSED:
                total += left
                handle.seek(left, 1)
                continue
            inflate = zlib.decompressobj()
            while left > 0 and total <= max_bytes:
                piece = handle.read(min(left, _CHUNK))
                if not piece:
                    raise ValueError("the file ends early")
                left -= len(piece)
                while piece and total <= max_bytes:
                    total += len(inflate.decompress(piece, _CHUNK))
                    piece = inflate.unconsumed_tail
            if total > max_bytes:
                break
    return total


def open_file(file: Path, max_bytes: int) -> Source:
    """The numeric arrays of a .mat file.

    Raises DataError on damage and on more than `max_bytes` once unpacked.
    """
    import warnings

    import scipy.io

    name = str(file)
    try:
        total = _unpacked(file, max_bytes)
        if total > max_bytes:
            raise refuse(
                DataError,
                f"it unpacks to more than the {max_bytes} bytes allowed",
                file=name,
                fix="cut the recording, or raise max_bytes",
            )
        with warnings.catch_warnings():
            # Function handles and objects beside the columns are not asked for; what scipy says
            # of them is no concern.
            warnings.simplefilter("ignore")
            content = scipy.io.loadmat(name)
    except DataError:
        raise
    except Exception as error:
        raise refuse(DataError, f"this .mat file cannot be read ({error})", file=name, fix=_FIX) from error
    arrays = {
        variable: values
        for variable, values in content.items()
        if isinstance(values, np.ndarray) and values.dtype.kind in "fiubc" and not variable.startswith("__")
    }
    if not arrays:
        raise refuse(
            DataError, "it holds no numeric arrays", file=name, fix="save the columns as plain vectors"
        )
    return from_arrays(name, arrays)

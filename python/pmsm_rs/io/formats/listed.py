"""Lists of Python values as arrays. NumPy alone would take true for 1 and a number beside text for text."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ...errors import shown
from .member import Refused
from .source import PLAIN_FIX

_ROW_FIX: Final = "complete or remove the row"
# Dimensions of an array, far beyond what a recording has; each level of nesting costs time for every value.
_MOST_DIMENSIONS: Final = 8
_NUMBER, _BOOLEAN, _TEXT, _NOTHING, _OTHER = range(5)


def array_of(values: Sequence[Any], column: str) -> NDArray[Any]:
    """`values`, one per row or nested lists of equal length, as an array that keeps their kind.

    Raises Refused on a missing value and on one of another kind than the others, by its row, and on what is
    no array.
    """
    kinds = {kind for value in values for kind, _ in _leaves(value, 1)}
    if len(kinds) > 1 or _NOTHING in kinds:
        # Among numbers whatever is none is at fault, otherwise the gap.
        right = _NUMBER if _NUMBER in kinds else None
        for row, value in enumerate(values):
            for kind, leaf in _leaves(value, 1):
                if kind == _NOTHING:
                    raise Refused("the value is missing", _ROW_FIX, column=column, row=row)
                if right is not None and kind != right:
                    raise Refused(f"'{shown(str(leaf))}' is no number", _ROW_FIX, column=column, row=row)
    try:
        return np.array(values)
    except (ValueError, OverflowError):
        raise Refused("it holds no plain numbers", PLAIN_FIX, column=column) from None


def shape_of(values: Sequence[Any]) -> tuple[int, ...]:
    """The shape of nested lists, as far as their first items tell."""
    shape = [len(values)]
    while values and isinstance(values[0], list | tuple) and len(shape) < _MOST_DIMENSIONS:
        values = values[0]
        shape.append(len(values))
    return tuple(shape)


def _leaves(value: Any, depth: int) -> Iterator[tuple[int, Any]]:
    """The kinds of the values within `value`, and these values."""
    if isinstance(value, list | tuple) and depth < _MOST_DIMENSIONS:
        for item in value:
            yield from _leaves(item, depth + 1)
    elif isinstance(value, bool | np.bool_):
        yield _BOOLEAN, value
    elif value is None:
        yield _NOTHING, value
    elif isinstance(value, str | bytes):
        yield _TEXT, value
    else:
        yield (_OTHER if isinstance(value, dict | list | tuple) else _NUMBER), value

"""A recording: checked columns in SI units and what is known of the load."""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from .. import _core
from .._core import DataError, UsageError
from ..errors import expect, number_of, refuse
from ..quantities.canonical import CANONICAL, ordered
from ..results.tabular import table
from .columns import taken, unknown_column
from .frames import frame_source
from .reading import Account

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DEFAULT_MAX_BYTES = 2 << 30
# The core sorts the time steps, and keeps what it works with.
_ROWS_TO_CHECK = 4


class Recording(_core.Recording):
    """Columns of one run under their canonical names, each of shape (samples,), in SI units.

    It is a table of its columns in the order of the canonical names: whatever takes an Arrow stream takes it,
    such as `polars.DataFrame(recording)` and `pyarrow.table(recording)`. Iterating gives a named tuple for
    each row, from which `pandas.DataFrame(recording)` is made; `pandas.DataFrame.from_arrow` is faster.

    Parameters
    ----------
    columns : mapping of str to array_like of shape (samples,), optional
        Columns by canonical names; `n` in rpm is taken as `omega_m`.
    load : str or None, default None
        What is known of the load torque: none, known_constant, measured, unknown_constant, unknown_piecewise
        or locked. None means measured where there is a column tau_m, and unknown_constant otherwise.
    load_value : float or None, default None
        The torque of a known_constant load, N·m.
    angle_error : float or None, default None
        Says that angle and speed were not measured but taken from the voltages, and how far they may be off,
        rad (electrical). Then nothing is asked of the motion.
    **arrays : array_like of shape (samples,)
        Columns by keyword, as in `Recording(t=..., v_d=..., v_q=..., i_d=..., i_q=..., omega_e=...)`.

    Attributes
    ----------
    file : str or None
        Name of the file it was read from.
    account : Account
        Which column became what.

    Raises
    ------
    DataError
        Naming column and row.
    UsageError
        For what are no columns.

    Examples
    --------
    >>> import numpy as np
    >>> import pmsm_rs as pm
    >>> t = np.arange(100) * 1e-3
    >>> pm.Recording(t=t, i_d=0 * t, i_q=1 + np.sin(9 * t), omega_e=100 + 0 * t)
    <Recording of 100 samples, 0.099 s, mechanical: t, i_d, i_q, omega_e>
    """

    file: str | None = None
    account: Account

    def __new__(
        cls,
        columns: Mapping[str, Any] | None = None,
        /,
        *,
        load: str | None = None,
        load_value: float | None = None,
        angle_error: float | None = None,
        **arrays: Any,
    ) -> Self:
        """Checks the columns and takes a copy of them."""
        if not isinstance(columns, Mapping | None) and not hasattr(columns, "keys"):
            raise refuse(
                UsageError,
                f"a {type(columns).__name__} was given where columns are expected",
                fix="give a mapping of arrays; files and frames are read by pmsm_rs.load",
            )
        if load is not None:
            expect(str, load=load)
        load_value = None if load_value is None else number_of("load_value", load_value)
        angle_error = None if angle_error is None else number_of("angle_error", angle_error)
        given = {**(columns or {}), **arrays}
        if not given:
            raise refuse(DataError, "there are no columns", fix="give t and what was measured")
        if load_value is not None and load != "known_constant":
            raise refuse(
                DataError, "load_value goes with load='known_constant' only", fix="leave one of the two out"
            )
        for name in given:
            if name not in CANONICAL:
                raise refuse(
                    DataError,
                    f"there is no column '{name}' in a recording",
                    column=name,
                    fix=unknown_column(name),
                )
        if _is_plain(given):
            # The core checks every value. What it refuses is refused below, in the words of `taken`.
            with suppress(DataError):
                _make_room(given)
                made = super().__new__(cls, given, load=load, load_value=load_value, angle_error=angle_error)
                made.account = Account.of_arrays(given)
                return made
        checked, account = taken(frame_source(given, DEFAULT_MAX_BYTES))
        _make_room(checked)
        made = super().__new__(cls, checked, load=load, load_value=load_value, angle_error=angle_error)
        made.account = account
        return made

    def __init__(self, *_: Any, **__: Any) -> None:
        """Nothing is left to do: __new__ has checked and stored everything."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles as its columns, the load and the name of its file."""
        columns = {name: self.column(name) for name in self.names}
        known = (columns, self.load, self.load_value, self.angle_error)
        return _restore, known, {"file": self.file, "account": self.account}

    def __repr__(self) -> str:
        names = ", ".join(ordered(self.names))
        return f"<Recording of {len(self)} samples, {self.duration:.6g} s, {self.kind}: {names}>"

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        """The columns as an Arrow stream of float64, by the Arrow PyCapsule interface."""
        columns = {name: self.column(name) for name in ordered(self.names)}
        return table(columns).__arrow_c_stream__(requested_schema)

    def __iter__(self) -> Iterator[tuple[float, ...]]:
        """The rows, each a named tuple in the order of the canonical names."""
        names = ordered(self.names)
        row = namedtuple("Row", names)  # type: ignore[misc]
        return map(row._make, zip(*(self.column(name).tolist() for name in names), strict=True))

    def to_xarray(self) -> Any:
        """Gives the recording as an xarray Dataset over the coordinate `t`.

        Each variable has its SI unit in `attrs["units"]`; what is known of the load stands in the attributes
        of the Dataset. `pmsm_rs.load` takes it back.

        Returns
        -------
        xarray.Dataset
            Variables of shape (samples,) over `t` in s.

        Raises
        ------
        UsageError
            Without xarray.
        """
        try:
            import xarray
        except ImportError as error:
            raise refuse(
                UsageError, "xarray is not installed", fix="install it: pip install xarray"
            ) from error
        columns = {
            name: ("t", self.column(name), {"units": CANONICAL[name].unit}) for name in ordered(self.names)
        }
        t = columns.pop("t")
        known = {"load": self.load} | ({} if self.load_value is None else {"load_value": self.load_value})
        return xarray.Dataset(columns, coords={"t": t}, attrs=known)

    def plot(self) -> Figure:
        """Draws what was measured over time, with axes for each quantity.

        Returns
        -------
        matplotlib.figure.Figure
            The figure.
        """
        from .waveforms import waveforms

        return waveforms(self)

    def _repr_html_(self) -> str:
        from .card import card

        return card(self, self.file)


def _is_plain(given: Mapping[str, Any]) -> bool:
    """Whether all columns are arrays as the core takes them."""
    return "n" not in given and all(
        type(values) is np.ndarray
        and values.dtype == np.float64
        and values.ndim == 1
        and values.flags.c_contiguous
        and values.flags.aligned
        for values in given.values()
    )


def _make_room(columns: Mapping[str, NDArray[np.float64]]) -> None:
    """Raises DataError where there is no memory for the core's copy of `columns`; there, running out of it
    would end the process.
    """
    rows = max(values.nbytes for values in columns.values())
    needed = sum(values.nbytes for values in columns.values()) + _ROWS_TO_CHECK * rows
    try:
        np.empty(needed, dtype=np.uint8)
    except MemoryError:
        raise refuse(
            DataError, f"it needs {needed} bytes of memory, which are not free", fix="cut the recording"
        ) from None


def _restore(
    columns: dict[str, Any], load: str, load_value: float | None, angle_error: float | None
) -> Recording:
    return Recording(columns, load=load, load_value=load_value, angle_error=angle_error)

"""Online identification: estimates window by window, from a recording or from a stream."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from .. import _core
from .._core import DataError, Machine, UsageError
from ..config.machine_file import MachineFile
from ..config.swarm import Swarm, expect_method, swarm_settings
from ..errors import expect_whole, number_of, refuse
from ..given import machine_of
from ..io.columns import assemble
from ..io.frames import frame_source
from ..io.loader import load_columns
from ..io.recording import DEFAULT_MAX_BYTES
from ..run import fit_bounds
from .window import WindowEstimate

if TYPE_CHECKING:
    from ..given import Described

Source = _core.Recording | dict[str, NDArray[np.float64]]
Fit = Mapping[str, tuple[float, float] | None] | Iterable[str]

PAPER = Swarm(particles=10, iterations=30, inertia=0.8, cognitive=2.0, social=2.0)
"""The swarm of Liu, Liu & Cartes (2008)."""

_WINDOWS_AT_ONCE = 4
_MOST_ROWS = 1 << 18
_LOOKED_AT = 1000
_SHORTEST = 1e-9
"""s, far less than any drive takes between two samples."""


class Tracker:
    """Follows parameters through a stream of samples; memory does not grow with the stream.

    Each estimate is the same for any number of `threads` and any way of cutting the stream into batches.

    Parameters
    ----------
    machine : Machine, MachineFile or path
        The nameplate, or a machine file that holds it.
    fit : mapping or iterable of str, default ("r_s", "tau_load")
        Names of parameters. A mapping gives each its bounds in SI units, or None for a wide range around the
        nameplate. An unknown load is fitted along with anything that acts on the speed.
    window : float, default 0.033
        Length of a window, s.
    method : str, default "lm"
        "lm" (warm least squares, fast), "pso" (the paper's swarm: each window starts from the last one's
        result) or "pso+lm".
    swarm : Swarm or None, default None
        Settings of the swarm; None takes those of the paper.
    search : float, default 0.2
        Share of the last result within which the swarm seeks.
    seed : int, default 1
        From 0 on.
    load : str or None, default None
        What is known of the load torque, as in Recording; None takes that of the machine file.
    load_value : float or None, default None
        The torque of a known_constant load, N·m.
    threads : int or None, default None
        None uses every processor.

    Raises
    ------
    UsageError
        For settings that make no sense.
    MachineError
        For a wrong machine file.

    Examples
    --------
    >>> import pmsm_rs as pm
    >>> from pmsm_rs.support.demo import recording_files
    >>> run, other, machine = recording_files()
    >>> tracker = pm.Tracker(machine, fit=["r_s"], window=0.1)
    >>> windows = tracker.update(pm.load(run, machine))
    >>> windows[0].status
    'estimated'
    """

    def __init__(
        self,
        machine: Described,
        *,
        fit: Fit = ("r_s", "tau_load"),
        window: float = 0.033,
        method: str = "lm",
        swarm: Swarm | None = None,
        search: float = 0.2,
        seed: int = 1,
        load: str | None = None,
        load_value: float | None = None,
        threads: int | None = None,
    ) -> None:
        expect_whole(seed=seed, threads=threads)
        expect_method(method)
        described = machine_of(machine)
        if isinstance(described, MachineFile) and load is None:
            load, load_value = described.load, described.load_value
        self._threads = threads
        self._core = _core.Tracker(
            described.machine if isinstance(described, MachineFile) else described,
            fit=fit_bounds(fit),
            window=_length(window),
            method=method,
            swarm=swarm_settings(swarm or PAPER),
            search=number_of("search", search),
            seed=seed,
            load=load,
            load_value=load_value,
        )

    def update(self, batch: Any) -> list[WindowEstimate]:
        """Takes in samples and returns the windows that they complete.

        Rows with a value that is not finite are left out and counted in the window's notes, and so are rows
        that repeat or come out of order. Where time runs far back a new run begins. An exception,
        KeyboardInterrupt included, leaves the tracker as it was: the same batch can be given again.

        Parameters
        ----------
        batch : mapping of array_like, Recording, or frame
            Canonical names with arrays of shape (samples,) in SI units, or anything with an Arrow stream.
            Every batch has the same columns.

        Returns
        -------
        list of WindowEstimate
            The windows in order; empty where none is complete.

        Raises
        ------
        DataError
            For columns that cannot be used.
        """
        if isinstance(batch, _core.Recording):
            return self._take(batch)
        return self._take(assemble(frame_source(batch, DEFAULT_MAX_BYTES), finite=False))

    def _take(self, source: Source, rows: slice = slice(None)) -> list[WindowEstimate]:
        if isinstance(source, _core.Recording):
            first, end, _ = rows.indices(len(source))
            texts = self._core.follow(source, first, end, threads=self._threads)
        else:
            part = {name: column[rows] for name, column in source.items()}
            texts = self._core.update(part, threads=self._threads)
        return [WindowEstimate.from_json(text) for text in texts]

    def finish(self) -> list[WindowEstimate]:
        """Ends the window under way, at the end of the stream.

        Returns
        -------
        list of WindowEstimate
            That window, if there is one.
        """
        return [WindowEstimate.from_json(text) for text in self._core.finish(threads=self._threads)]

    def state(self) -> bytes:
        """Gives everything the tracker knows.

        Returns
        -------
        bytes
            UTF-8 JSON of schema pmsm-rs.tracker/1.
        """
        return self._core.state().encode()

    @classmethod
    def restore(cls, state: bytes | str, *, threads: int | None = None) -> Self:
        """Makes the tracker whose `state()` this is; it goes on bit for bit.

        Parameters
        ----------
        state : bytes or str
            What `state()` returned.
        threads : int or None, default None
            None uses every processor.

        Returns
        -------
        Tracker
            The tracker.

        Raises
        ------
        DataError
            For anything else: another schema, damage, values that no tracker has.
        """
        try:
            text = state if isinstance(state, str) else bytes(state).decode()
        except (TypeError, UnicodeDecodeError):
            raise refuse(
                DataError, "this is no state of a tracker", fix="give what state() returned, unchanged"
            ) from None
        tracker = cls.__new__(cls)
        expect_whole(threads=threads)
        tracker._threads = threads
        tracker._core = _core.Tracker.restore(text)
        return tracker

    @property
    def machine(self) -> Machine:
        """The nameplate."""
        return self._core.machine

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles as its state."""
        return _restored, (type(self), self.state(), self._threads)

    def __repr__(self) -> str:
        return f"<Tracker of {', '.join(self._core.fit)} in windows of {self._core.window:g} s>"


def _length(window: object) -> float:
    """The length of a window, s. Raises UsageError where it is no number, or too small to count windows."""
    length = number_of("window", window)
    if 0.0 < length < _SHORTEST:
        raise refuse(UsageError, f"window is {length!r}", fix=f"give a length in s, at least {_SHORTEST:g}")
    return length


def _restored(kind: type[Tracker], state: bytes, threads: int | None) -> Tracker:
    return kind.restore(state, threads=threads)


def track(
    recording: Any,
    machine: Described,
    *,
    fit: Fit = ("r_s", "tau_load"),
    window: float = 0.033,
    method: str = "lm",
    swarm: Swarm | None = None,
    search: float = 0.2,
    seed: int = 1,
    threads: int | None = None,
) -> Iterator[WindowEstimate]:
    """Estimates parameters in one window after the other.

    Parameters
    ----------
    recording : Recording, path or frame
        The run. In files and frames, rows with missing values are allowed and counted.
    machine : Machine, MachineFile or path
        The nameplate, or a machine file that holds it.
    fit : mapping or iterable of str, default ("r_s", "tau_load")
        Names of parameters, with bounds in SI units or None, as for `Tracker`.
    window : float, default 0.033
        Length of a window, s.
    method : str, default "lm"
        "lm", "pso" or "pso+lm", as for `Tracker`.
    swarm : Swarm or None, default None
        Settings of the swarm; None takes those of the paper.
    search : float, default 0.2
        Share of the last result within which the swarm seeks.
    seed : int, default 1
        From 0 on.
    threads : int or None, default None
        None uses every processor.

    Returns
    -------
    iterator of WindowEstimate
        The windows, the last and perhaps shorter one included.

    Raises
    ------
    UsageError
        For settings that make no sense.
    MachineError
        For a wrong machine file.
    DataError
        For columns that cannot be used.

    Examples
    --------
    >>> import pmsm_rs as pm
    >>> from pmsm_rs.support.demo import recording_files
    >>> run, other, machine = recording_files()
    >>> for estimate in pm.track(run, machine, fit=["r_s"], window=1.0):
    ...     unit = estimate.parameters["r_s"].unit
    >>> unit
    'ohm'
    """
    described = machine_of(machine)
    load, value = None, None
    source: Source
    if isinstance(recording, _core.Recording):
        source, load, value = recording, recording.load, recording.load_value
    elif isinstance(recording, str | os.PathLike):
        source = load_columns(recording, described)
    else:
        rules = described.columns if isinstance(described, MachineFile) else None
        source = assemble(frame_source(recording, DEFAULT_MAX_BYTES), rules, finite=False)
    length = number_of("window", window)
    tracker = Tracker(
        described,
        fit=fit,
        window=window,
        method=method,
        swarm=swarm,
        search=search,
        seed=seed,
        load=load,
        load_value=value,
        threads=threads,
    )
    return _feed(tracker, source, length)


def _feed(tracker: Tracker, source: Source, window: float) -> Iterator[WindowEstimate]:
    t = source.column("t") if isinstance(source, _core.Recording) else source["t"]
    # Steps here and there tell the period well enough to cut a log into batches.
    at = np.linspace(0, max(len(t) - 2, 0), min(_LOOKED_AT, max(len(t) - 1, 0))).astype(int)
    steps = t[at + 1] - t[at]
    steps = steps[np.isfinite(steps) & (steps > 0)]
    period = float(np.median(steps)) if steps.size else window
    rows = int(min(max(_WINDOWS_AT_ONCE * window / period, 1.0), _MOST_ROWS))
    for first in range(0, len(t), rows):
        yield from tracker._take(source, slice(first, first + rows))
    yield from tracker.finish()

"""Online identification: estimates window by window, from a recording or from a stream."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from .. import _core
from .._core import DataError, Machine
from ..config.machine_file import MachineFile
from ..errors import expect_whole, number_of, refuse, written_by
from ..given import machine_of
from ..io.columns import assemble
from ..io.frames import frame_source
from ..io.loader import load_columns
from ..io.recording import DEFAULT_MAX_BYTES
from ..results.findings import Estimate, estimates
from ..results.words import estimate, number
from ..run import Swarm, expect_method, fit_bounds, swarm_settings
from ..view.summary import hung

if TYPE_CHECKING:
    from ..given import Described

Source = _core.Recording | dict[str, NDArray[np.float64]]
Fit = Mapping[str, tuple[float, float] | None] | Iterable[str]

PAPER = Swarm(particles=10, iterations=30, inertia=0.8, cognitive=2.0, social=2.0)
"""The swarm of Liu, Liu & Cartes (2008)."""

_WINDOWS_AT_ONCE = 4
_MOST_ROWS = 1 << 18
_LOOKED_AT = 1000


@dataclass(frozen=True)
class Drift:
    """What moved since earlier windows, in words in `sentence`.

    `looks_like` holds any of "thermal", "load" and "mismatch". It is empty where all stayed within its
    uncertainty, and None for a skipped window.
    """

    looks_like: tuple[str, ...] | None
    sentence: str


@dataclass(frozen=True)
class WindowEstimate:
    """The result of one window.

    `t_start` and `t_end` are in s of the log's own time. `status` is "estimated" or "skipped", for the reason
    `why`. `notes` tells of gaps, lost rows, restarts and short windows (finding, consequence, fix).
    `disturbed_load_torque` is eq. (4) in N·m: what the load seems to be with the nameplate's J and B.
    `cost_first` and `cost` are the fitness (9) at the start and at the answer, `history` the best cost per
    generation or step. `rms` is measured minus model, `noise` the white noise of the measurement, per channel
    in its SI unit.
    """

    window: int
    t_start: float
    t_end: float
    samples: int
    status: str
    why: str | None
    notes: tuple[Mapping[str, str], ...]
    parameters: Mapping[str, Estimate]
    disturbed_load_torque: float | None
    cost_first: float | None
    cost: float | None
    history: tuple[float, ...]
    evaluations: int
    converged: bool
    widened: bool
    cannot_show: tuple[Mapping[str, Any], ...]
    rms: Mapping[str, float]
    noise: Mapping[str, float]
    drift: Drift
    data: Mapping[str, Any] = field(repr=False, compare=False)

    @classmethod
    def from_json(cls, text: str) -> Self:
        """From what `to_json` writes. Raises DataError for anything else."""
        with written_by("to_json"):
            return cls._of(json.loads(text))

    @classmethod
    def _of(cls, data: Mapping[str, Any]) -> Self:
        plain = {
            name: data[name]
            for name in (
                *("window", "t_start", "t_end", "samples", "status", "why", "disturbed_load_torque"),
                *("cost_first", "cost", "evaluations", "converged", "widened", "rms", "noise"),
            )
        }
        causes = data["drift"]["looks_like"]
        return cls(
            notes=tuple(data["notes"]),
            parameters=estimates(data["parameters"]),
            history=tuple(data["history"]),
            cannot_show=tuple(data["cannot_show"]),
            drift=Drift(None if causes is None else tuple(causes), data["drift"]["sentence"]),
            data=data,
            **plain,
        )

    def to_json(self) -> str:
        """The whole result as JSON text on one line."""
        return json.dumps(self.data, ensure_ascii=False, allow_nan=False)

    def __repr__(self) -> str:
        found = ", ".join(
            " ".join([name, *filter(None, estimate(entry)[::2])]) for name, entry in self.parameters.items()
        )
        what = found if self.status == "estimated" else self.status
        return f"<WindowEstimate {self.window}, {self.t_start:.6g} .. {self.t_end:.6g} s: {what}>"

    def __str__(self) -> str:
        """One window of a tracker in one line, with further lines for what happened in it."""
        span = f"{self.t_start:9.4f} .. {self.t_end:.4f} s"
        if self.status != "estimated":
            lines = [f"{span}  skipped: {self.why}"]
        else:
            cells = []
            for name, entry in self.parameters.items():
                cells.append(f"{name} {estimate(entry)}")
            if self.disturbed_load_torque is not None and {"j", "b"} & set(self.parameters):
                cells.append(f"T_Ld {number(self.disturbed_load_torque, 4)} N·m")
            looks = ", ".join(self.drift.looks_like or ()) or "steady"
            rest = "" if self.converged else "  (not at rest)"
            lines = [f"{span}  {'  '.join(cells)}  {looks}{rest}"]
        lines += [hung("             ", f"{note['finding']}: {note['consequence']}") for note in self.notes]
        return "\n".join(lines)


class Tracker:
    """Follows parameters through a stream of samples; memory does not grow with the stream.

    `fit` names the parameters, with bounds in SI units or None for a wide range around the nameplate. An
    unknown load is fitted along with anything that acts on the speed. `window` is in s. `method` is "lm"
    (warm least squares, fast), "pso" (the paper's swarm: each window starts from the last one's result and
    seeks within the share `search` of it) or "pso+lm". `machine` is the nameplate, or a machine file that
    holds it. `load` and `load_value` are what is known of the load torque, as in Recording; left out, they
    are those of the machine file. Each estimate is the same for any number of `threads` and any way of
    cutting the stream into batches.

    Raises UsageError for settings that make no sense, and MachineError for a wrong machine file.
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
            window=number_of("window", window),
            method=method,
            swarm=swarm_settings(swarm or PAPER),
            search=number_of("search", search),
            seed=seed,
            load=load,
            load_value=load_value,
        )

    def update(self, batch: Any) -> list[WindowEstimate]:
        """Takes in samples and returns the windows that they complete.

        `batch` is a mapping of canonical names to arrays of shape (samples,) in SI units, a frame, or
        anything else with an Arrow stream; every batch has the same columns. Rows with a value that is not
        finite are left out and counted in the window's notes, and so are rows that repeat or come out of
        order. Where time runs far back a new run begins.

        An exception, KeyboardInterrupt included, leaves the tracker as it was: the same batch can be given
        again. Raises DataError for columns that cannot be used.
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
        """Ends the window under way, at the end of the stream, and returns it, if there is one."""
        return [WindowEstimate.from_json(text) for text in self._core.finish(threads=self._threads)]

    def state(self) -> bytes:
        """Everything the tracker knows, as UTF-8 JSON of schema pmsm-rs.tracker/1."""
        return self._core.state().encode()

    @classmethod
    def restore(cls, state: bytes | str, *, threads: int | None = None) -> Self:
        """The tracker whose `state()` this is; it goes on bit for bit.

        Raises DataError for anything else: another schema, damage, values that no tracker has.
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
    """Estimates of one window after the other, the last and perhaps shorter one included.

    `recording` is a Recording, a file name or a frame; in the latter two, rows with missing values are
    allowed and counted. For the other arguments see Tracker.

    Raises UsageError for settings that make no sense, MachineError for a wrong machine file, and DataError
    for columns that cannot be used.
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

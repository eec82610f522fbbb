"""A machine file to start from: what a recording tells of its machine, and open lines for the rest."""

from __future__ import annotations

import os
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from pathlib import PurePath
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .._core import Machine
from ..config.machine_file import MachineFile
from ..errors import Problem, printable, shown
from ..io.naming import meaning
from ..io.notes import entry, quoted
from ..io.signals import UNNAMED, Signal
from ..quantities.poles import Frame, PolePairs
from ..quantities.units import dimension_of
from ..quantities.vocabulary import COMMANDED
from ..quantities.wording import LONGEST
from ..results.words import listed

_WIDTH: Final = 100
_PLATE: Final = {
    "n_p": "pole pairs, half the number of poles",
    "r_s": "ohm, one phase",
    "l_d": "H",
    "l_q": "H",
    "psi_m": "V s, flux linkage of the magnets, peak per phase",
    "j": "kg m^2, everything that turns",
    "b": "N m s, viscous friction",
}
_LOADS: Final = (
    "none, known_constant (value = ... in N m), measured, unknown_constant, unknown_piecewise, locked"
)
_CHOICES: Final = (
    "v_d, v_q, v_a, v_b, v_c (V), i_a, i_b, i_c, i_d, i_q (A), theta_e, theta_m (rad, deg, rev), "
    "omega_e, omega_m (rad/s, rpm, Hz), tau_m, tau_e (N·m), v_dc (V), t (s, ms, us)"
)
_MOST: Final = 24
"""Columns that are offered: a file may have thousands."""
_MOST_DOUBTFUL: Final = 60
"""Columns in doubt that get a line of their own."""
_CURRENTS: Final = ("i_a", "i_b", "i_c", "i_d", "i_q")
_VOLTAGES: Final = frozenset({"v_d", "v_q", "v_a", "v_b", "v_c"})
_SLOWEST_CONTROL: Final = 1.01e-3
"""Longest sample time, s, that may be the period of a current control."""
_SHAFT: Final = {"omega_m": "omega_e", "n": "omega_e", "theta_m": "theta_e"}
"""Motion of the shaft, and the electrical one that it gives, too."""
_PART: Final = re.compile(r"""from = ("[^"]+")""")
"""How the reason why an array cannot be read names one of its columns."""


def machine_file(
    file: str | None,
    columns: Mapping[str, NDArray[np.float64]],
    signals: Iterable[Signal],
    described: MachineFile | Machine | None,
    *,
    pairs: PolePairs | None,
    frames: Mapping[str, Frame],
    period: float | None,
    still: bool,
    open_lines: Iterable[Problem],
    incomplete: bool,
) -> str:
    """The text of a machine file for the recording `file`.

    `columns` are its canonical SI columns of shape (samples,), `signals` the columns of the file, and
    `described` what is known already. `pairs` are the pole pairs that the motion shows, and `frames` what it
    shows of doubtful columns. `period` is the sample time (s) of a waveform; `still` is a rotor that stands.
    `open_lines` are the problems that a line of [columns] would settle. `incomplete` says that quantities are
    missing, so that columns whose names say nothing are offered, too.
    """
    known = described.machine if isinstance(described, MachineFile) else described
    name = "a recording" if file is None else shown(PurePath(file).name)
    head = [
        f"# Machine file for {name}.",
        "# Lines such as #r_s = are open: fill in the value and remove the #. Only n_p is always needed.",
        "# What stays open is estimated from the recording, or the diagnosis says that it cannot.",
    ]
    tables = [
        _plate(known, pairs, frames),
        _drive(known, columns, period),
        _load(described, columns, still),
        _columns(described, [*signals], frames, [*open_lines], {*columns}, incomplete),
    ]
    return "\n".join("\n".join(lines) + "\n" for lines in [head, *tables])


def _plate(known: Machine | None, pairs: PolePairs | None, frames: Mapping[str, Frame]) -> list[str]:
    told = [(frame.n_p, f"'{shown(column)}'", frame) for column, frame in frames.items() if frame.n_p]
    lines = ["[machine]"]
    for name, comment in _PLATE.items():
        value = None if known is None else getattr(known, name)
        if name == "n_p" and value is None and pairs is not None:
            seen = f"{pairs.electrical} turns {pairs.ratio:.4g} times as fast as {pairs.mechanical}"
            lines.append(_line(name, pairs.n_p, f"{comment}; {seen}"))
        elif name == "n_p" and value is None and told:
            n_p, column, frame = told[0]
            lines.append(_line(name, n_p, f"{comment}; by {frame.beside} beside {column}"))
        else:
            needed = ", needed" if name == "n_p" and value is None else ""
            lines.append(_line(name, value, comment + needed))
    return lines


def _drive(
    known: Machine | None, columns: Mapping[str, NDArray[np.float64]], period: float | None
) -> list[str]:
    v_dc, i_rated, f_sample = (
        None if known is None else getattr(known, name) for name in ("v_dc", "i_rated", "f_sample")
    )
    told = {"v_dc": "V, DC link", "i_rated": "A, peak", "f_sample": "Hz, rate of the control"}
    link = columns.get("v_dc", np.empty(0))
    if v_dc is None and np.isfinite(link).any() and np.nanmedian(link) > 0.0:
        v_dc = float(f"{np.nanmedian(link):.4g}")
        told["v_dc"] += ", median of the recording"
    peaks = [np.nanmax(np.abs(columns[name])) for name in _CURRENTS if _has_values(columns, name)]
    if i_rated is None and peaks and max(peaks) > 0.0:
        told["i_rated"] += f"; the recording reaches {max(peaks):.3g} A"
    lines = ["[drive]", _line("v_dc", v_dc, told["v_dc"]), _line("i_rated", i_rated, told["i_rated"])]
    if f_sample is None and period is not None and not _VOLTAGES.isdisjoint(columns):
        if period <= _SLOWEST_CONTROL:
            rate = f"#f_sample = {1.0 / period:.5g}"
            return [*lines, f"{rate:<18}  # {told['f_sample']}, if each of its periods was logged"]
        told["f_sample"] += f"; this log is slower, at {1.0 / period:.5g} Hz"
    return [*lines, _line("f_sample", f_sample, told["f_sample"])]


def _has_values(columns: Mapping[str, NDArray[np.float64]], name: str) -> bool:
    return name in columns and bool(np.isfinite(columns[name]).any())


def _load(
    described: MachineFile | Machine | None, columns: Mapping[str, NDArray[np.float64]], still: bool
) -> list[str]:
    given = described if isinstance(described, MachineFile) else None
    kind = "measured" if "tau_m" in columns else "unknown_constant"
    lines = ["[load]", f"# {_LOADS}"]
    if given is not None and given.load is not None:
        value = [] if given.load_value is None else [_line("value", given.load_value, "N m")]
        return [*lines, f'kind = "{given.load}"', *value]
    if still:
        lines.append('# the rotor stands: where it was held, write kind = "locked"')
    return [*lines, f'kind = "{kind}"']


def _columns(
    described: MachineFile | Machine | None,
    signals: Sequence[Signal],
    frames: Mapping[str, Frame],
    problems: Sequence[Problem],
    have: set[str],
    incomplete: bool,
) -> list[str]:
    given = described.columns if isinstance(described, MachineFile) else {}
    lines = ["[columns]"]
    if isinstance(described, MachineFile) and described.dbc is not None:
        lines.append(f"dbc = {quoted(os.path.abspath(described.dbc))}")
    lines += [f"{name} = {entry(rule)}" for name, rule in given.items()]
    doubtful = _doubtful(signals, problems, have | {*given})
    offered = [name for signal in doubtful for name in _named(signal)]
    if len(offered) > len({*offered}):
        lines.append("# Take one line of each name at most.")
    for signal in doubtful[:_MOST_DOUBTFUL]:
        if (frame := frames.get(signal.column)) is not None:
            lines += _comment(f"'{shown(signal.column)}': {frame.name}, as {frame.beside} shows")
            lines += [line for line in signal.use if line.startswith(f"{frame.name} =")]
            continue
        choice = "; keep the right line" if len(signal.use) > 1 else ""
        others = [name for name in signal.could_be if not signal.use[0].startswith(f"{name} =")]
        if others and len(signal.use) == 1:
            choice = f"; it could also be {listed(others, 'or')}"
        if signal.unit is None and "unit" not in (signal.why or ""):
            choice += "; check the unit, which the file does not state"
        lines += _comment(f"'{shown(signal.column)}': {signal.why or ''}{choice}")
        lines += [f"#{line}" for line in signal.use]
    if len(doubtful) > _MOST_DOUBTFUL:
        lines.append(f"# and {len(doubtful) - _MOST_DOUBTFUL} more columns like these")
    if "t" not in have and not any(line.startswith("t =") for signal in doubtful for line in signal.use):
        lines.append("#t = { period =  }  # s from row to row, where the file has no time")
    told = {line for signal in doubtful for line in signal.use}
    absent = (line for each in problems for line in each.lines if line not in told)
    lines += [f"#{line}  # where it was held at this value" for line in absent]
    parts = [(each, _PART.search(each.why or "")) for each in signals if not each.names and not each.rows]
    silent = [each for each in signals if each.why == UNNAMED and each.low != each.high]
    silent = [each for each in silent if each.unit is None or dimension_of(each.unit) is not None]
    # No line is offered for a name that would hide the others.
    silent = [each for each in silent if len(each.column) <= LONGEST]
    for signal, part in parts if incomplete else ():
        if part is not None:
            lines += _comment(
                f"'{shown(signal.column)}': {signal.why}. Write a canonical name in place of NAME."
            )
            lines.append(f'#NAME = {{ from = {part[1]}, unit = "..." }}')
    if incomplete and silent:
        lines += _comment(
            "Columns whose names say nothing. For each signal of the motor write its canonical name "
            f"in place of NAME, which is one of {_CHOICES}."
        )
        lines += [
            f"#NAME = {{ from = {quoted(signal.column)}, unit = {quoted(signal.unit or '...')} }}"
            for signal in silent[:_MOST]
        ]
        if len(silent) > _MOST:
            lines.append(f"# and {len(silent) - _MOST} more")
    return lines if len(lines) > 1 else ["# [columns] is not needed: no column is in doubt."]


def _doubtful(signals: Iterable[Signal], problems: Iterable[Problem], have: set[str]) -> list[Signal]:
    """The columns that get lines of their own.

    They are those in doubt, and those that may give what the canonical columns of `have` do not. A constant
    gives nothing, and a reference is only offered where no other column gives its quantity.
    """
    open_lines = {problem.lines for problem in problems}
    known = {_SHAFT.get(name, name) for name in have}
    own = [signal for signal in signals if not signal.names and signal.use]
    out = [
        signal
        for signal in own
        if signal.use in open_lines or (known.isdisjoint(_named(signal)) and signal.low != signal.high)
    ]
    plain = {name for signal in out if not _is_reference(signal) for name in _named(signal)}
    return [signal for signal in out if not _is_reference(signal) or plain.isdisjoint(_named(signal))]


def _named(signal: Signal) -> set[str]:
    """The canonical columns that the lines of a column would give, those of the shaft as electrical ones."""
    names = (line.partition(" =")[0] for line in signal.use)
    return {_SHAFT.get(name, name) for name in names}


def _is_reference(signal: Signal) -> bool:
    found = meaning(signal.column, signal.unit)
    return found is not None and found.role == COMMANDED


def _comment(text: str) -> list[str]:
    plain = " ".join(printable(text).split())
    return textwrap.wrap(plain, _WIDTH, initial_indent="# ", subsequent_indent="# ", break_on_hyphens=False)


def _line(name: str, value: float | None, comment: str) -> str:
    head = f"#{name} =" if value is None else f"{name} = {value:.10g}"
    return f"{head:<18}  # {comment}"

"""What `inspect` says of a file, as text for terminals."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Sequence
from pathlib import PurePath
from typing import Final

from ..errors import printable, shown
from ..io.reading import TORQUE_POINTS
from ..io.reading import there as quantities
from ..io.signals import Signal
from ..plot.sparkline import ASCII, BLOCKS, sparkline
from ..quantities.canonical import CANONICAL
from ..results.words import listed, with_signs
from ..view.summary import finding, hung
from .values import InspectionValues, Task

_LONGEST: Final = 25
"""Signs of a name in a table."""
_MOST: Final = 40
"""Columns in a table, and things to settle: a file may have thousands."""
_NAMED: Final = 8
"""Columns that one reason names."""
_NAMELESS: Final = "(no name)"
_USUAL_CONSTANT: Final = 1e-3
"""Electrical time constant of a motor, s, that goes without saying: few have a shorter one."""
_READABLE: Final = 1e9
"""Numbers below this are written without a power of ten, as times in ms are."""
_CLOSE: Final = 0.005
"""Share of its ends that a range is small to."""
_ASCII: Final = {
    **{
        "·": ".",
        "…": "...",
        "µ": "u",
        "°": "deg",
        "Ω": "ohm",
        "²": "^2",
        "–": "-",
        "α": "alpha",
        "β": "beta",
    },
}

KINDS: Final = {
    "full": "A waveform with voltages, currents and motion.",
    "electrical": "A waveform with the rotor held.",
    "derived": "A waveform with voltages and currents, from which the angle is taken.",
    "mechanical": "Motion with torque or currents, without a voltage vector.",
    "operating_points": "Steady operating points: the rows are too far apart to show a transient.",
    "torque_points": "Steady points of torque, without a voltage vector.",
    "open_circuit": "Voltages of open terminals, with the rotor turned from outside.",
}


def text(found: InspectionValues, *, blocks: bool = True, machine_file: bool = True) -> str:
    """The inspection as lines; without `blocks` in plain ASCII, for terminals that show no other signs, and
    without the `machine_file` where it stands elsewhere.
    """
    lines = [*_head(found), *_used(found, blocks), *_unused(found, blocks), *_questions(found)]
    if found.tasks:
        lines += ["", "To settle before a diagnosis"]
        for count, task in enumerate(found.tasks[:_MOST], 1):
            lines.append(hung(f"  {count}  ", f"{_subject(task)}{task.problem}; {task.fix}"))
        if len(found.tasks) > _MOST:
            lines.append(f"  and {len(found.tasks) - _MOST} more, which the answer in JSON lists")
    if found.findings:
        lines += ["", "Findings"]
        for item in found.findings:
            lines.append(hung("  ! ", with_signs(finding(item))))
    if machine_file:
        lines += ["", "Machine file to start from"]
        lines += [f"  {line}".rstrip() for line in found.machine_file.splitlines()]
    whole = printable("\n".join(lines))
    return whole if blocks else plain(whole)


def _subject(task: Task) -> str:
    """The column of a task as the sentence begins with it."""
    if task.column is None or (task.column == "t" and task.problem.startswith("there ")):
        return ""
    if task.problem.startswith(f"{task.column} "):
        return ""
    plain = task.column in CANONICAL and task.problem.startswith(("is ", "has "))
    return f"{task.column} " if plain else f"'{shown(task.column)}': "


def plain(text: str) -> str:
    """`text` in ASCII: signs that it lacks are spelled, or written as escape sequences."""
    spelled = "".join(_ASCII.get(sign, sign) for sign in text)
    return spelled.encode("ascii", errors="backslashreplace").decode()


def _head(found: InspectionValues) -> list[str]:
    lines = [shown(found.file) if found.file is not None else "recording in memory"]
    if not found.sampling:
        rows = max((signal.rows for signal in found.columns), default=0)
        lines.append(f"  {rows} rows, without sample times")
    for entry in found.sampling:
        own = [each.column for each in found.columns if each.base == entry.group is not None]
        members = f"{_columns(own)} of " if own else ""
        group = "" if entry.group is None else f"{members}group '{shown(entry.group)}': "
        lines.append(hung("  ", group + entry.sentence()))
    gaps = {each.column: each.missing for each in found.columns if each.missing and not each.is_empty}
    if gaps:
        count = sum(gaps.values())
        lines.append(hung("  ", f"{count} missing value{'s' if count > 1 else ''} in {_columns(gaps)}"))
    if found.kind is not None:
        held = found.load == "locked" and found.kind != "electrical"
        derived = found.kind == "electrical" and found.load != "locked"
        torque = found.why_not.get("motion") == TORQUE_POINTS
        kind = "derived" if derived else "torque_points" if torque else found.kind
        lines.append(f"  {KINDS[kind]}" + (" The rotor is held." if held else ""))
    else:
        lines.append(hung("  ", f"It cannot be diagnosed yet: {_so_far(found)}"))
    return lines


def _so_far(found: InspectionValues) -> str:
    """Which quantities are there, and how much is to be settled."""
    have = {*found.made} | {name for signal in found.columns for name in signal.names}
    parts = {"sample time": "t" in have, **quantities(have)}
    known = [part for part, is_there in parts.items() if is_there]
    lost = [part for part, is_there in parts.items() if not is_there]
    count = "one thing is" if len(found.tasks) == 1 else f"{len(found.tasks)} things are"
    told = f"Recognised: {listed(known)}. " if known else ""
    left = f"Not recognised: {listed(lost)}." if lost else ""
    return f"{count} to be settled. {told}{left}".rstrip()


def _columns(names: Iterable[str]) -> str:
    several = [f"'{shown(name)}'" for name in names]
    return listed(several) if len(several) <= _NAMED else f"{len(several)} columns"


def _used(found: InspectionValues, blocks: bool) -> list[str]:
    rows = [
        (", ".join(signal.names), *_cells(signal, blocks), signal.how or "")
        for signal in found.columns
        if signal.names
    ]
    rows += [(name, origin, "", "", "", "", "[columns]") for name, origin in found.made.items()]
    if not rows:
        return ["", "No column was recognised"]
    head = ("taken as", "column", "range", "unit", "missing", "course", "recognised by")
    lines = ["", "Columns that are used (course: the highest value of each stretch)", *_table(head, rows)]
    unread = [signal for signal in found.columns if signal.names and signal.why]
    return [*lines, *_reasons(unread)]


def _unused(found: InspectionValues, blocks: bool) -> list[str]:
    unused = [signal for signal in found.columns if not signal.names]
    if not unused:
        return []
    # What looks like a signal comes first.
    ranked = sorted(unused, key=lambda signal: not signal.use)
    head = ("column", "range", "unit", "missing", "course")
    lines = ["", "Columns that are not used"]
    lines += _table(head, [_cells(signal, blocks) for signal in ranked[:_MOST]])
    if len(ranked) > _MOST:
        lines.append(f"  and {len(ranked) - _MOST} more, which the answer in JSON lists")
    return [*lines, *_reasons(ranked)]


def _cells(signal: Signal, blocks: bool) -> tuple[str, ...]:
    span = _span(signal.low, signal.high)
    levels = BLOCKS if blocks else ASCII
    line = "" if signal.names == ("t",) else sparkline(signal.course, signal.low, signal.high, levels)
    name = shown(signal.column) or _NAMELESS
    if len(name) > _LONGEST:
        name = f"{name[: _LONGEST - 10]}…{name[-9:]}"
    unit = printable((signal.unit or "")[:_LONGEST])
    gaps = str(signal.missing) if signal.missing and not signal.is_empty else ""
    cells = (name, span, unit, gaps, "empty" if signal.is_empty else line)
    return cells if blocks else tuple(map(plain, cells))


def _span(low: float | None, high: float | None) -> str:
    """The range, with more digits where its ends are close together."""
    if low is None or high is None:
        return ""
    close = high / 2.0 - low / 2.0 <= _CLOSE * max(abs(low), abs(high))
    first, last = (_short(value, 7 if close else 4) for value in (low, high))
    return first if low == high else f"{first} … {last}"


def _short(value: float, digits: int) -> str:
    """A number with so many digits, and with all of those before the point where a person can read them."""
    whole = 1e4 <= abs(value) < _READABLE
    return f"{value:.0f}" if whole and len(f"{abs(value):.0f}") > digits else f"{value:.{digits}g}"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows below their head; a column without entries is left out."""
    kept = [k for k in range(len(head)) if any(row[k] for row in rows)]
    wide = {k: max(len(head[k]), *(len(row[k]) for row in rows)) for k in kept}

    def line(cells: Sequence[str]) -> str:
        return "  " + "  ".join(f"{cells[k]:<{wide[k]}}" for k in kept).rstrip()

    return [line(head), *map(line, rows)]


def _reasons(signals: Sequence[Signal]) -> list[str]:
    """Why columns are not used, one entry for each reason."""
    grouped: dict[str, list[str]] = {}
    for signal in signals:
        if signal.why is not None:
            grouped.setdefault(signal.why, []).append(shown(signal.column) or _NAMELESS)
    if len(grouped) == 1 and len(signals) > _NAMED:
        [why] = grouped
        return [hung("    ", f"all of them: {why}")]
    return [hung("    ", f"{_some(names)}: {why}") for why, names in grouped.items()]


def _some(names: list[str]) -> str:
    more = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {more} more" if more > 0 else "")


def _questions(found: InspectionValues) -> list[str]:
    if not found.is_ready:
        return []
    lines = ["", "Questions"]
    for question, what in (
        ("electrical", "voltages"),
        ("mechanical", "motion"),
        ("rotor angle", "rotor angle"),
    ):
        why = found.why_not.get(what)
        if why is not None:
            lines.append(hung(f"  {question:<13}", f"no, nothing can be asked of the {what}: {why}"))
        elif what == "voltages" and found.shortest_constant > _USUAL_CONSTANT:
            needed = f"{1e3 * found.shortest_constant:.3g}"
            told = f"yes, if l/r_s of the motor is above {needed} ms; else the rows lie too far apart"
            lines.append(hung(f"  {question:<13}", told))
        elif what != "rotor angle":
            lines.append(f"  {question:<13}yes")
    return lines


def _argument(path: str) -> str:
    """A path as a shell takes it, whole and however long it is."""
    return shlex.quote(printable(path))


def next_steps(found: InspectionValues, machine: str | None, written: str | None) -> str:
    """The commands that come next, as lines; `machine` names the machine file that was given, `written` the
    one that was written.
    """
    recording = "RECORDING" if found.file is None else _argument(found.file)
    name = _argument(written or machine or "machine.toml")
    report = _argument(f"{PurePath(found.file or 'RECORDING').stem}.html")
    diagnose = f"pmsm-rs diagnose {recording} --machine {name} --report {report}"
    steps = [f"open {name} and fill in what you know", diagnose]
    if written is None and machine is None:
        steps = [f"pmsm-rs inspect {recording} --write {name}", *steps]
    elif written is None and found.is_ready:
        steps = [diagnose]
    elif written is None:
        steps = [f"settle in {name} what stands above", diagnose]
    return "\n".join(["Next", *(f"  {k}  {step}" for k, step in enumerate(steps, 1))])

"""A recording with its machine file as an archive without names, for a report or a question."""

from __future__ import annotations

import json
import os
import shlex
import tempfile
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from .. import _core, atomic
from .._core import DataError, UsageError
from ..config.machine_file import MachineFile, read_machine, read_toml
from ..config.nameplate import PARAMETERS, RATINGS, machine_text
from ..errors import opened, refuse, shown
from ..io.loader import load, load_columns
from ..quantities.canonical import CANONICAL, ordered
from ..results import tabular
from ..results.estimates import IdentificationValues, json_text
from ..results.findings import DiagnosisValues
from ..results.words import listed

SCHEMA: Final = "pmsm-rs.bundle/1"
FEWEST: Final = 2
"""Rows that a recording has at least."""
LARGE: Final = 25_000_000
"""Bytes that trackers of issues commonly take as a file."""

_LARGEST_ANSWER: Final = 64 << 20
_EPOCH: Final = (1980, 1, 1, 0, 0, 0)
"""The time of all files in the archive: the same recording gives the same bytes."""
_KEPT: Final = {"machine": PARAMETERS, "drive": RATINGS, "load": ("kind", "value")}


@dataclass(frozen=True)
class Bundle:
    """What was written: per file in the archive what it holds, and what was removed, in words."""

    path: str
    size: int
    files: Mapping[str, str]
    removed: tuple[str, ...]

    def __str__(self) -> str:
        wide = max(map(len, self.files))
        folder = Path(self.path).stem
        again = ["pmsm-rs", "diagnose", f"{folder}/recording.parquet", "--machine", f"{folder}/machine.toml"]
        if "validation.parquet" in self.files:
            again += ["--validate", f"{folder}/validation.parquet"]
        lines = [
            f"{self.path}, {_size(self.size)}",
            "",
            "Written",
            *(f"  {name:<{wide}}  {what}" for name, what in self.files.items()),
            "",
            "Removed",
            *(f"  {what}" for what in self.removed),
            "",
            "Next",
            f"  1  {shlex.join(['unzip', self.path, '-d', folder])}",
            f"  2  {shlex.join(again)}",
            "  3  look whether you may pass it on: the samples themselves are unchanged",
        ]
        if self.size > LARGE:
            lines.append(f"  4  cut it by --rows: trackers of issues commonly take {_size(LARGE)}")
        return "\n".join(lines)


def bundle(
    recording: str | os.PathLike[str],
    machine: str | os.PathLike[str],
    path: str | os.PathLike[str],
    *,
    validation: str | os.PathLike[str] | None = None,
    answer: str | os.PathLike[str] | None = None,
    rows: slice = slice(None),
) -> Bundle:
    """Writes the recording, its machine file and, where they are given, the `validation` run and the `answer`
    of a diagnosis or an identification to the archive `path`.

    Columns have their canonical names and SI units, times begin at zero, and columns that are not used are
    left out. Of the machine file remain the parameters, the ratings and the load, of the answer what names no
    file and no column. `rows` of both runs are kept, numbered from 0.

    Raises UsageError where a file is missing or `path` cannot be written, and MachineError for a bad machine
    file. Raises DataError for a recording that cannot be read, for too few rows, and for what is no answer.
    """
    described = read_machine(machine)
    runs = {"recording": recording, **({} if validation is None else {"validation": validation})}
    removed: list[str] = []
    tables, files = {}, {}
    for name, file in runs.items():
        columns, gone = _columns(file, described, rows)
        tables[f"{name}.parquet"] = columns
        files[f"{name}.parquet"] = f"{len(columns['t'])} rows of {', '.join(columns)}; SI units, t from zero"
        removed += [f"{name}: {what}" for what in gone]
    texts = {"machine.toml": machine_text(described.machine, described.load, described.load_value)}
    given = [line.partition(" =")[0] for line in texts["machine.toml"].splitlines() if "=" in line]
    files["machine.toml"] = listed(given)
    removed += [f"machine file: {what}" for what in _unkept(described)]
    if answer is not None:
        data, gone = _anonymous(answer)
        texts["answer.json"] = json_text(data)
        kind = f"diagnosis, {data['verdict']}" if "verdict" in data else "identification"
        files["answer.json"] = f"{kind}, by version {data.get('version')}"
        removed += [f"answer: {what}" for what in gone]
    about = {"schema": SCHEMA, "version": _core.__version__, "files": files, "rows": [rows.start, rows.stop]}
    texts["about.json"] = json_text(about)
    files["about.json"] = "version of the package, and this list"
    _write(path, tables, texts)
    return Bundle(str(path), os.path.getsize(path), files, tuple(removed))


def parse_rows(text: str) -> slice:
    """Rows as on the command line: `N` for the first N, `FIRST:END` with either left out.

    Raises UsageError for anything else.
    """
    first, mark, end = text.rpartition(":")
    try:
        given = [int(part) if part.strip() else None for part in (first, end)]
        if any(part is not None and part < 0 for part in given):
            raise ValueError
    except ValueError:
        raise refuse(
            UsageError, f"'{text}' says no rows", fix="write N for the first N, or FIRST:END, from 0"
        ) from None
    return slice(given[0] if mark else None, given[1])


def _columns(
    file: str | os.PathLike[str], described: MachineFile, rows: slice
) -> tuple[dict[str, NDArray[np.float64]], list[str]]:
    """The canonical columns as they were read, times from zero, and what was removed."""
    account = load(file, described).account
    # Not those of the recording: what it derives from others is derived again by whoever reads the bundle.
    whole = load_columns(file, described)
    columns = {name: whole[name][rows] for name in ordered([*whole])}
    kept, total = len(columns["t"]), len(whole["t"])
    if kept < FEWEST:
        raise refuse(
            DataError,
            f"{kept} of {total} rows are left",
            file=str(file),
            fix=f"let --rows keep at least {FEWEST}",
        )
    start = float(columns["t"][0])
    columns["t"] = columns["t"] - start
    renamed = {name: rule.source for name, rule in account.columns.items() if rule.source not in (None, name)}
    gone = ["its name and folder"]
    if renamed:
        gone.append(f"names of {len(renamed)} columns; they have the canonical ones")
    if account.ignored:
        gone.append(f"{len(account.ignored)} columns that are not used")
    if start:
        gone.append("the time at which it begins")
    if kept < total:
        gone.append(f"{total - kept} of {total} rows")
    return columns, gone


def _unkept(described: MachineFile) -> list[str]:
    """What of the machine file is not kept."""
    content = read_toml(described.path)
    gone = ["comments"]
    for table, entries in content.items():
        known = _KEPT.get(table)
        if known is None or not isinstance(entries, dict):
            gone.append(f"[{shown(table)}]" if isinstance(entries, dict) else shown(table))
        else:
            gone += [f"{table}.{shown(name)}" for name in entries if name not in known]
    if described.converted:
        gone.append("the units of the data sheet; values are in SI units")
    return gone


def _anonymous(file: str | os.PathLike[str]) -> tuple[dict[str, Any], list[str]]:
    """An answer without what names files and columns, and what was removed of it. Raises DataError."""
    name = str(file)
    fix = "give what --json of diagnose or identify wrote"
    with opened(name, "answer") as path:
        if path.stat().st_size > _LARGEST_ANSWER:
            raise refuse(DataError, "it is far too large for an answer", file=name, fix=fix)
        content = path.read_bytes()
    try:
        data = json.loads(content.decode(), parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        raise refuse(DataError, "it is no JSON", file=name, fix=fix) from error
    try:
        kind = DiagnosisValues if "verdict" in data else IdentificationValues
        kind.of(data)
        reads = data.get("read") or []
        names = {entry for read in (reads if isinstance(reads, list) else [reads]) for entry in _named(read)}
        recordings = [{**entry, "file": None} for entry in data.get("recordings", ())]
        findings = [entry for entry in data.get("data_quality", ()) if not _tells(entry, names)]
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        raise refuse(DataError, "it is no answer of this package", file=name, fix=fix) from error
    gone = ["'read', the account of the columns"] if "read" in data else []
    out = {part: value for part, value in data.items() if part != "read"}
    if recordings:
        out["recordings"] = recordings
        gone.append("names of the files")
    if len(findings) < len(data.get("data_quality", ())):
        out["data_quality"] = findings
        gone.append("findings that name columns")
    return out, gone


def _no_number(text: str) -> float:
    raise ValueError(f"{text} is no number of JSON")


def _tells(finding: Mapping[str, str], names: set[str]) -> bool:
    """Whether a finding holds one of the `names` in quotes."""
    return any(f"'{shown(name)}'" in text for text in finding.values() for name in names)


def _named(read: Mapping[str, Any]) -> list[str]:
    """Names of columns in the file, as an answer tells them, but for those that are canonical."""
    names = [entry.get("from") for entry in read.get("columns", {}).values()]
    names += [*read.get("ignored", ()), *(entry["column"] for entry in read.get("not_used", ()))]
    return [name for name in names if isinstance(name, str) and name not in CANONICAL]


def _write(
    path: str | os.PathLike[str],
    tables: Mapping[str, Mapping[str, NDArray[np.float64]]],
    texts: Mapping[str, str],
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        for name, columns in tables.items():
            tabular.write(Path(folder) / name, columns)
        contents = {name: (Path(folder) / name).read_bytes() for name in tables}
    contents |= {name: text.encode() for name, text in texts.items()}

    def fill(draft: Path) -> None:
        with zipfile.ZipFile(draft, "w") as archive:
            for name, content in contents.items():
                entry = zipfile.ZipInfo(name, _EPOCH)
                entry.compress_type = zipfile.ZIP_DEFLATED
                entry.external_attr = 0o644 << 16
                archive.writestr(entry, content)

    atomic.write(path, fill)


def _size(count: int) -> str:
    return f"{count / 1e6:.3g} MB" if count >= 1_000_000 else f"{count / 1e3:.3g} kB"

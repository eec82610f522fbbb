"""The machine file: TOML in, everything wrong with it said at once."""

from __future__ import annotations

import os
import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from .._core import Machine, MachineError, PmsmError
from ..errors import clauses, did_you_mean, message, opened, refuse, shown
from ..mistaken import HEAD, is_answer, is_recording
from ..quantities.canonical import CANONICAL
from ..quantities.units import canonical, suggest
from .datasheet import Converted, settled
from .effect_text import Effect, of_tables
from .rules import Rule, Rules
from .schema import NotNegative, Number, Positive, Table, validated

_DBC = "dbc"
"""Key of [columns] that names no column but the description of a CAN bus."""
_LARGEST_FILE = 1 << 20
# Parts of a dotted key, of which Python's reader takes the square.
_DEEPEST = 32
# Characters of the name of a column that is mapped.
_LONGEST_NAME = 4096
# Entries of a table: all of them that are not known are told, with the nearest that is.
_MOST_ENTRIES = 1000
_MARK = re.compile(r"\"\"\"|'''|[\"'#\n.=,\[\]{}]")
# How strings and comments end. No part of them can match in two ways.
_ENDS = {
    '"': re.compile(r'(?:[^"\\\n]|\\.)*+["\n]'),
    "'": re.compile(r"[^'\n]*+['\n]"),
    "#": re.compile(r"[^\n]*+"),
    '"""': re.compile(r'(?:[^"\\]|\\.|"{1,2}+(?!"))*+"{3,5}', re.DOTALL),
    "'''": re.compile(r"(?:[^']|'{1,2}+(?!'))*+'{3,5}"),
}
_DECIMAL_COMMA = re.compile(r"(?<==)\s*[-+]?\d+,\d+(?:[eE][-+]?\d+)?(?=\s*(?:#|\}|$))")
_NO_VALUE = re.compile(r"\s*([\w.-]+)\s*=\s*(?:#|$)")
# A whole number beyond 64 bits has at least as many digits, be they hexadecimal.
_LONG_NUMBER = re.compile(r"[0-9A-Fa-f_]{16,}")
LoadKind = Literal["none", "known_constant", "measured", "unknown_constant", "unknown_piecewise", "locked"]


class Plate(Table):
    """Parameters of a machine, SI, any of them unknown."""

    n_p: Annotated[int | None, Field(ge=1)] = None
    r_s: Positive | None = None
    l_d: Positive | None = None
    l_q: Positive | None = None
    psi_m: NotNegative | None = None
    j: Positive | None = None
    b: NotNegative | None = None


class _Machine(Plate):
    n_p: Annotated[int, Field(ge=1)]


class Ratings(Table):
    """What a drive is built for, SI, any of it unknown."""

    v_dc: Positive | None = None
    i_rated: Positive | None = None
    f_sample: Positive | None = None


class _Load(Table):
    kind: LoadKind | None = None
    value: Number | None = None

    @model_validator(mode="after")
    def _value_goes_with_kind(self) -> _Load:
        if self.kind == "known_constant" and self.value is None:
            raise ValueError("a known_constant load needs value = ... in N m")
        if self.kind != "known_constant" and self.value is not None:
            raise ValueError("value goes with kind = 'known_constant' only")
        return self


class _Column(Table):
    source: Annotated[str | None, Field(alias="from", max_length=_LONGEST_NAME)] = None
    unit: str | None = None
    scale: Number = 1.0
    offset: Number = 0.0
    period: Positive | None = None
    value: Number | None = None
    file: str | None = None

    @model_validator(mode="after")
    def _one_origin(self) -> _Column:
        if [self.source, self.period, self.value].count(None) != 2:
            raise ValueError("say one of from = '...', value = ..., and, for t only, period = ... in s")
        if self.period is not None and (self.unit, self.scale, self.offset) != (None, 1.0, 0.0):
            raise ValueError("period is in s; unit, scale and offset do not go with it")
        if self.file is not None and self.source is None:
            raise ValueError("file goes with from = '...', the column in that file")
        if self.scale == 0.0:
            raise ValueError("scale = 0 would erase the column")
        return self


_TABLES: dict[str, type[Table]] = {"machine": _Machine, "drive": Ratings, "load": _Load}


@dataclass(frozen=True)
class MachineFile:
    """A machine file: the nameplate, what is known of the load, and how a recording's columns are called.

    `converted` are the entries of the nameplate that were not given as parameters of the model in SI units.
    `dbc` is the file that describes the CAN bus of a recording, found from the folder of the machine file.
    `effects` are those given as text, which a diagnosis asks about besides the catalogue.
    `allow_outside` lets columns come from files that lie outside of the recording's folder.
    """

    path: str
    machine: Machine
    load: str | None
    load_value: float | None
    columns: Rules
    converted: tuple[Converted, ...] = ()
    dbc: str | None = None
    allow_outside: bool = False
    effects: tuple[Effect, ...] = ()


def read_machine(path: str | os.PathLike[str], *, allow_outside: bool = False) -> MachineFile:
    """The machine file at `path`. With `allow_outside` its columns may come from anywhere, else only from
    files in the recording's folder and below it.

    Raises UsageError where there is no such file, and MachineError naming every wrong entry by its path.
    """
    name = str(path)
    content = read_toml(name)
    errors = [f"{table}: unknown table ({hint})" for table, hint in _misspelt(content)]
    table = content.get("machine")
    sheet = settled(table if isinstance(table, dict) else {}, errors)
    given = content | ({"machine": sheet.values} if isinstance(table, dict) else {})
    parts = {name: validated(model, name, given.get(name), errors) for name, model in _TABLES.items()}
    table = content.get("columns", {})
    columns, dbc = _columns(table, errors), _dbc(table, name, errors)
    own = of_tables(content.get("effects"), errors)
    plate, drive, load = parts["machine"], parts["drive"], parts["load"]
    if sheet.i_rated is not None and isinstance(drive, Ratings) and drive.i_rated is not None:
        errors.append("machine.i_rated: [drive] has it as well; give it once")
    if errors:
        raise refuse(MachineError, clauses(errors), file=name, fix="correct the machine file")
    assert isinstance(plate, _Machine)
    assert isinstance(drive, Ratings)
    assert isinstance(load, _Load)
    ratings = drive.model_dump()
    ratings["i_rated"] = drive.i_rated if sheet.i_rated is None else sheet.i_rated
    try:
        machine = Machine(**plate.model_dump(), **ratings)
    except MachineError as error:
        raise refuse(
            MachineError, f"[machine] {message(error)}", file=name, fix="correct the machine file"
        ) from error
    entries = (load.kind, load.value, columns, tuple(sheet.converted), dbc, allow_outside, own)
    return MachineFile(name, machine, *entries)


def read_toml(name: str, role: str = "machine file", kind: type[PmsmError] = MachineError) -> dict[str, Any]:
    """The content of a TOML file that is to be a `role`. Raises UsageError where there is no such file, and
    `kind` where it is none.
    """
    with opened(name, role) as file:
        if file.stat().st_size > _LARGEST_FILE:
            with file.open("rb") as handle:
                _expect_other_than(handle.read(HEAD), name, role, kind)
            raise refuse(kind, f"it is far too large for a {role}", file=name, fix="name the TOML file")
        data = file.read_bytes()
    try:
        text = data.decode("utf-8-sig")
        _check_nesting(text, name, kind)
        if _LONG_NUMBER.search(text):
            _whole_numbers_fit(text, name, kind)
        content = tomllib.loads(text)
    except (UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        _expect_other_than(data[:HEAD], name, role, kind)
        what = (
            "it is no UTF-8 text"
            if isinstance(error, UnicodeDecodeError)
            else str(error) or "nested too deeply"
        )
        if isinstance(error, tomllib.TOMLDecodeError) and (slip := _slip(text)) is not None:
            row, what, fix = slip
            raise refuse(kind, what, file=name, row=row, place=f"line {row}", fix=fix) from error
        raise refuse(
            kind, f"this is no valid TOML ({what})", file=name, fix="correct it at that place"
        ) from error
    for where, table in [
        ("the file", content),
        *((f"[{shown(key)}]", part) for key, part in content.items()),
    ]:
        if isinstance(table, dict) and len(table) > _MOST_ENTRIES:
            raise refuse(
                kind,
                f"{where} has {len(table)} entries, more than {_MOST_ENTRIES}",
                file=name,
                fix="leave out what does not belong there",
            )
    return content


def _expect_other_than(head: bytes, name: str, role: str, kind: type[PmsmError]) -> None:
    """Raises `kind` where what is no TOML of a `role` begins as a recording or an answer does."""
    for is_other, what in ((is_answer, "an answer of this package"), (is_recording, "a recording")):
        if is_other(head):
            raise refuse(kind, f"this is {what}, not a {role}", file=name, fix=f"name the {role}")


def _slip(text: str) -> tuple[int, str, str] | None:
    """A usual slip in TOML that cannot be read: its line, what it is, and the way out; None without one."""
    for row, line in enumerate(text.splitlines(), start=1):
        if (found := _DECIMAL_COMMA.search(line)) is not None:
            fix = f"write {found[0].strip().replace(',', '.')}, with a decimal point"
            return row, f"{found[0].strip()} has a decimal comma", fix
        if (found := _NO_VALUE.match(line)) is not None:
            fix = "write a value behind the =, or put # in front of the line"
            return row, f"{shown(found[1])} has no value", fix
    return None


def _check_nesting(text: str, name: str, kind: type[PmsmError]) -> None:
    """Raises `kind` where a dotted key has more than `_DEEPEST` parts.

    What is within quotes or a comment is passed over. The text is gone through once.
    """
    at, parts = 0, 0
    while (found := _MARK.search(text, at)) is not None:
        at, mark = found.end(), found[0]
        if mark in _ENDS:
            ended = _ENDS[mark].match(text, at)
            if ended is None:
                # Nothing ends it, as Python's reader will say.
                return
            at = ended.end()
        elif mark == ".":
            parts += 1
        else:
            parts = 0
        if parts >= _DEEPEST:
            line = text.count("\n", 0, at) + 1
            raise refuse(
                kind,
                f"a key has more than {_DEEPEST} parts",
                file=name,
                row=line,
                place=f"line {line}",
                fix="correct it at that place",
            )


def _whole_numbers_fit(text: str, name: str, kind: type[PmsmError]) -> None:
    """Raises `kind` where the file has a whole number beyond the 64 bits of TOML."""
    try:
        fits = _largest(tomllib.loads(text)) < 1 << 63
    except tomllib.TOMLDecodeError:
        return
    except ValueError:
        # Python does not even convert a number of so many digits.
        fits = False
    if fits:
        return
    lines = enumerate(text.splitlines(), start=1)
    number, line = max(lines, key=lambda entry: max(map(len, _LONG_NUMBER.findall(entry[1])), default=0))
    key = line.partition("=")[0].strip()
    raise refuse(
        kind,
        f"{shown(key)}: the whole number does not fit into 64 bits",
        file=name,
        row=number,
        place=f"line {number}",
        fix="correct the value; a physical one is in SI units and may have an exponent",
    )


def _largest(content: object) -> int:
    """The largest magnitude of the whole numbers in what TOML gave."""
    if isinstance(content, dict):
        content = list(content.values())
    if isinstance(content, list):
        return max(map(_largest, content), default=0)
    return abs(content) if isinstance(content, int) else 0


def _misspelt(content: dict[str, Any]) -> list[tuple[str, str]]:
    known = [*_TABLES, "columns", "effects"]
    hints = ((table, did_you_mean(table, known)) for table in content if table not in known)
    # Other tools keep tables of their own in the file; only one that nearly has a known name is a mistake.
    return [
        (table, hint) for table, hint in hints if hint.startswith("did you mean") and _close(table, known)
    ]


def _close(name: str, known: list[str]) -> bool:
    import difflib

    return bool(difflib.get_close_matches(name.lower(), known, n=1, cutoff=0.8))


def _dbc(content: object, name: str, errors: list[str]) -> str | None:
    """The file that describes a CAN bus, from the folder of the machine file `name`."""
    given = content.get(_DBC) if isinstance(content, dict) else None
    if given is not None and not isinstance(given, str):
        errors.append(f'columns.{_DBC}: write it as {_DBC} = "FILE.dbc"')
        return None
    return None if given is None else str(Path(name).parent / given)


def _meant(name: str, entry: object) -> str:
    """What was meant by an entry of [columns] that is called as no column is."""
    other = entry.get("from") if isinstance(entry, dict) else entry
    if isinstance(other, str) and other in CANONICAL:
        return f'the two sides are interchanged; write {other} = "{shown(name)}"'
    return did_you_mean(name, CANONICAL)


def _columns(content: object, errors: list[str]) -> dict[str, Rule | None]:
    if not isinstance(content, dict):
        errors.append("columns: write it as a table [columns]")
        return {}
    rules: dict[str, Rule | None] = {}
    for name, entry in content.items():
        path = f"columns.{name}"
        if name == _DBC:
            continue
        if name not in CANONICAL:
            errors.append(f"{path}: there is no such column ({_meant(name, entry)})")
        elif entry is False:
            rules[name] = None
        else:
            given = {"from": entry} if isinstance(entry, str) else entry
            column = validated(_Column, path, given if isinstance(given, dict) else {}, errors)
            if column is None:
                continue
            if column.period is not None and name != "t":
                errors.append(f"{path}.period: only t can have a period")
            if name == "t" and (column.value is not None or column.file is not None):
                errors.append(f"{path}: t comes from the recording itself, or has a period")
            if column.unit is not None and canonical(column.unit, CANONICAL[name].dimension) is None:
                errors.append(
                    f"{path}.unit: '{shown(column.unit)}' is no unit of {CANONICAL[name].dimension} "
                    f"({suggest(column.unit, CANONICAL[name].dimension)})"
                )
            rules[name] = Rule(**column.model_dump())
    return rules

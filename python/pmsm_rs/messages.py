"""The code of every error and finding, with what it says, why it appears and what to do about it.

The table is `messages.toml`. A message is found by its own words, so that whoever raises it, here or in the
core, knows no codes.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

GAP: Final = "…"
"""Any text, in a pattern."""
_FORM: Final = re.compile(r"PR(\d{3})")


class Entry(NamedTuple):
    """An entry of the table.

    `kind` is "error" or "finding", `group` the title of its group, `says` the patterns of its messages. `any`
    is the kind of error whose messages without an entry of their own it has.
    """

    code: str
    kind: str
    group: str
    says: tuple[str, ...]
    any: str | None
    cause: str
    cure: str

    @property
    def title(self) -> str:
        """What it says, in one line."""
        return self.says[0] if self.says else f"any other {self.any}"

    def __str__(self) -> str:
        says = "\n".join(f"  {text}" for text in self.says or (self.title,))
        head = f"{self.code}, {self.kind}: {self.group}\n{says}"
        return f"{head}\n\nWhy\n  {self.cause}\n\nWhat to do\n  {self.cure}"


@cache
def entries() -> dict[str, Entry]:
    """All entries by code, in the order of codes."""
    table = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
    groups = sorted(table["groups"].values(), key=lambda group: group["first"])
    out = {}
    for code in sorted(name for name in table if _FORM.fullmatch(name)):
        own = [group for group in groups if group["first"] <= int(code[2:])][-1]
        row = table[code]
        out[code] = Entry(
            code, own["kind"], own["title"], tuple(row["says"]), row.get("any"), row["cause"], row["cure"]
        )
    return out


@cache
def retired() -> frozenset[str]:
    """Codes that are no longer used, and never will be for anything else."""
    table = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
    return frozenset(table["retired"])


@cache
def _patterns(kind: str) -> tuple[tuple[int, re.Pattern[str], str], ...]:
    """Letters, pattern and code of all messages of a kind, those with the most letters first."""
    out = []
    for entry in entries().values():
        for text in entry.says if entry.kind == kind else ():
            parts = [re.escape(part) for part in text.strip(GAP + " ").split(GAP)]
            pattern = re.compile(rf"(?<!\w){'.*?'.join(parts)}", re.IGNORECASE | re.DOTALL)
            out.append((sum(map(len, parts)), pattern, entry.code))
    return tuple(sorted(out, key=lambda found: -found[0]))


def _found(text: str, kind: str) -> str | None:
    return next((code for _, pattern, code in _patterns(kind) if pattern.search(text)), None)


def of_finding(text: str) -> str | None:
    """The code of a finding; a refusal that became one has that of the error. None where none is known."""
    return _found(text, "finding") or _found(text, "error")


def coded(findings: Iterable[Mapping[str, str]]) -> list[dict[str, str]]:
    """Findings with their codes, under `code`; one that the table does not know has none."""
    codes = ((finding, of_finding(finding["finding"])) for finding in findings)
    return [{**finding, "code": code} if code else dict(finding) for finding, code in codes]


def behind(finding: Mapping[str, str]) -> str:
    """The code of a finding as it stands behind its text, empty where it has none."""
    return f" [{finding['code']}]" if "code" in finding else ""


def of_error(text: str, kinds: tuple[str, ...]) -> str | None:
    """The code of an error by what it says, else by its kinds, the nearest first."""
    found = _found(text, "error")
    if found is not None:
        return found
    by_kind = {entry.any: entry.code for entry in entries().values() if entry.any}
    return next((by_kind[kind] for kind in kinds if kind in by_kind), None)

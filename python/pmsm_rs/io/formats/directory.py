"""By which names the members of a file are found, and which names leave open what is meant."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Final

from ...errors import shown
from .member import Member, Refused, Wanted
from .selection import Selection

# A refusal names the first few of the candidates.
_SHOWN: Final = 4
# Groups have names of at most 1024 characters, so no path is cut behind.
_LONGEST_PATH: Final = 1025


class Directory:
    """The members by their names: `names` has that of each, `listed` each name of a column once.

    `units` has the stated units by name and by header, `headers` the header of each name that one column
    alone has.
    """

    def __init__(self, members: Sequence[Member]) -> None:
        self.members = members
        places = {(member.group, member.name) for member in members if not member.is_note}
        ends = Counter(name for _, name in places)
        # Columns without a group go by their own name, also where a group has another one of that name.
        self.names = [
            member.path
            if member.group and (member.stamps or ends[member.name] + member.is_note > 1)
            else member.name
            for member in members
        ]
        self._by_name: dict[str, list[int]] = {}
        self._notes: dict[str, list[int]] = {}
        self._by_header: dict[str, list[int]] = {}
        self._by_end: dict[str, list[int]] = {}
        self._by_path: dict[tuple[str, str], list[int]] = {}
        units: dict[str, str] = {}
        for index, (name, member) in enumerate(zip(self.names, members, strict=True)):
            (self._notes if member.is_note else self._by_name).setdefault(name, []).append(index)
            self._by_end.setdefault(member.name, []).append(index)
            self._by_path.setdefault((member.group, member.name), []).append(index)
            if member.header is not None:
                self._by_header.setdefault(member.header, []).append(index)
            for known in (name, member.header):
                if known is not None and member.unit:
                    units.setdefault(known, member.unit)
        self.listed = tuple(self._by_name)
        self.headers = {
            name: member.header
            for name, member in zip(self.names, members, strict=True)
            if member.header is not None and self.is_settled(name)
        }
        self.units = units

    def is_settled(self, name: str) -> bool:
        """Whether one member alone goes by `name`."""
        return len(self._by_name.get(name, self._notes.get(name, []))) == 1

    def find(self, column: str) -> tuple[list[int], Selection] | None:
        """The members that `column` may mean and the part it selects, None where there is none.

        Raises Refused where several groups have one of that name.
        """
        part = Selection.of(column)
        readings = [Selection(column), *([part] if part.name != column else [])]
        for reading in readings:
            for table in (self._by_name, self._by_header, self._notes):
                if reading.name in table:
                    return table[reading.name], reading
            cuts = [at for at, sign in enumerate(reading.name[:_LONGEST_PATH]) if sign == "/"]
            ways = [self._by_path.get((reading.name[:at], reading.name[at + 1 :]), []) for at in cuts]
            if found := [index for way in ways for index in way]:
                return found, reading
        for reading in readings:
            if reading.name in self._by_end:
                paths = [self.members[index].path for index in self._by_end[reading.name]]
                raise Refused(
                    f"{len(paths)} columns are called '{shown(reading.name)}'",
                    f"say which: {_either(paths)}",
                    column=column,
                )
        return None

    def wanted(self, column: str) -> Wanted:
        """The one member that `column` means. Raises Refused where several have the name."""
        found = self.find(column)
        assert found is not None, "only what `resolve` or `names` gave is read"
        indices, part = found
        if len(indices) > 1:
            headers = [self.members[index].header for index in indices]
            spelled = [header for header in headers if header is not None]
            by_header = len(set(spelled)) == len(indices)
            count = "two" if len(indices) == 2 else str(len(indices))
            raise Refused(
                f"{count} columns are called '{shown(part.name)}'",
                f"say which by its whole header in [columns]: {_either(spelled)}"
                if by_header
                else "rename one of them, or leave the name out (NAME = false in [columns])",
                column=column,
            )
        return Wanted(indices[0], column, part)


def _either(names: Sequence[str]) -> str:
    some = " or ".join(f"'{shown(name)}'" for name in names[:_SHOWN])
    return some + (f" or one of {len(names) - _SHOWN} more" if len(names) > _SHOWN else "")

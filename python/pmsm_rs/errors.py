"""How this package says no: one plain sentence that names file, place, column and the way out."""

from __future__ import annotations

import difflib
import operator
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from ._core import DataError, PmsmError, UsageError

Refusal = TypeVar("Refusal", bound=PmsmError)


class NothingToAsk(DataError):
    """A recording that was read, and whose columns answer no question; `read` is the account of them."""

    file: str | None
    problem: str
    fix: str
    read: Mapping[str, Any]

    def of(self, file: str) -> bool:
        """Whether `file` is the recording."""
        return self.file is not None and Path(self.file) == Path(file)


def refuse(
    kind: type[Refusal],
    problem: str,
    *,
    fix: str,
    file: str | None = None,
    row: int | None = None,
    place: str | None = None,
    column: str | None = None,
) -> Refusal:
    """An error of `kind` whose message reads "file, place, column: problem; fix".

    `row` is the line of the file (from 1) for text formats and the row (from 0) otherwise; `place` says which
    of the two, in words. The same facts are attributes of the error: `file`, `row`, `column`, `problem`,
    `fix`.
    """
    where = [part for part in (file, place, f"column '{column}'" if column else None) if part]
    message = f"{', '.join(where)}: {problem}; {fix}" if where else f"{problem}; {fix}"
    error = kind(" ".join(message.split()))
    return _annotate(error, file=file, row=row, column=column, problem=problem, fix=fix)


class Problem(NamedTuple):
    """One of several things that are wrong with a file: its column, what it is, and the way out."""

    problem: str
    fix: str
    column: str | None = None


def refuse_all(kind: type[Refusal], problems: Sequence[Problem], file: str | None) -> Refusal:
    """One error for all `problems` of a file, of which there is at least one; `problems` of the error holds
    them.
    """
    first = problems[0]
    if len(problems) == 1:
        error = refuse(kind, first.problem, file=file, column=first.column, fix=first.fix)
    else:
        clauses = [
            f"({k}) " + (f"column '{each.column}': " if each.column else "") + f"{each.problem}; {each.fix}"
            for k, each in enumerate(problems, 1)
        ]
        text = f"{len(problems)} things are missing or unclear: {' '.join(map(_ended, clauses))}"
        error = kind(" ".join((f"{file}: {text}" if file else text).split()))
        _annotate(
            error,
            file=file,
            row=None,
            column=first.column,
            problem=". ".join(each.problem for each in problems),
            fix=". ".join(each.fix for each in problems),
        )
    return _annotate(error, problems=tuple(problems))


def _ended(clause: str) -> str:
    return clause if clause.endswith("?") else f"{clause}."


def _annotate(error: Refusal, **facts: object) -> Refusal:
    for name, value in facts.items():
        setattr(error, name, value)
    return error


@contextmanager
def opened(name: str, role: str) -> Iterator[Path]:
    """The file `name`, which is to be a `role`, while it is read.

    Raises UsageError where it is a folder, is not there or cannot be read.
    """
    file = Path(name)
    try:
        if file.is_dir():
            raise refuse(UsageError, "this is a folder", file=name, fix=f"name the {role} in it")
        yield file
    except FileNotFoundError:
        raise refuse(
            UsageError, "there is no such file", file=name, fix="check the name and the folder"
        ) from None
    except OSError as error:
        raise refuse(
            UsageError, f"cannot be read ({error.strerror})", file=name, fix="check its access rights"
        ) from error


def expect_whole(*, seed: object = 0, threads: object = None) -> None:
    """Raises UsageError unless `seed` is a whole number from 0 on and `threads`, where given, from 1 on."""
    for what, value, least in (("seed", seed, 0), ("number of threads", threads, 1)):
        if value is None and least == 1:
            continue
        try:
            fits = least <= operator.index(value) < 2**63  # type: ignore[arg-type]
        except TypeError:
            fits = False
        if not fits:
            raise refuse(UsageError, f"the {what} is {value!r}", fix=f"give a whole number from {least} on")


def fact(error: BaseException, name: str) -> object:
    """Attribute `name` of an error, None where it has none."""
    return getattr(error, name, None)


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """A clause that names the nearest of `known`, or all of them where none is near."""
    choices = sorted(known)
    lowered = {choice.lower(): choice for choice in choices}
    near = difflib.get_close_matches(name.lower(), list(lowered), n=3, cutoff=0.6)
    if near:
        return "did you mean " + " or ".join(f"'{lowered[hit]}'" for hit in near) + "?"
    return "known: " + ", ".join(choices) if choices else "none is known"

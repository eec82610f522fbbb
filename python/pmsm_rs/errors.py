"""How this package says no: one plain sentence that names file, place, column and the way out."""

from __future__ import annotations

import difflib
import operator
import os
import stat
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from ._core import DataError, PmsmError, UsageError
from .messages import of_error

# Characters of a name in a message, about a line of a terminal.
_LONGEST_SHOWN = 80
# Names that a message lists where none is near; more would hide the sentence.
_MOST_LISTED = 40
# Problems of a file that one refusal tells.
_MOST_TOLD = 12
# The same of a machine file or a configuration, and characters of each.
_MOST_CLAUSES = 24
_LONGEST_CLAUSE = 1000
# Names, and characters of a name, that are searched for a near one: comparing takes the square of the length.
_MOST_COMPARED = 1000
_LONGEST_COMPARED = 64

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
    of the two, in words. The same facts are attributes of the error: `file`, `row`, `place`, `column`,
    `problem`, `fix`.
    """
    where = [part for part in (file, place, f"column '{shown(column)}'" if column else None) if part]
    message = f"{', '.join(where)}: {problem}; {fix}" if where else f"{problem}; {fix}"
    error = kind(printable(" ".join(message.split())))
    return _annotate(error, file=file, row=row, place=place, column=column, problem=problem, fix=fix)


def of_run(error: Refusal, run: str) -> Refusal:
    """The same error with the `run` in front of its message; its facts are kept."""
    mark = ": " if fact(error, "file") is None else ", "
    named = type(error)(f"{run}{mark}{message(error)}")
    return _annotate(named, **vars(error))


class Problem(NamedTuple):
    """One of several things that are wrong with a file: its column, what it is, and the way out.

    `lines` are those of [columns] of which one would settle it. `brief` is the way out for a reader who sees
    these lines and the columns of the file; empty where it is `fix`.
    """

    problem: str
    fix: str
    column: str | None = None
    lines: tuple[str, ...] = ()
    brief: str = ""


def no_answer(path: str | os.PathLike[str]) -> UsageError:
    """That the file `path` holds no answer."""
    return refuse(
        UsageError,
        "this is no JSON answer",
        file=str(path),
        fix="write one with: pmsm-rs diagnose ... --json ANSWER.json",
    )


def refuse_all(kind: type[Refusal], problems: Sequence[Problem], file: str | None) -> Refusal:
    """One error for all `problems` of a file, of which there is at least one; `problems` of the error holds
    them.
    """
    first = problems[0]
    if len(problems) == 1:
        error = refuse(kind, first.problem, file=file, column=first.column, fix=first.fix)
    else:
        clauses = [
            f"({k}) "
            + (f"column '{shown(each.column)}': " if each.column else "")
            + f"{each.problem}; {each.fix}"
            for k, each in enumerate(problems[:_MOST_TOLD], 1)
        ]
        if len(problems) > _MOST_TOLD:
            clauses.append(f"And {len(problems) - _MOST_TOLD} more like these")
        text = f"{len(problems)} things are missing or unclear: {' '.join(map(_ended, clauses))}"
        error = kind(printable(" ".join((f"{file}: {text}" if file else text).split())))
        _annotate(
            error,
            file=file,
            row=None,
            column=first.column,
            problem=". ".join(each.problem for each in problems[:_MOST_TOLD]),
            fix=". ".join(each.fix for each in problems[:_MOST_TOLD]),
        )
    return _annotate(error, problems=tuple(problems))


def clauses(problems: Sequence[str]) -> str:
    """What is wrong with a file as one clause: the first problems, long ones cut, and how many more there
    are.
    """
    told = [
        text if len(text) <= _LONGEST_CLAUSE else f"{text[: _LONGEST_CLAUSE - 80]}…{text[-79:]}"
        for text in problems[:_MOST_CLAUSES]
    ]
    more = len(problems) - len(told)
    return "; ".join([*told, *([f"and {more} more like these"] if more else [])])


def _ended(clause: str) -> str:
    return clause if clause.endswith("?") else f"{clause}."


def printable(text: str) -> str:
    """`text` with what could steer a terminal, such as control characters, written as escape sequences."""
    if text.isprintable():
        return text
    return "".join(
        sign if sign.isprintable() or sign == "\n" else sign.encode("unicode_escape").decode()
        for sign in text
    )


def shown(name: str) -> str:
    """A name out of a file as a sentence can hold it: printable, its middle left out where it is long."""
    if len(name) > _LONGEST_SHOWN:
        name = f"{name[: _LONGEST_SHOWN // 2]}…{name[-_LONGEST_SHOWN // 4 :]}"
    return printable(name)


def _annotate(error: Refusal, **facts: object) -> Refusal:
    for name, value in facts.items():
        setattr(error, name, value)
    return error


@contextmanager
def opened(name: str, role: str) -> Iterator[Path]:
    """The file `name`, which is to be a `role`, while it is read.

    Raises UsageError where it is a folder, a pipe or a device, is not there or cannot be read.
    """
    file = Path(name)
    try:
        mode = file.stat().st_mode
        if stat.S_ISDIR(mode):
            raise refuse(UsageError, "this is a folder", file=name, fix=f"name the {role} in it")
        if not stat.S_ISREG(mode):
            # A pipe or a device has no size to check, and reading it may never end.
            raise refuse(
                UsageError,
                "this is a pipe or a device, no file",
                file=name,
                fix=f"name the file of a {role}",
            )
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


def expect(kind: type, **given: object) -> None:
    """Raises UsageError unless every argument that is `given` by its name is a `kind`."""
    for name, value in given.items():
        if not isinstance(value, kind):
            raise refuse(UsageError, f"{name} is a {type(value).__name__}", fix=f"give a {kind.__name__}")


def number_of(name: str, value: object) -> float:
    """`value` as a float. Raises UsageError where it is no number."""
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise refuse(UsageError, f"{name} is {value!r}", fix="give a number") from None


def bounds_of(name: str, pair: object) -> tuple[float, float]:
    """The bounds `pair` of a parameter as (low, high). Raises UsageError where they are no finite range."""
    try:
        low, high = (float(bound) for bound in pair)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        raise refuse(
            UsageError, f"the bounds of {name} are {pair!r}", fix="give (low, high), in SI units"
        ) from None
    if not -float("inf") < low < high < float("inf"):
        raise refuse(
            UsageError,
            f"the bounds of {name} are ({low}, {high})",
            fix="give two finite numbers, the lower one first",
        )
    return low, high


@contextmanager
def written_by(writer: str) -> Iterator[None]:
    """Raises DataError where what is read within is not what `writer` has written."""
    try:
        yield
    except (AttributeError, IndexError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise refuse(
            DataError, "this is no answer of this package", fix=f"give what {writer}() returned, unchanged"
        ) from error


@contextmanager
def unchanged(path: str | os.PathLike[str]) -> Iterator[None]:
    """Raises UsageError where the answer in the file `path` cannot be used: changed, or by our own fault."""
    try:
        yield
    except PmsmError:
        raise
    except (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError) as error:
        raise refuse(
            UsageError,
            f"this answer cannot be used ({type(error).__name__}: {shown(str(error))})",
            file=str(path),
            fix="if it was changed, write it again with: pmsm-rs diagnose ... --json ANSWER.json; "
            "if not, report it as a fault",
        ) from error


def is_panic(error: BaseException) -> bool:
    """Whether compiled code gave up: no Exception, and of a class that each library has for itself."""
    return type(error).__name__ == "PanicException"


def fact(error: BaseException, name: str) -> object:
    """Attribute `name` of an error, None where it has none."""
    return getattr(error, name, None)


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """A clause that names the nearest of `known`, or the first of them where none is near."""
    choices = sorted(known)
    short = [choice for choice in choices[:_MOST_COMPARED] if len(choice) <= _LONGEST_COMPARED]
    lowered = {choice.lower(): choice for choice in short}
    compared = name.lower() if len(name) <= _LONGEST_COMPARED else ""
    near = difflib.get_close_matches(compared, list(lowered), n=3, cutoff=0.6)
    if near:
        return "did you mean " + " or ".join(f"'{shown(lowered[hit])}'" for hit in near) + "?"
    if not choices:
        return "none is known"
    more = f" and {len(choices) - _MOST_LISTED} more" if len(choices) > _MOST_LISTED else ""
    return "known: " + ", ".join(shown(choice) for choice in choices[:_MOST_LISTED]) + more


def message(error: BaseException) -> str:
    """What an error says, without its code."""
    return str(error.args[0]) if isinstance(error, PmsmError) and error.args else str(error)


def _code(error: PmsmError) -> str | None:
    """The code by which `pmsm-rs explain` tells cause and cure."""
    problem = fact(error, "problem")
    kinds = tuple(kind.__name__ for kind in type(error).__mro__)
    return of_error(problem if isinstance(problem, str) else message(error), kinds)


def _with_code(error: PmsmError) -> str:
    return f"{message(error)} [{error.code}]" if error.code else message(error)


# The core, where the classes are made, knows neither the table of messages nor its codes.
PmsmError.code = property(_code)  # type: ignore[assignment]
PmsmError.__str__ = _with_code  # type: ignore[assignment, method-assign]

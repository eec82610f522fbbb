"""Programs of elementary operations as lines of code in some language."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

LIBM = {
    "sqrt": "sqrt",
    "sin": "sin",
    "cos": "cos",
    "exp": "exp",
    "ln": "log",
    "tanh": "tanh",
    "abs": "fabs",
}
"""The functions as the C library calls them."""
_BINARY = {"add": "+", "sub": "-", "mul": "*", "div": "/"}
# A term longer than this gets a name of its own.
_LONGEST = 100


@dataclass(frozen=True)
class Language:
    """How a language writes numbers, operations and definitions.

    `functions` maps sqrt, sin, cos, exp, ln, tanh and abs to the names of functions. `select` is a format
    with {test}, {yes} and {no}, `define` one with {name} and {value}. `replaced` gives add, sub, mul or div
    a format with {a} and {b} in place of its operator.
    """

    functions: Mapping[str, str]
    select: str
    define: str
    number: Callable[[float], str] = repr
    replaced: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Code:
    """Lines that define names, in order, and the terms of the outputs by name."""

    lines: list[str]
    outputs: dict[str, str]


def code(program: Mapping[str, Any], language: Language, names: Mapping[str, str], prefix: str = "x") -> Code:
    """The program in a language. `names` says what each input is called there; names of intermediate results
    begin with `prefix`.
    """
    operations: Sequence[Mapping[str, Any]] = program["operations"]
    uses = [0] * len(operations)
    for operation in operations:
        for place in _operands(operation):
            uses[place] += 1
    lines: list[str] = []
    terms: list[str] = []
    for place, operation in enumerate(operations):
        term = _term(operation, terms, language, names, program["inputs"], _by_number(operation, operations))
        kind = next(iter(operation))
        plain = kind in ("constant", "input")
        if not plain and (uses[place] > 1 or len(term) > _LONGEST):
            name = f"{prefix}{len(lines) + 1}"
            lines.append(language.define.format(name=name, value=_bare(term)))
            term = name
        terms.append(term)
    return Code(lines, {name: _bare(terms[place]) for name, place in program["outputs"]})


def evaluate(program: Mapping[str, Any], values: Mapping[str, ArrayLike]) -> dict[str, NDArray[np.float64]]:
    """The outputs where the inputs have these values, numbers or arrays that broadcast."""
    functions = {"neg": np.negative, "ln": np.log, "abs": np.abs}
    binary = {"add": np.add, "sub": np.subtract, "mul": np.multiply, "div": np.divide}
    done: list[Any] = []
    with np.errstate(all="ignore"):
        for operation in program["operations"]:
            ((kind, at),) = operation.items()
            if kind == "constant":
                done.append(np.float64(at))
            elif kind == "input":
                done.append(np.asarray(values[program["inputs"][at]], dtype=float))
            elif kind == "if_positive":
                done.append(np.where(done[at[0]] > 0.0, done[at[1]], done[at[2]]))
            elif kind in binary:
                done.append(binary[kind](done[at[0]], done[at[1]]))
            else:
                function = functions.get(kind) or getattr(np, kind)
                done.append(function(done[at]))
    return {name: np.asarray(done[place]) for name, place in program["outputs"]}


def needs(program: Mapping[str, Any], output: str) -> set[str]:
    """Names of the inputs on which an output depends."""
    operations = restricted(program, [output])["operations"]
    return {program["inputs"][operation["input"]] for operation in operations if "input" in operation}


def restricted(program: Mapping[str, Any], wanted: Sequence[str]) -> dict[str, Any]:
    """The program with these outputs alone, and with the operations that they need."""
    places = dict(program["outputs"])
    needed: set[int] = set()
    waiting = [places[name] for name in wanted]
    while waiting:
        at = waiting.pop()
        if at not in needed:
            needed.add(at)
            waiting += _operands(program["operations"][at])
    order = {at: k for k, at in enumerate(sorted(needed))}
    operations = []
    for at in sorted(needed):
        ((kind, given),) = program["operations"][at].items()
        if kind not in ("constant", "input"):
            given = [order[x] for x in given] if isinstance(given, list) else order[given]
        operations.append({kind: given})
    outputs = [[name, order[places[name]]] for name in wanted]
    return {"inputs": program["inputs"], "operations": operations, "outputs": outputs}


def _by_number(operation: Mapping[str, Any], operations: Sequence[Mapping[str, Any]]) -> bool:
    """Whether it divides by a number, which is not zero."""
    return "div" in operation and operations[operation["div"][1]].get("constant", 0.0) != 0.0


def _operands(operation: Mapping[str, Any]) -> list[int]:
    ((kind, at),) = operation.items()
    if kind in ("constant", "input"):
        return []
    return list(at) if isinstance(at, list) else [at]


def _term(
    operation: Mapping[str, Any],
    terms: Sequence[str],
    language: Language,
    names: Mapping[str, str],
    inputs: Sequence[str],
    by_number: bool,
) -> str:
    ((kind, at),) = operation.items()
    if kind == "constant":
        text = language.number(at)
        return f"({text})" if text.startswith("-") else text
    if kind == "input":
        return names[inputs[at]]
    if kind in _BINARY:
        a, b = terms[at[0]], terms[at[1]]
        if kind in language.replaced and not by_number:
            return language.replaced[kind].format(a=_bare(a), b=_bare(b))
        return f"({a} {_BINARY[kind]} {b})"
    if kind == "neg":
        return f"(-{terms[at]})"
    if kind == "if_positive":
        return language.select.format(test=terms[at[0]], yes=terms[at[1]], no=terms[at[2]])
    return f"{language.functions[kind]}({_bare(terms[at])})"


def _bare(term: str) -> str:
    """The term without parentheses around the whole of it."""
    if not (term.startswith("(") and term.endswith(")")):
        return term
    depth = 0
    for k, letter in enumerate(term):
        depth += (letter == "(") - (letter == ")")
        if depth == 0 and k < len(term) - 1:
            return term
    return term[1:-1]

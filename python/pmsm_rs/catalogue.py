"""The catalogue of effects, and that of messages, as text."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from ._core import PmsmError, UsageError
from .config.effect_text import Effect
from .errors import refuse
from .messages import entries
from .results.registry import effect, effects
from .results.words import EQUATIONS, number, unit


def overview(own: Iterable[Effect] = ()) -> str:
    """One line per effect of the catalogue, then one per effect given as text."""
    entries = [*effects(), *(one.entry for one in own)]
    wide = max(len(entry["id"]) for entry in entries)
    lines = [f"{entry['id']:<{wide}}  {entry['sentence']}" for entry in entries]
    return "\n".join([*lines, "", "pmsm-rs effects NAME shows one of them."])


def entry(name: str, own: Iterable[Effect] = ()) -> str:
    """Equation, parameters, signature and look-alikes of one effect, of the catalogue or of `own`.

    Raises UsageError naming the nearest ids.
    """
    given = {one.name: one.entry for one in own}
    item = given[name] if name in given else effect(name)
    about = "its ranges" if name in given else "ranges for a typical servo motor"
    facts = [
        ("Equation", item["equation"]),
        ("Acts in", EQUATIONS.get(item["acts_in"], item["acts_in"])),
        ("Shows as", item["fingerprint"]),
        ("Resembles", ", ".join(item["look_alikes"]) or "nothing else in the catalogue"),
        ("Source", item["source"]),
    ]
    lines = [f"{item['title']} ({item['id']})", item["sentence"], ""]
    lines += [f"{label + ':':<11}{text}" for label, text in facts]
    if item["parameters"]:
        lines += ["", f"Parameters, with {about}"]
        lines += [_parameter(parameter) for parameter in item["parameters"]]
    if item["derived"]:
        lines += ["", "Answers also give"]
        lines += [_derived(result) for result in item["derived"]]
    return "\n".join(lines)


def _parameter(item: dict[str, Any]) -> str:
    sign = unit(item["unit"])
    bounds = f"{number(item['low'])} to {number(item['high'])} {sign}".rstrip()
    typical = f"typically {number(item['typical'])} {sign}".rstrip()
    return f"  {item['symbol']}: {item['meaning']}; {bounds}, {typical}"


def _derived(item: dict[str, Any]) -> str:
    sign = unit(item["unit"])
    return f"  {item['name']}: {item['meaning']}" + (f", in {sign}" if sign else "")


def messages(code: str | None) -> str:
    """The entry of the error or finding `code`, or a line for each where it is None.

    Raises UsageError naming the nearest codes.
    """
    known = entries()
    if code is not None:
        if code.upper() not in known:
            raise _no_code(code)
        return str(known[code.upper()])
    lines: list[str] = []
    group = None
    for item in known.values():
        if item.group != group:
            group = item.group
            lines += ["", f"{group} ({item.kind}s)"]
        lines.append(f"  {item.code}  {item.title}")
    return "\n".join([*lines[1:], "", "pmsm-rs explain CODE shows one of them."])


def _no_code(given: str) -> PmsmError:
    """That nothing has the code `given`, with the command that shows it where it is an effect."""
    if given in {item["id"] for item in effects()}:
        return refuse(
            UsageError, f"'{given}' is an effect, not a code", fix=f"pmsm-rs effects {given} shows it"
        )
    fix = "give the code behind a message, such as PR072; pmsm-rs explain lists all of them"
    return refuse(UsageError, f"there is no code '{given}'", fix=fix)

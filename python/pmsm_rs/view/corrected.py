"""The machine file with the found values in the place of the nameplate's."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from typing import Any, Final

from ..io.notes import quoted
from ..quantities.canonical import CANONICAL
from ..results.estimates import Estimate
from ..results.findings import DiagnosisValues
from ..results.rounding import fixed, is_finite, last_place
from ..results.words import listed, lower_first, title

UNITS: Final = {
    "n_p": "pole pairs",
    "r_s": "ohm",
    "l_d": "H",
    "l_q": "H",
    "psi_m": "V s, peak per phase",
    "j": "kg m^2, everything that turns",
    "b": "N m s",
}
_DRIVE: Final = {"v_dc": "V", "i_rated": "A peak", "f_sample": "Hz"}
_LARGEST_SHARE: Final = 0.5
"""Standard error of a value that is taken at most, as a share of it."""
_MAY_BE_ZERO: Final = frozenset({"psi_m", "b"})


def machine_file(answer: DiagnosisValues) -> str | None:
    """The text of a machine file with what was found, which `read_machine` takes; None where the answer does
    not say which machine it is of.

    Found values have one digit more than their uncertainty. What was not found, is uncertain by more than a
    half, or has a sign that no motor has, keeps the value of the nameplate. `[columns]` says how the
    recording was read, where its columns have other names or units than those of the package.
    """
    given: Mapping[str, Any] | None = answer.data.get("machine")
    if given is None:
        return None
    lines = []
    if answer.effects:
        names = listed([lower_first(title(effect)) for effect in answer.effects])
        said = f"Found together with {names}, which the dq-model leaves out."
        lines += textwrap.wrap(said, 98, initial_indent="# ", subsequent_indent="# ")
    if answer.remaining or answer.verdict in {"unknown", "partial", "undetermined"}:
        lines.append("# Something else is missing in the model: values may be off by more than is stated.")
    found = [_parameter(name, given, answer.base.get(name)) for name in UNITS]
    lines += ["[machine]", *_aligned([line for line in found if line is not None])]
    drive = [f"{name} = {_plain(given[name])}  # {of}" for name, of in _DRIVE.items() if name in given]
    if drive:
        lines += ["", "[drive]", *_aligned(drive)]
    if "load" in given:
        lines += ["", "[load]", f'kind = "{given["load"]}"']
        if "load_value" in given:
            lines.append(f"value = {_plain(given['load_value'])}  # N m")
    columns = _columns(answer)
    if columns:
        lines += ["", "[columns]", *columns]
    return "\n".join(lines) + "\n"


def _aligned(lines: list[str]) -> list[str]:
    """Lines of an entry and a remark, the remarks below one another."""
    entries = [line.partition("  # ") for line in lines]
    wide = max(len(entry) for entry, _, _ in entries)
    return [f"{entry:<{wide}}{mark}{remark}".rstrip() for entry, mark, remark in entries]


def _parameter(name: str, given: Mapping[str, Any], found: Estimate | None) -> str | None:
    """The line of a parameter, None where nothing is known of it."""
    plate = given.get(name)
    stated = f"nameplate {_plain(plate)}" if plate is not None else "not on the nameplate"
    if found is None or not is_finite(found.value):
        return None if plate is None else f"{name} = {_plain(plate)}  # {UNITS[name]}"
    assert found.value is not None, "a finite value is one"
    why = _refused(name, found.value, found.stderr)
    if why:
        return f"# {name}: {why}" if plate is None else f"{name} = {_plain(plate)}  # {UNITS[name]}; {why}"
    spread = found.stderr if is_finite(found.stderr) and (found.stderr or 0.0) > 0.0 else None
    if spread is None:
        return f"{name} = {_plain(float(f'{found.value:.6g}'))}  # {UNITS[name]}; {stated}"
    value = fixed(found.value, max(last_place(spread) + 1, 0))
    if not value.strip("0.") and name not in _MAY_BE_ZERO:
        value = _plain(found.value)
    return f"{name} = {value}  # {UNITS[name]}, ± {spread:.2g}; {stated}"


def _refused(name: str, value: float, spread: float | None) -> str:
    """Why a found value is not taken, empty where it is."""
    if value < 0.0 or (value == 0.0 and name not in _MAY_BE_ZERO):
        return f"found {value:.4g}, which no motor has"
    if spread is not None and spread > _LARGEST_SHARE * value:
        return f"found {value:.2g} ± {spread:.2g}, which is too uncertain"
    return ""


def _plain(value: float) -> str:
    """A number as TOML reads it."""
    return str(value) if isinstance(value, int) else f"{value:.12g}"


def _columns(answer: DiagnosisValues) -> list[str]:
    """The lines of [columns] with which the recordings are read as they were; none where several recordings
    were read in several ways.
    """
    each = [read["columns"] for read in answer.read]
    if not each or any(columns != each[0] for columns in each):
        return []
    lines = []
    for name, entry in each[0].items():
        rule = _rule(name, entry)
        if rule:
            inside = ", ".join(
                f"{key} = {quoted(value) if isinstance(value, str) else _plain(value)}"
                for key, value in rule.items()
            )
            lines.append(f"{name} = {{ {inside} }}")
    return lines


def _rule(name: str, entry: Mapping[str, Any]) -> dict[str, Any]:
    """What differs from the canonical column of that name, empty where nothing does."""
    if entry.get("period") is not None:
        return {"period": entry["period"]}
    if entry.get("value") is not None:
        return {"value": entry["value"], "unit": entry["unit"]}
    usual = {"from": name, "unit": CANONICAL[name].unit, "scale": 1.0, "offset": 0.0, "file": None}
    own = {key: entry.get(key, value) for key, value in usual.items()}
    if own == usual:
        return {}
    always = ("from", "unit")
    return {key: value for key, value in own.items() if key in always or value != usual[key]}

"""Tables of TOML as models, and everything that is wrong with one in words."""

from __future__ import annotations

import re
from typing import Annotated, Final, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from ..errors import did_you_mean

_SMALLEST: Final = 1e-30
"""In any SI unit far below what a motor has; what is smaller is lost in computing."""


def _above_rounding(value: float) -> float:
    """Raises ValueError on a value that is too small to compute with."""
    if value < _SMALLEST:
        raise ValueError(f"{value!r} is too small to compute with; check its unit")
    return value


Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False), AfterValidator(_above_rounding)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class Table(BaseModel):
    """A table whose keys are known and whose values are of the type that they say."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


_Model = TypeVar("_Model", bound=BaseModel)

_PLAIN: Final = re.compile(r"[-+]?\d+(\.\d+)?([eE][-+]?\d+)?")
_POLE_PAIRS: Final = (
    "n_p is the number of pole pairs, half the number of poles on the nameplate or data sheet: "
    "a motor with 8 poles has the line n_p = 4 under [machine]"
)
"""What is to be said of the only key that is always needed."""


def validated(model: type[_Model], name: str, content: object, errors: list[str]) -> _Model | None:
    """The table `name` as a `model`; None, with clauses added to `errors`, where it is none."""
    if content is None:
        if name == "machine":
            errors.append(f"machine: this table is missing; {_POLE_PAIRS}")
            return None
        content = {}
    if not isinstance(content, dict):
        errors.append(f"{name}: write it as a table [{name}]")
        return None
    try:
        # TOML tells 4 from 4.0; for a physical value both are the same number.
        return model.model_validate({key: number(key, value) for key, value in content.items()})
    except ValidationError as error:
        errors.extend(words(name, model, error))
        return None


def number(key: str, value: object) -> object:
    """A whole number of TOML as the physical value that it means."""
    return float(value) if isinstance(value, int) and not isinstance(value, bool) and key != "n_p" else value


def words(name: str, model: type[BaseModel], error: ValidationError) -> list[str]:
    """One clause per wrong entry of the table `name`, with the nearest right one."""
    out = []
    for item in error.errors(include_url=False):
        path = ".".join([name, *(str(part) for part in item["loc"])])
        if item["type"] == "extra_forbidden":
            known = [field.alias or key for key, field in model.model_fields.items()]
            text = f"unknown key ({did_you_mean(str(item['loc'][-1]), known)})"
        elif item["type"] == "missing":
            text = f"is missing; {_POLE_PAIRS}" if path == "machine.n_p" else "is missing"
        elif item["type"] == "literal_error":
            choices = re.findall("'([^']*)'", item["ctx"]["expected"])
            text = f"'{item['input']}' is not known ({did_you_mean(str(item['input']), choices)})"
        elif item["type"] == "value_error":
            text = str(item["ctx"]["error"])
        elif item["type"].startswith(("int_", "float_")):
            text = _no_number(item["input"], whole=item["type"].startswith("int_"))
        else:
            text = f"{item['msg'][0].lower()}{item['msg'][1:]}, not {item['input']!r}"
        out.append(f"{path}: {text}")
    return out


def _no_number(given: object, *, whole: bool) -> str:
    """That a value is no number, or no whole one, with the way out where it shows."""
    text = f"{given!r} is no {'whole ' if whole else ''}number"
    if not isinstance(given, str):
        return text
    plain = given.strip().replace(",", ".", 1)
    if not _PLAIN.fullmatch(plain):
        return text
    return f"{text}; write {plain} without quotes{' and with a decimal point' if ',' in given else ''}"

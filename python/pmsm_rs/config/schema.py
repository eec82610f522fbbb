"""Tables of TOML as models, and everything that is wrong with one in words."""

from __future__ import annotations

import re
from typing import Annotated, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from ..errors import did_you_mean

Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class Table(BaseModel):
    """A table whose keys are known and whose values are of the type that they say."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


_Model = TypeVar("_Model", bound=BaseModel)


def validated(model: type[_Model], name: str, content: object, errors: list[str]) -> _Model | None:
    """The table `name` as a `model`; None, with clauses added to `errors`, where it is none."""
    if content is None:
        if name == "machine":
            errors.append("machine: this table is missing; at least n_p is needed")
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
            text = "is missing"
        elif item["type"] == "literal_error":
            choices = re.findall("'([^']*)'", item["ctx"]["expected"])
            text = f"'{item['input']}' is not known ({did_you_mean(str(item['input']), choices)})"
        elif item["type"] == "value_error":
            text = str(item["ctx"]["error"])
        else:
            text = f"{item['msg'][0].lower()}{item['msg'][1:]}, not {item['input']!r}"
        out.append(f"{path}: {text}")
    return out

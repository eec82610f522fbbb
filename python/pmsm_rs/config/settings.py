"""What sets of settings have in common: their values by name, and how the command line gives them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import Any


class Settings:
    """A dataclass of settings, each of which is set by its name."""

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Gives all settings by name, as estimators of scikit-learn do.

        Parameters
        ----------
        deep : bool, default True
            Has no effect: no setting has settings of its own.

        Returns
        -------
        dict of str to object
            From which the same object can be made.
        """
        return {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]


def assignments(text: str) -> Iterator[tuple[str, str, str, str]]:
    """The parts of `name=value,name=value`: as written, name, "=" or nothing, and value."""
    for part in filter(None, (part.strip() for part in text.split(","))):
        name, mark, value = (piece.strip() for piece in part.partition("="))
        yield part, name, mark, value

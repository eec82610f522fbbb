"""The model of an answer, written for other tools."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import atomic
from .._core import UsageError
from ..errors import did_you_mean, refuse
from .kinds import KINDS, Kind

if TYPE_CHECKING:
    from ..model import Model

__all__ = ["KINDS", "Kind", "export"]


def export(model: Model, to: str, path: str | os.PathLike[str], **options: Any) -> list[str]:
    """Writes the model to a file for another tool, whole or not at all.

    Parameters
    ----------
    model : Model
        The model of an answer.
    to : str
        One of `KINDS`: machine, python, rust, fmu, fmu3, modelica, motulator, gem, mujoco, c-header.
    path : path
        Where it goes.
    **options : object
        Those of the kind; see `Kind.options`.

    Returns
    -------
    list of str
        Sentences on what the tool cannot express of this model and the file does not hold; empty where it
        holds all.

    Raises
    ------
    UsageError
        For an unknown kind or option, where the answer has no model, where a compiler is needed and missing,
        and where the file cannot be written.
    """
    if to not in KINDS:
        raise refuse(UsageError, f"there is no export '{to}'", fix=did_you_mean(to, KINDS))
    kind = KINDS[to]
    for name in options:
        if name not in kind.options:
            known = ", ".join(kind.options) or "it has none"
            raise refuse(UsageError, f"the export '{to}' has no option '{name}'", fix=f"known: {known}")
    atomic.expect(path)
    content, left_out = kind.make(model, Path(path), options)
    if isinstance(content, str):
        atomic.write_text(path, content)
    else:
        atomic.write(path, lambda file: _put(file, content))
    return left_out


def _put(file: Path, content: bytes) -> None:
    file.write_bytes(content)

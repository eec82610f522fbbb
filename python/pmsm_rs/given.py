"""What a call was given: machines and recordings, in memory or by the names of their files."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from . import _core
from ._core import Machine, UsageError
from .errors import refuse

if TYPE_CHECKING:
    from .config.machine_file import MachineFile

    Described = Machine | MachineFile | str | os.PathLike[str]
    Run = _core.Recording | str | os.PathLike[str]


def machine_of(given: object) -> Machine | MachineFile:
    """The machine, or the machine file that was given or named.

    Raises UsageError where there is no such file and for what is no machine, and MachineError naming every
    wrong entry.
    """
    if isinstance(given, Machine):
        return given
    from .config.machine_file import MachineFile, read_machine

    if isinstance(given, MachineFile):
        return given
    if isinstance(given, str | os.PathLike):
        return read_machine(given)
    raise refuse(
        UsageError,
        f"a {type(given).__name__} was given where a machine is expected",
        fix="give a Machine or the name of a machine file",
    )


def recording_of(given: object, machine: Machine | MachineFile) -> _core.Recording:
    """The recording that was given, or the one in the file that was named, read as `machine` says.

    Raises UsageError where there is no such file and for what is no recording, and DataError as `load`.
    """
    if isinstance(given, _core.Recording):
        return given
    if isinstance(given, str | os.PathLike):
        from .io.loader import load

        return load(given, machine)
    raise refuse(
        UsageError,
        f"a {type(given).__name__} was given where a Recording is expected",
        fix="give a Recording or a file name; anything else is loaded by pmsm_rs.load(data, machine)",
    )

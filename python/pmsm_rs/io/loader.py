"""Reading a recording from a file or a frame."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._core import DataError, Machine, MachineError
from ..config.machine_file import MachineFile, read_machine
from ..errors import NothingToAsk, fact, is_panic, message, opened, refuse, shown
from .beside import without_lone
from .captures import completed, is_capture
from .checks import angle_against_speed, angle_in_radians, rotor_frame_against_phases
from .columns import Columns, taken
from .formats import Source, open_source
from .formats.ahead import Opening
from .frames import frame_source
from .held import held
from .reading import Account, told
from .recording import DEFAULT_MAX_BYTES, Recording
from .wild import told_of, wild_rows


def load(
    data: Any,
    machine: str | os.PathLike[str] | MachineFile | Machine | None = None,
    *,
    max_bytes: int = DEFAULT_MAX_BYTES,
    allow_outside: bool = False,
) -> Recording:
    """Reads the recording in a file or a frame; a Recording is returned as it is.

    Files are CSV, Parquet, Feather, .mat, .npz and JSON. With the extras of the package they are MATLAB v7.3,
    HDF5, NI TDMS, ASAM MDF, PX4 ulog, ROS bags, MCAP and logs of a CAN bus, too.

    Parameters
    ----------
    data : path, Recording, mapping of arrays, or frame
        A pandas or polars frame, an xarray Dataset, a structured array, or anything with an Arrow stream.
    machine : path, MachineFile, Machine or None, default None
        The machine file whose [columns] and [load] tables say how to read it. Of a Machine only the pole
        pairs are used, to tell electrical from mechanical angles.
    max_bytes : int, default 2 GiB
        Nothing larger is unpacked.
    allow_outside : bool, default False
        Columns that [columns] takes from another file come from the recording's folder or below it; True
        allows any.

    Returns
    -------
    Recording
        Checked columns of shape (samples,) in SI units.

    Raises
    ------
    UsageError
        Where there is no such file.
    MachineError
        For a bad machine file.
    DataError
        For data that cannot be used; it names file, row, column and fix.

    Examples
    --------
    >>> import pmsm_rs as pm
    >>> from pmsm_rs.support.demo import recording_files
    >>> run, other, machine = recording_files()
    >>> recording = pm.load(run, machine)
    >>> recording.column("i_a").shape == (len(recording),)
    True
    """
    described = described_by(machine, allow_outside=allow_outside)
    if isinstance(data, Recording):
        return data
    with readable(data):
        return recorded(source_of(data, max_bytes, described), described, max_bytes)


def described_by(
    machine: str | os.PathLike[str] | MachineFile | Machine | None, *, allow_outside: bool = False
) -> MachineFile | Machine | None:
    """What is known of the machine, its file read where `machine` names one. Raises as `read_machine`."""
    if isinstance(machine, MachineFile) and allow_outside:
        return replace(machine, allow_outside=True)
    if machine is None or isinstance(machine, MachineFile | Machine):
        return machine
    return read_machine(machine, allow_outside=allow_outside)


@contextmanager
def readable(data: Any) -> Iterator[None]:
    """Raises DataError where `data` cannot be read for want of memory, or as it nests, counts or spells
    beyond what Python takes.
    """
    try:
        yield
    except MemoryError as error:
        raise refuse(
            DataError,
            "there is not enough memory to read it",
            file=_name(data),
            fix="cut the recording, or map fewer columns in [columns]",
        ) from error
    except BaseException as error:
        damaged = isinstance(error, (RecursionError, OverflowError, UnicodeError, csv.Error))
        if not damaged and not is_panic(error):
            raise
        raise refuse(
            DataError,
            f"it cannot be read ({shown(str(error))})",
            file=_name(data),
            fix="export it again; it may be damaged",
        ) from error


def source_of(data: Any, max_bytes: int, described: MachineFile | Machine | None = None) -> Source:
    """The columns of what `load` takes, none of them read yet. Raises as `load`."""
    dbc = described.dbc if isinstance(described, MachineFile) else None
    if isinstance(data, Opening):
        return data.source(dbc)
    file = _name(data)
    return frame_source(data, max_bytes) if file is None else open_source(file, max_bytes, dbc)


def recorded(source: Source, described: MachineFile | Machine | None, max_bytes: int) -> Recording:
    """The recording that `source` holds, as `load` gives it. Raises DataError as `load`."""
    known = described.machine if isinstance(described, MachineFile) else described
    rules, kind, value = (
        (described.columns, described.load, described.load_value)
        if isinstance(described, MachineFile)
        else (None, None, None)
    )
    allow_outside = isinstance(described, MachineFile) and described.allow_outside
    beside = None if source.file is None else _beside(source.file, max_bytes, allow_outside)
    columns, account = taken(source, rules, beside, whole=True, locked=kind == "locked")
    angle_error = None
    if is_capture(columns, kind):
        columns, first, remarks, angle_error = completed(columns, known, source.file)
        account = replace(account, first=account.first + first, remarks=(*account.remarks, *remarks))
    columns, account = without_lone(columns, account, known.n_p if known is not None else None)
    try:
        recording = Recording(columns, load=kind, load_value=value, angle_error=angle_error)
    except DataError as error:
        if fact(error, "row") is None and _is_load_alone(columns):
            raise _nothing_to_ask(columns, account, source) from error
        raise _with_place(error, source, account.first) from error
    if recording.kind == "operating_points" and (wild := wild_rows(columns)):
        first = account.first
        account = replace(
            account, remarks=(*account.remarks, told_of(wild, lambda row: source.place(first + row)[1]))
        )
        columns = {name: np.delete(values, list(wild)) for name, values in columns.items()}
        recording = Recording(columns, load=kind, load_value=value)
    recording.file, recording.account = source.file, _with_held(columns, account)
    angle_against_speed(columns, known.n_p if known is not None else None, source.file)
    angle_in_radians(columns, source.file)
    rotor_frame_against_phases(columns, source.file)
    return recording


def _with_held(columns: Columns, account: Account) -> Account:
    """The account with a remark on columns that are held between updates, where there are any."""
    headers = {
        "omega_m" if name == "n" else name: rule.source
        for name, rule in account.columns.items()
        if rule.source is not None
    }
    remark = held(columns, headers)
    return account if remark is None else replace(account, remarks=(*account.remarks, remark))


def _name(data: Any) -> str | None:
    """The file's name, None for what is no file."""
    if isinstance(data, Opening):
        return data.file
    return os.fspath(data) if isinstance(data, str | os.PathLike) else None


def _beside(data: str | os.PathLike[str], max_bytes: int, allow_outside: bool) -> Callable[[str], Source]:
    """Opens files by their name from the folder of the recording; nothing outside of it is opened, unless
    that is allowed.
    """
    folder = Path(data).parent

    def beside(name: str) -> Source:
        file = folder / name
        if not allow_outside and not file.resolve().is_relative_to(folder.resolve()):
            if file.exists() and not file.is_file():
                with opened(str(file), "recording"):
                    pass
            raise refuse(
                MachineError,
                f"[columns] takes a column from '{shown(name)}', outside of the folder of the recording",
                file=str(data),
                fix="put the file beside the recording, or allow it by --allow-outside "
                "(in Python allow_outside=True)",
            )
        return open_source(file, max_bytes)

    return beside


def load_columns(
    data: str | os.PathLike[str],
    machine: MachineFile | Machine | None = None,
    *,
    max_bytes: int = DEFAULT_MAX_BYTES,
) -> dict[str, NDArray[np.float64]]:
    """The canonical SI columns of a file as arrays of shape (samples,), values that are not finite included.

    Raises as `load`, but for what only a Recording refuses.
    """
    rules = machine.columns if isinstance(machine, MachineFile) else None
    allow_outside = isinstance(machine, MachineFile) and machine.allow_outside
    with readable(data):
        source = source_of(data, max_bytes, machine)
        return taken(source, rules, _beside(data, max_bytes, allow_outside), finite=False)[0]


def _is_load_alone(columns: Columns) -> bool:
    """Whether a speed or angle and the torque of the load are all that was recorded of the motion."""
    drive = {"i_a", "i_b", "i_c", "i_d", "i_q", "tau_e"}
    turning = {"omega_e", "omega_m", "theta_e", "theta_m"}
    return "tau_m" in columns and not drive & {*columns} and bool(turning & {*columns})


def _nothing_to_ask(columns: Columns, account: Account, source: Source) -> NothingToAsk:
    """What a load torque and a speed by themselves leave to say."""
    error = refuse(
        NothingToAsk,
        "the torque is that of the load, and neither currents nor a torque of the motor were read",
        file=source.file,
        column="tau_m",
        fix="log the currents, or map the torque to tau_e in [columns] if the motor makes it",
    )
    error.read = told(account, columns["t"], None, None)
    return error


def _with_place(error: DataError, source: Source, first: int) -> DataError:
    """The core's refusal with the file and with the row where the user finds it, `first` rows having been cut
    before the recording.
    """
    row, column, fix = fact(error, "row"), fact(error, "column"), fact(error, "fix")
    problem = fact(error, "problem")
    if not isinstance(problem, str) or not isinstance(fix, str):
        return refuse(
            DataError, message(error), file=source.file, fix="see what a recording needs in the documentation"
        )
    if row is None and "missing" in problem:
        fix += f" (the file has {', '.join(source.names[:20])}; map them in [columns])"
    number, words = source.place(first + row) if isinstance(row, int) else (None, None)
    return refuse(
        DataError,
        problem,
        file=source.file,
        row=number,
        place=words,
        column=column if isinstance(column, str) else None,
        fix=fix,
    )

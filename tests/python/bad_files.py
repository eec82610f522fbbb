"""Unusable recordings by kind and format, each with words that its refusal must hold."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import asammdf
import h5py
import nptdms
import numpy as np
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet
import scipy.io
from conftest import csv_text, plausible

Table = dict[str, Any]
Writer = Callable[[Path, Table], None]


class Bad(NamedTuple):
    """A file that must be refused: what is wrong, in which format, and words of the refusal."""

    kind: str
    file: Path
    words: tuple[str, ...]


def write_csv(path: Path, table: Table) -> None:
    rows = zip(*table.values(), strict=True)
    lines = [",".join("" if value is None else str(value) for value in row) for row in rows]
    path.write_text("\n".join([",".join(table), *lines]) + "\n")


def write_parquet(path: Path, table: Table) -> None:
    pyarrow.parquet.write_table(pa.table(table), path)


def write_feather(path: Path, table: Table) -> None:
    pyarrow.feather.write_feather(pa.table(table), str(path), compression="uncompressed")


def write_npz(path: Path, table: Table) -> None:
    np.savez(path, **table)


def write_mat(path: Path, table: Table) -> None:
    scipy.io.savemat(path, table)


def write_hdf5(path: Path, table: Table) -> None:
    with h5py.File(path, "w") as file:
        for name, values in table.items():
            array = np.asarray(values)
            file[name] = array.astype("S") if array.dtype.kind == "U" else array


def write_tdms(path: Path, table: Table) -> None:
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(
            [nptdms.ChannelObject("run", name, np.asarray(values)) for name, values in table.items()]
        )


def signal(name: str, values: np.ndarray, t: np.ndarray) -> asammdf.Signal:
    if values.dtype.kind == "U":
        return asammdf.Signal(values.astype("S"), t, name=name, encoding="utf-8")
    return asammdf.Signal(values, t, name=name)


def write_mdf(path: Path, table: Table) -> None:
    t = np.asarray(table["t"])
    mdf = asammdf.MDF(version="4.10")
    mdf.append([signal(name, np.asarray(values), t) for name, values in table.items() if name != "t"])
    mdf.save(path, overwrite=True)
    mdf.close()


def write_json(path: Path, table: Table) -> None:
    path.write_text(json.dumps({name: list(np.asarray(values).tolist()) for name, values in table.items()}))


WRITERS: Mapping[str, Writer] = {
    "csv": write_csv,
    "parquet": write_parquet,
    "feather": write_feather,
    "npz": write_npz,
    "mat": write_mat,
    "h5": write_hdf5,
    "tdms": write_tdms,
    "mf4": write_mdf,
    "json": write_json,
}
ARRAYS = ("npz", "mat", "h5")
TABLES = tuple(WRITERS)


def sound() -> Table:
    return dict(plausible())


def changed(**new: Any) -> Table:
    return {**sound(), **new}


def without(*names: str) -> Table:
    return {name: values for name, values in sound().items() if name not in names}


def edited(name: str, row: int, value: float) -> Table:
    values = sound()[name].copy()
    values[row] = value
    return changed(**{name: values})


def contents() -> Iterator[tuple[str, Table, tuple[str, ...], tuple[str, ...]]]:
    """Kind, table, words of the refusal and formats of all that is wrong with the numbers themselves."""
    t = sound()["t"]
    yield "not a number", edited("i_q", 17, np.nan), ("i_q", "not a number"), TABLES
    yield "infinity", edited("i_q", 18, -np.inf), ("i_q", "infinite"), TABLES
    yield "overflow mark", edited("v_d", 19, 9.9e37), ("v_d", "the value is"), TABLES
    yield "time runs back", edited("t", 50, 0.001), ("runs back",), TABLES
    yield "time stands still", edited("t", 50, 0.049), ("stands still",), TABLES
    few = {name: values[:9] for name, values in sound().items()}
    yield "too few samples", few, ("9 samples",), TABLES
    yield "no current", without("i_d", "i_q"), ("i_q", "missing"), TABLES
    yield "neither speed nor angle", without("omega_e", "theta_e"), ("omega_e", "missing"), TABLES
    timed = tuple(name for name in TABLES if name != "mf4")
    yield "no time", without("t"), ("time",), timed
    text = [f"{value:.3f} A" for value in sound()["i_d"]]
    yield "text for numbers", changed(i_d=text), ("i_d",), TABLES
    yield "complex numbers", changed(i_d=sound()["i_d"] + 1j), ("i_d", "complex", ".real"), ARRAYS
    yield "matrix", changed(i_d=np.ones((400, 2))), ("i_d", "dimensions", "[:,0]"), (*ARRAYS, "json")
    yield "unequal lengths", changed(i_d=np.ones(7)), ("7 rows",), (*ARRAYS, "tdms", "json")
    gap: list[float | None] = list(sound()["i_q"])
    gap[17] = None
    yield "missing value", changed(i_q=gap), ("i_q", "missing"), ("csv", "parquet", "feather", "json")
    dates = np.datetime64("2020-01-01", "us") + np.arange(400) * np.timedelta64(1, "ms")
    yield "dates", changed(t=dates.astype("M8[us]")), ("t",), ("parquet", "feather", "npz", "tdms")
    slow = np.unwrap(sound()["theta_e"]) / 3.0
    yield "mechanical angle called electrical", changed(theta_e=slow), ("theta_e", "mechanical"), TABLES
    against = np.remainder(-sound()["theta_e"], 2.0 * np.pi)
    yield (
        "angle against speed",
        changed(theta_e=against),
        ("against",),
        ("csv", "parquet", "h5", "tdms", "mf4"),
    )
    degrees = np.degrees(np.unwrap(sound()["theta_e"])) / 20.0
    yield "angle in another unit", changed(theta_e=degrees), ("times as fast",), ("csv", "npz", "mat", "json")
    doubtful = {("speed" if name == "omega_e" else name): v for name, v in without("theta_e").items()}
    yield "speed in doubt", doubtful, ("speed", "mechanical"), TABLES
    bare = {("time" if name == "t" else name): values for name, values in sound().items()}
    yield "time without unit", bare, ("time", "unit"), tuple(name for name in timed)
    twins = {("isd" if name == "i_d" else "id" if name == "v_d" else name): v for name, v in sound().items()}
    yield "two columns for one quantity", twins, ("both", "i_d"), TABLES
    assert len(t) == 400


def shells(folder: Path) -> Iterator[tuple[str, str, bytes, tuple[str, ...]]]:
    """Kind, file name, bytes and words of everything that is wrong with the file around the numbers."""
    csv = csv_text(plausible()).encode()
    for suffix, write in WRITERS.items():
        path = folder / f"whole.{suffix}"
        write(path, sound())
        whole = path.read_bytes()
        path.unlink()
        yield "empty file", f"empty.{suffix}", b"", ("empty",)
        cut = whole[: len(whole) * 6 // 10 - 5]
        yield "cut short", f"cut.{suffix}", cut, ()
        middle = len(whole) // 3
        yield "damage inside", f"damage.{suffix}", whole[:middle] + b"\xff" * middle + whole[2 * middle :], ()
        if suffix != "csv":
            yield "name and content differ", f"named.{suffix}", csv, ("the name says", "content")
            yield "only the first bytes", f"head.{suffix}", whole[:24], ()
    for name, head, word in (
        ("gzip archive", b"\x1f\x8b\x08", "gzip"),
        ("spreadsheet", b"\xd0\xcf\x11\xe0", "spreadsheet"),
        ("PDF", b"%PDF-1.7", "PDF"),
        ("picture", b"\x89PNG\r\n\x1a\n", "picture"),
        ("program", b"\x7fELF", "program"),
        ("array without names", b"\x93NUMPY\x01\x00", "npy"),
        ("Feather of version 1", b"FEA1", "version 1"),
    ):
        yield "another kind of file", f"{name}.csv", head + bytes(200), (word,)
    yield "nothing but zeros", "zeros.csv", bytes(4096), ("NUL",)
    yield "prose", "prose.csv", b"Dear colleague,\nthe bench is broken again.\nBest regards\n", ("no table",)
    yield "header only", "header.csv", csv.splitlines()[0], ("no rows",)
    yield "nested without end", "deep.json", b'{"a":' * 30_000, ("JSON",)
    yield "a name twice", "twice.json", b'{"t": [1, 2], "t": [3, 4]}', ("two columns",)
    yield "a name twice", "twice.csv", csv.replace(b"v_d", b"i_d", 1), ("two columns",)
    records = [{"t": 1e-3 * k, "i_d": 0.0, "i_q": 1.0, "omega_e": 5.0} for k in range(40)]
    lines = [json.dumps(record) for record in records]
    odd = json.dumps([*records[:9], {"t": 0.009}, *records[10:]]).encode()
    yield "records that differ", "records.json", odd, ("record 9",)
    broken = "\n".join([*lines[:20], lines[20][:30], *lines[21:]]).encode()
    yield "damage inside", "lines.json", broken, ("line 21",)
    yield "text for numbers", "strings.json", odd.replace(b'"i_d": 0.0', b'"i_d": "OVER"'), ()


def hdf5_that_reaches_out(folder: Path) -> Iterator[tuple[str, Path, tuple[str, ...]]]:
    """HDF5 files that would make a trusting reader open other files, or unpack what is not there."""
    secret = folder / "secret.bin"
    secret.write_bytes(np.zeros(400).tobytes())
    other = folder / "other.h5"
    write_hdf5(other, sound())

    def start(name: str, missing: str = "i_q") -> Path:
        write_hdf5(folder / name, without(missing))
        return folder / name

    path = start("external_link.h5")
    with h5py.File(path, "a") as file:
        file["i_q"] = h5py.ExternalLink("other.h5", "/i_q")
    yield "link out of the file", path, ("i_q", "link", "h5repack")
    path = start("soft_link.h5")
    with h5py.File(path, "a") as file:
        file["i_q"] = h5py.SoftLink("/i_d")
    yield "link out of the file", path, ("i_q", "link", "h5repack")
    path = start("external_storage.h5")
    with h5py.File(path, "a") as file:
        file.create_dataset("i_q", shape=(400,), dtype="f8", external=[(str(secret), 0, 3200)])
    yield "values in another file", path, ("i_q", "another file")
    path = start("virtual.h5")
    with h5py.File(path, "a") as file:
        layout = h5py.VirtualLayout(shape=(400,), dtype="f8")
        layout[:] = h5py.VirtualSource("other.h5", "i_q", shape=(400,))
        file.create_virtual_dataset("i_q", layout)
    yield "values in another file", path, ("i_q", "another file")
    path = start("unwritten.h5")
    with h5py.File(path, "a") as file:
        file.create_dataset("i_q", shape=(400,), dtype="f8", chunks=(100,))
    yield "values that were never written", path, ("i_q", "not all in the file")
    path = start("declared.h5")
    with h5py.File(path, "a") as file:
        file.create_dataset("i_q", shape=(10**12,), dtype="f8", chunks=(1 << 20,))
    yield "more than memory holds", path, ("bytes", "max_bytes")


def too_much(folder: Path) -> Iterator[tuple[str, Path, tuple[str, ...]]]:
    """Small files that unpack to more than is allowed, and files that lie about their length."""
    rows = 72 << 20
    with h5py.File(folder / "bomb.h5", "w") as file:
        for name in ("t", "i_d", "i_q", "omega_e"):
            item = file.create_dataset(name, (rows,), "f8", chunks=(1 << 20,), compression="gzip")
            packed = None
            for k in range(rows >> 20):
                if packed is None:
                    item[: 1 << 20] = 0.0
                    packed = item.id.read_direct_chunk((0,))[1]
                else:
                    item.id.write_direct_chunk((k << 20,), packed)
    yield "more than memory holds", folder / "bomb.h5", ("bytes", "max_bytes")
    # Within what is allowed, but not within what there is.
    with h5py.File(folder / "large.h5", "w") as file, h5py.File(folder / "bomb.h5") as bomb:
        for name in ("t", "i_d", "i_q"):
            bomb.copy(name, file)
        file.create_dataset("omega_e", data=np.zeros(3))
    yield "more than memory holds", folder / "large.h5", ()
    block = pa.table({name: np.zeros(1 << 20) for name in ("t", "i_d", "i_q", "omega_e")})
    with pyarrow.parquet.ParquetWriter(folder / "bomb.parquet", block.schema, compression="zstd") as writer:
        for _ in range(120):
            writer.write_table(block)
    yield "more than memory holds", folder / "bomb.parquet", ("bytes", "max_bytes")
    path = folder / "lie.tdms"
    write_tdms(path, sound())
    rows_here, rows_said = (400).to_bytes(8, "little"), (1 << 40).to_bytes(8, "little")
    path.write_bytes(path.read_bytes().replace(rows_here, rows_said))
    yield "a length that is not true", path, ()
    path = folder / "lie.mf4"
    write_mdf(path, sound())
    path.write_bytes(path.read_bytes().replace(rows_here, rows_said))
    yield "a length that is not true", path, ("bytes", "max_bytes")
    path = folder / "lie2.mf4"
    write_mdf(path, sound())
    path.write_bytes(path.read_bytes().replace(rows_here, (500).to_bytes(8, "little")))
    yield "a length that is not true", path, ()


def units(folder: Path) -> Iterator[tuple[str, Path, tuple[str, ...]]]:
    """Containers whose stated units contradict their columns."""
    for unit, kind, words in (
        ("furlong", "unknown unit", ("furlong",)),
        ("V", "unit of another quantity", ("voltage", "current")),
    ):
        path = folder / f"{unit}.h5"
        write_hdf5(path, sound())
        with h5py.File(path, "a") as file:
            file["i_d"].attrs["units"] = unit
        yield kind, path, ("i_d", *words)
        path = folder / f"{unit}.tdms"
        with nptdms.TdmsWriter(path) as writer:
            writer.write_segment(
                [
                    nptdms.ChannelObject("run", name, values, {"unit_string": unit} if name == "i_d" else {})
                    for name, values in sound().items()
                ]
            )
        yield kind, path, ("i_d", *words)
        path = folder / f"{unit}.mf4"
        mdf = asammdf.MDF(version="4.10")
        t = sound()["t"]
        mdf.append(
            [
                asammdf.Signal(values, t, name=name, unit=unit if name == "i_d" else "")
                for name, values in without("t").items()
            ]
        )
        mdf.save(path, overwrite=True)
        mdf.close()
        yield kind, path, ("i_d", *words)
    path = folder / "rates.mf4"
    mdf = asammdf.MDF(version="4.10")
    rest = without("t", "i_d")
    mdf.append([asammdf.Signal(values, t, name=name) for name, values in rest.items()])
    mdf.append([asammdf.Signal(sound()["i_d"][::2], t[::2], name="i_d")])
    mdf.save(path, overwrite=True)
    mdf.close()
    yield "different sample times", path, ("i_d", "other times")
    path = folder / "unfinished.mf4"
    write_mdf(path, sound())
    path.write_bytes(b"UnFinMF " + path.read_bytes()[8:])
    yield "never finished", path, ("never finished",)
    path = folder / "invalid.mf4"
    mdf = asammdf.MDF(version="4.10")
    bits = np.zeros(400, bool)
    bits[17] = True
    mdf.append(
        [
            asammdf.Signal(values, t, name=name, invalidation_bits=bits if name == "i_d" else None)
            for name, values in without("t").items()
        ]
    )
    mdf.save(path, overwrite=True)
    mdf.close()
    yield "missing value", path, ("i_d", "missing", "17")


def bad_files(folder: Path) -> Iterator[Bad]:
    """Writes every bad file below `folder`."""
    for kind, table, words, formats in contents():
        for suffix in formats:
            path = folder / f"{kind.replace(' ', '_')}.{suffix}"
            WRITERS[suffix](path, table)
            yield Bad(kind, path, words)
    for kind, name, data, words in shells(folder):
        path = folder / name
        path.write_bytes(data)
        yield Bad(kind, path, words)
    for source in (hdf5_that_reaches_out, too_much, units):
        for kind, path, words in source(folder):
            yield Bad(kind, path, words)

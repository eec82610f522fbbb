"""Contents of files that are no recording: edited, cut short, of another kind or larger than they say."""

from __future__ import annotations

import io
import struct
import zipfile

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import scipy.io
from conftest import Columns, csv_text, plausible


def edited(line: int, column: str, value: str) -> bytes:
    """A good CSV file in which one cell (line from 1) is replaced."""
    columns = plausible()
    lines = csv_text(columns).splitlines()
    cells = lines[line - 1].split(",")
    cells[list(columns).index(column)] = value
    lines[line - 1] = ",".join(cells)
    return ("\n".join(lines) + "\n").encode()


def without(*names: str) -> bytes:
    return csv_text({name: values for name, values in plausible().items() if name not in names}).encode()


def changed(**new: np.ndarray) -> bytes:
    return csv_text({**plausible(), **new}).encode()


def renamed(**header: str) -> bytes:
    return csv_text(plausible(), header).encode()


def lines_of() -> list[str]:
    return csv_text(plausible()).splitlines()


def time_edited(row: int, value: float) -> bytes:
    t = plausible()["t"].copy()
    t[row] = value
    return changed(t=t)


def parquet_bytes(columns: Columns | None = None) -> bytes:
    out = io.BytesIO()
    pyarrow.parquet.write_table(pa.table(dict(columns or plausible())), out)
    return out.getvalue()


def parquet_with_gap() -> bytes:
    columns: dict[str, object] = dict(plausible())
    values: list[float | None] = list(plausible()["i_q"])
    values[17] = None
    columns["i_q"] = pa.array(values)
    out = io.BytesIO()
    pyarrow.parquet.write_table(pa.table(columns), out)
    return out.getvalue()


def parquet_of_text() -> bytes:
    columns: dict[str, object] = dict(plausible())
    columns["i_d"] = [str(value) for value in plausible()["i_d"]]
    out = io.BytesIO()
    pyarrow.parquet.write_table(pa.table(columns), out)
    return out.getvalue()


def parquet_bomb() -> bytes:
    """Hundreds of millions of zeros in little space."""
    out = io.BytesIO()
    block = pa.table({"t": np.zeros(1 << 20), "i_d": np.zeros(1 << 20)})
    with pyarrow.parquet.ParquetWriter(out, block.schema, compression="zstd") as writer:
        for _ in range(300):
            writer.write_table(block)
    return out.getvalue()


def npz_bytes(**arrays: object) -> bytes:
    out = io.BytesIO()
    np.savez(out, **arrays)  # type: ignore[arg-type]
    return out.getvalue()


def beside_t(archive: zipfile.ZipFile) -> None:
    """All columns of a sound recording but t, as members of an .npz archive."""
    for name, values in plausible().items():
        if name != "t":
            with archive.open(f"{name}.npy", "w") as member:
                np.lib.format.write_array(member, values)


def npz_bomb() -> bytes:
    """A header that declares 8 TB behind a handful of bytes."""
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }".ljust(117) + b"\n"
    body = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("t.npy", body)
        beside_t(archive)
    return out.getvalue()


def npz_deflated_bomb() -> bytes:
    """More than 2 GiB of zeros, deflated to 2 MB."""
    out = io.BytesIO()
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f8", "fortran_order": False, "shape": (272 << 20,)}
    )
    zeros = bytes(1 << 24)
    with (
        zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("t.npy", "w", force_zip64=True) as member,
    ):
        member.write(header.getvalue())
        for _ in range(136):
            member.write(zeros)
    with zipfile.ZipFile(out, "a", zipfile.ZIP_DEFLATED) as archive:
        beside_t(archive)
    return out.getvalue()


def pickled_objects() -> bytes:
    out = io.BytesIO()
    array = np.array([{"a": 1}, {"b": 2}], dtype=object)
    with zipfile.ZipFile(out, "w") as archive:
        with archive.open("t.npy", "w") as member:
            np.lib.format.write_array(member, array, allow_pickle=True)
        beside_t(archive)
    return out.getvalue()


def mat_bytes(**arrays: object) -> bytes:
    out = io.BytesIO()
    scipy.io.savemat(out, arrays)
    return out.getvalue()


def mechanical_angle() -> bytes:
    columns = plausible()
    return changed(theta_e=np.unwrap(columns["theta_e"]) / 3.0)

"""Damaged files of every format are read or refused; they never crash the interpreter."""

from __future__ import annotations

import io
import json
import re
import tempfile
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from random import Random

import asammdf
import h5py
import nptdms
import numpy as np
import pmsm_rs as pm
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet
import pytest
import scipy.io
from conftest import Columns, csv_text, plausible
from hypothesis import given, settings
from hypothesis import strategies as st


@cache
def whole_files() -> dict[str, bytes]:
    """One sound file per format, the same bytes whenever it is made."""
    columns = plausible(60)
    out: dict[str, bytes] = {
        "comma.csv": csv_text(columns).encode(),
        "semicolon.csv": csv_text(columns, separator=";").replace(".", ",").encode(),
        "preamble.csv": b"Model,7\n\n" + csv_text(columns, {"t": "t [s]"}).encode(),
    }
    for name, write in {
        "r.parquet": lambda buffer: pyarrow.parquet.write_table(pa.table(dict(columns)), buffer),
        "r.feather": lambda buffer: pyarrow.feather.write_feather(pa.table(dict(columns)), buffer),
        "r.npz": lambda buffer: np.savez_compressed(buffer, **columns),
        "r.mat": lambda buffer: scipy.io.savemat(buffer, dict(columns), do_compression=True),
        "plain.mat": lambda buffer: scipy.io.savemat(buffer, dict(columns)),
    }.items():
        buffer = io.BytesIO()
        write(buffer)
        # the header of a MAT-file is 116 characters of text with the time of day
        out[name] = b"MATLAB 5.0".ljust(116) + buffer.getvalue()[116:] if "mat" in name else buffer.getvalue()
    with tempfile.TemporaryDirectory() as folder:
        for name, write_file in {"r.h5": write_hdf5, "r.tdms": write_tdms, "r.mf4": write_mdf}.items():
            path = Path(folder) / name
            write_file(path, columns)
            out[name] = path.read_bytes()
    # eight bytes of each entry in the history of an MDF file are the time of day
    out["r.mf4"] = re.sub(rb"(##FH.{36}).{8}", rb"\g<1>" + bytes(8), out["r.mf4"], flags=re.DOTALL)
    lists = {name: values.tolist() for name, values in columns.items()}
    out["r.json"] = json.dumps(lists).encode()
    return out


def write_hdf5(path: Path, columns: Columns) -> None:
    with h5py.File(path, "w") as file:
        for k, (name, values) in enumerate(columns.items()):
            file.create_dataset(name, data=values, compression="gzip" if k % 2 else None)


def write_tdms(path: Path, columns: Columns) -> None:
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([nptdms.ChannelObject("run", name, values) for name, values in columns.items()])


def write_mdf(path: Path, columns: Columns) -> None:
    mdf = asammdf.MDF(version="4.10")
    rest = {name: values for name, values in columns.items() if name != "t"}
    mdf.start_time = datetime(2020, 1, 1, tzinfo=UTC)
    mdf.append([asammdf.Signal(values, columns["t"], name=name) for name, values in rest.items()])
    mdf.save(path, overwrite=True, compression=1)
    mdf.close()


def damaged(whole: bytes, source: Random) -> bytes:
    """`whole` with bytes flipped, inserted, removed, repeated or cut off."""
    data = bytearray(whole)
    for _ in range(source.choice([1, 1, 2, 5, 20])):
        at, other = source.randrange(len(data)), source.randrange(len(data))
        kind = source.randrange(10)
        if kind < 5:
            data[at] = source.randrange(256)
        elif kind < 6:
            data[at:at] = source.choice([b",", b";", b"\n", b'"', b"nan", b"1e999", b"#", b"\t", b"OVER"])
        elif kind < 7:
            data[at:at] = bytes(source.randrange(256) for _ in range(8))
        elif kind < 8 and len(data) > 400:
            del data[at : at + source.randrange(1, 200)]
        elif kind < 9:
            data[at:at] = data[other : other + 200]
        else:
            del data[max(at, 1) :]
    return bytes(data)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("damage")


@pytest.mark.parametrize("name", whole_files())
def test_whole_files_are_read(name: str, folder: Path) -> None:
    (folder / name).write_bytes(whole_files()[name])
    assert len(pm.load(folder / name)) == 60


@pytest.mark.parametrize("name", whole_files())
@settings(max_examples=20)
@given(source=st.randoms(use_true_random=False, note_method_calls=True))
def test_damaged_files_are_read_or_refused(name: str, source: Random, folder: Path) -> None:
    path = folder / name
    path.write_bytes(damaged(whole_files()[name], source))
    refusal = None
    try:
        pm.load(path)
    except pm.PmsmError as error:
        refusal = str(error)
    if refusal is not None:
        assert str(path) in refusal
        assert "; " in refusal
        assert "\n" not in refusal


@pytest.mark.parametrize("name", ["r.parquet", "r.feather"])
def test_a_decoder_that_gave_up_is_not_asked_again(name: str, folder: Path) -> None:
    data = bytearray(whole_files()[name])
    data[40:1200] = b"\xff" * 1160
    (folder / name).write_bytes(data)
    try:
        text = str(pm.inspect(folder / name))
    except pm.DataError as error:
        text = str(error)
    assert "cannot be read" in text

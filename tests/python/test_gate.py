"""Names, kinds, parts and sizes follow the same rules in every format: a matrix of formats and selections."""

from __future__ import annotations

import json
import math
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import asammdf
import h5py
import nptdms
import numpy as np
import pandas as pd
import pmsm_rs as pm
import pyarrow as pa
import pyarrow.parquet
import pytest
import scipy.io
from conftest import plausible

Columns = list[tuple[str, Any]]
"""Names and values; a name may come twice."""
ROWS = 60


def text_of(value: object) -> str:
    return str(value).lower() if isinstance(value, bool | np.bool_) else str(value)


def csv(path: Path, columns: Columns) -> Path:
    rows = [",".join(text_of(value) for value in row) for row in zip(*(x for _, x in columns), strict=True)]
    path.write_text("\n".join([",".join(name for name, _ in columns), *rows]) + "\n")
    return path


def json_lists(path: Path, columns: Columns) -> Path:
    lists = [f"{json.dumps(name)}: {json.dumps(np.asarray(x).tolist())}" for name, x in columns]
    path.write_text("{" + ", ".join(lists) + "}")
    return path


def json_records(path: Path, columns: Columns) -> Path:
    names = [json.dumps(name) for name, _ in columns]
    rows = zip(*(np.asarray(x).tolist() for _, x in columns), strict=True)
    records = [
        "{" + ", ".join(f"{name}: {json.dumps(value)}" for name, value in zip(names, row, strict=True)) + "}"
        for row in rows
    ]
    path.write_text("[" + ",".join(records) + "]")
    return path


def npz(path: Path, columns: Columns) -> Path:
    with zipfile.ZipFile(path, "w") as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        for name, values in columns:
            with archive.open(f"{name}.npy", "w") as handle:
                np.lib.format.write_array(handle, np.asarray(values))
    return path


def mat(path: Path, columns: Columns, **options: Any) -> Path:
    whole = b""
    for name, values in columns:
        scipy.io.savemat(path, {name: np.asarray(values)}, oned_as="column", **options)
        whole += path.read_bytes()[128:] if whole else path.read_bytes()
    path.write_bytes(whole)
    return path


def mat_packed(path: Path, columns: Columns) -> Path:
    return mat(path, columns, do_compression=True)


def mat73(path: Path, columns: Columns) -> Path:
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, given in columns:
            values = np.asarray(given)
            matrix = values.reshape(len(values), math.prod(values.shape[1:])).T
            kind = "double"
            if np.iscomplexobj(matrix):
                pairs = np.empty(matrix.shape, dtype=[("real", "f8"), ("imag", "f8")])
                pairs["real"], pairs["imag"] = matrix.real, matrix.imag
                matrix = pairs
            elif matrix.dtype.kind == "b":
                matrix, kind = matrix.astype("u1"), "logical"
            elif matrix.dtype.kind == "U":
                matrix, kind = np.array([list(map(ord, text)) for text in given], "u2").T, "char"
            _hdf5_item(file, name, matrix).attrs["MATLAB_class"] = np.bytes_(kind)
    with path.open("r+b") as handle:
        handle.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\x00\x02IM")
    return path


def hdf5(path: Path, columns: Columns) -> Path:
    with h5py.File(path, "w") as file:
        for name, given in columns:
            values = np.asarray(given)
            _hdf5_item(file, name, values.astype("S") if values.dtype.kind == "U" else values)
    return path


def _hdf5_item(file: h5py.File, name: str, values: np.ndarray) -> Any:
    """A dataset; a second one of the name as field of a table, which goes by the same name."""
    if name in file:
        group, field = name.split(".")
        return file.create_dataset(group, data=np.rec.fromarrays([values], names=[field]))
    return file.create_dataset(name, data=values)


def arrow_table(columns: Columns) -> pa.Table:
    return pa.Table.from_arrays([pa.array(np.asarray(x)) for _, x in columns], [name for name, _ in columns])


def parquet(path: Path, columns: Columns) -> Path:
    pyarrow.parquet.write_table(arrow_table(columns), path)
    return path


def feather(path: Path, columns: Columns) -> Path:
    table = arrow_table(columns)
    with pa.ipc.new_file(str(path), table.schema) as writer:
        writer.write_table(table)
    return path


def arrow_file(path: Path, columns: Columns) -> Path:
    table = arrow_table(columns)
    with pa.ipc.new_stream(str(path), table.schema) as writer:
        writer.write_table(table)
    return path


def tdms(path: Path, columns: Columns) -> Path:
    """Channels of one group; a second one of a path by a group whose name holds part of it."""
    seen: set[str] = set()
    channels = []
    for name, values in columns:
        group, channel = ("run", name) if name not in seen else ("run/a", name.removeprefix("a/"))
        seen.add(name)
        channels.append(nptdms.ChannelObject(group, channel, np.asarray(values)))
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(channels)
    return path


def mdf(path: Path, columns: Columns) -> Path:
    t = next(np.asarray(values) for name, values in columns if name == "t")
    file = asammdf.MDF(version="4.10")
    signals = []
    for name, given in columns:
        values = np.asarray(given)
        options = {"encoding": "utf-8"} if values.dtype.kind == "U" else {}
        if name != "t":
            values = values.astype("S") if values.dtype.kind == "U" else values
            signals.append(asammdf.Signal(values, t, name=name, **options))
    file.append(signals)
    file.save(path, overwrite=True)
    file.close()
    return path


class Seven:
    """Another key of a mapping that reads "7"."""

    def __str__(self) -> str:
        return "7"


def mapping(_path: Path, columns: Columns) -> dict[Any, Any]:
    out: dict[Any, Any] = {}
    for name, values in columns:
        out[Seven() if name in out else name] = np.asarray(values)
    return out


def lists(_path: Path, columns: Columns) -> dict[Any, Any]:
    return {name: np.asarray(x).tolist() for name, x in mapping(_path, columns).items()}


def pandas(_path: Path, columns: Columns) -> pd.DataFrame:
    frame = pd.DataFrame({k: values for k, (_, values) in enumerate(columns)})
    frame.columns = pd.Index([name for name, _ in columns])
    return frame


def arrow_stream(_path: Path, columns: Columns) -> pa.RecordBatchReader:
    return arrow_table(columns).to_reader(max_chunksize=17)


FORMATS: dict[str, tuple[Callable[[Path, Columns], Any], str]] = {
    "CSV": (csv, "csv"),
    "JSON": (json_lists, "json"),
    "JSON records": (json_records, "json"),
    "npz": (npz, "npz"),
    "mat v5": (mat, "mat"),
    "mat v5, packed": (mat_packed, "mat"),
    "mat v7.3": (mat73, "mat"),
    "HDF5": (hdf5, "h5"),
    "Parquet": (parquet, "parquet"),
    "Feather": (feather, "feather"),
    "Arrow stream in a file": (arrow_file, "arrow"),
    "TDMS": (tdms, "tdms"),
    "MDF": (mdf, "mf4"),
    "mapping of arrays": (mapping, ""),
    "mapping of lists": (lists, ""),
    "pandas": (pandas, ""),
    "Arrow stream": (arrow_stream, ""),
}
COMPLEX = (
    "npz",
    "mat v5",
    "mat v5, packed",
    "mat v7.3",
    "HDF5",
    "mapping of arrays",
    "mapping of lists",
    "pandas",
)
MATRICES = (
    "JSON",
    "JSON records",
    "npz",
    "mat v5",
    "mat v5, packed",
    "mat v7.3",
    "HDF5",
    "mapping of arrays",
    "mapping of lists",
)
# In these a name can come twice in one way only.
TWICE = {
    "mat v7.3": "log.x",
    "HDF5": "log.x",
    "TDMS": "a/x",
    "mapping of arrays": "7",
    "mapping of lists": "7",
}


def base(rows: int = ROWS) -> Columns:
    return [(name, values) for name, values in plausible(rows).items() if name != "i_q"]


class Bench:
    """Writes a recording in a format and reads it with `i_q` from a column of choice."""

    def __init__(self, name: str, folder: Path) -> None:
        self.write, self.suffix = FORMATS[name]
        self.folder = folder

    def load(self, columns: Columns, source: str | None, rows: int = ROWS, **options: Any) -> pm.Recording:
        machine = self.folder / "machine.toml"
        rule = f"i_q = {{ from = {json.dumps(source)} }}\n" if source is not None else ""
        machine.write_text(f"[machine]\nn_p = 3\n[columns]\n{rule}")
        recording = self.write(self.folder / f"r.{self.suffix}", [*base(rows), *columns])
        return pm.load(recording, machine, **options)

    def refusal(self, columns: Columns, source: str | None, rows: int = ROWS, **options: Any) -> str:
        with pytest.raises(pm.DataError) as caught:
            self.load(columns, source, rows, **options)
        text = str(caught.value)
        assert "; " in text
        assert "\n" not in text
        return text


@pytest.fixture
def bench(request: pytest.FixtureRequest, tmp_path: Path) -> Bench:
    return Bench(request.param, tmp_path)


def formats(names: tuple[str, ...] = tuple(FORMATS)) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("bench", names, indirect=True)


CURRENT = np.cos(np.arange(ROWS) / 7.0)
OTHER = np.sin(np.arange(ROWS) / 5.0)


@formats()
def test_a_plain_column(bench: Bench) -> None:
    recording = bench.load([("x", CURRENT)], "x")
    np.testing.assert_allclose(recording.column("i_q"), CURRENT, rtol=1e-15)


@formats()
@pytest.mark.parametrize("dtype", ["i2", "u4", "f4"])
def test_whole_numbers_and_single_precision_are_numbers(bench: Bench, dtype: str) -> None:
    values = np.arange(ROWS).astype(dtype)
    np.testing.assert_array_equal(bench.load([("x", values)], "x").column("i_q"), np.arange(ROWS))


@formats(COMPLEX)
def test_the_parts_of_complex_values(bench: Bench) -> None:
    pair = [("x", CURRENT + 1j * OTHER)]
    np.testing.assert_array_equal(bench.load(pair, "x.real").column("i_q"), CURRENT)
    np.testing.assert_array_equal(bench.load(pair, "x.imag").column("i_q"), OTHER)
    assert "it holds complex numbers; take a part of it" in bench.refusal(pair, "x")
    assert bench.load([*pair, ("i_q", CURRENT)], None).column("i_q") is not None


@formats()
def test_the_parts_of_real_values(bench: Bench) -> None:
    np.testing.assert_allclose(bench.load([("x", CURRENT)], "x.real").column("i_q"), CURRENT, rtol=1e-15)
    assert "have no imaginary part" in bench.refusal([("x", CURRENT)], "x.imag")


@formats()
def test_a_column_whose_name_reads_like_a_part(bench: Bench) -> None:
    columns = [("x.imag", OTHER), ("x", CURRENT)]
    np.testing.assert_allclose(bench.load(columns, "x.imag").column("i_q"), OTHER, rtol=1e-15)


@formats()
def test_a_name_twice_is_refused_where_it_is_wanted_and_only_there(
    bench: Bench, request: pytest.FixtureRequest
) -> None:
    name = TWICE.get(request.node.callspec.params["bench"], "x")
    twice = [(name, CURRENT), (name, OTHER)]
    wanted = f"run/{name}" if bench.suffix == "tdms" else name
    said = bench.refusal([*twice, ("spare", CURRENT)], wanted)
    assert f"column '{wanted}': two columns are called '{wanted}'" in said
    recording = bench.load([*twice, ("i_q", OTHER)], None)
    np.testing.assert_allclose(recording.column("i_q"), OTHER, rtol=1e-15)


@formats(tuple(name for name in FORMATS if name not in TWICE))
def test_a_name_twice_that_is_understood_by_itself_is_refused(bench: Bench) -> None:
    assert "two columns are called 'i_q'" in bench.refusal([("i_q", CURRENT), ("i_q", OTHER)], None)


@formats()
def test_truth_values_are_no_numbers(bench: Bench) -> None:
    states = [("x", CURRENT > 0.0)]
    said = bench.refusal(states, "x")
    assert "column 'x'" in said
    assert "no number" in said
    assert bench.load([*states, ("i_q", CURRENT)], None).column("i_q") is not None


@formats()
def test_text_is_no_number(bench: Bench) -> None:
    states = [("x", np.where(CURRENT > 0.0, "RUN", "OFF"))]
    said = bench.refusal(states, "x")
    assert "column 'x'" in said
    assert "no number" in said or "no plain numbers" in said
    assert bench.load([*states, ("i_q", CURRENT)], None).column("i_q") is not None


@formats(("JSON", "JSON records", "mapping of lists"))
@pytest.mark.parametrize(("odd", "says"), [(True, "no number"), ("OVER", "no number"), (None, "missing")])
def test_one_value_among_numbers_that_is_none(bench: Bench, odd: object, says: str, tmp_path: Path) -> None:
    values: list[object] = list(CURRENT)
    values[17] = odd
    if bench.suffix:
        rest = {name: x.tolist() for name, x in base()} | {"i_q": values}
        rows = [dict(zip(rest, row, strict=True)) for row in zip(*rest.values(), strict=True)]
        path = tmp_path / "r.json"
        path.write_text(json.dumps(rows if bench.write is json_records else rest))
        given: Any = path
    else:
        given = {**dict(base()), "i_q": values}
    with pytest.raises(pm.DataError, match=f"row 17 .*column 'i_q': .*{says}"):
        pm.load(given, pm.Machine(n_p=3))


@formats(MATRICES)
def test_a_matrix_is_read_by_its_columns(bench: Bench) -> None:
    stacked = [("x", np.column_stack([CURRENT, OTHER, CURRENT]))]
    np.testing.assert_allclose(bench.load(stacked, "x[:,1]").column("i_q"), OTHER, rtol=1e-15)
    assert "dimensions" in bench.refusal(stacked, "x")
    assert "it has no column 3" in bench.refusal(stacked, "x[:,3]").replace("so ", "")
    assert bench.load([*stacked, ("i_q", CURRENT)], None).column("i_q") is not None


@formats(("npz", "mat v5", "mat v7.3", "HDF5"))
def test_a_part_of_a_complex_matrix(bench: Bench) -> None:
    stacked = [("x", np.column_stack([CURRENT, OTHER]) * (1.0 + 2.0j))]
    np.testing.assert_allclose(bench.load(stacked, "x[:,1].imag").column("i_q"), 2.0 * OTHER, rtol=1e-15)


@formats()
@pytest.mark.parametrize("rows", [0, 1])
def test_no_row_or_one_row_is_too_few(bench: Bench, rows: int) -> None:
    said = bench.refusal([("x", CURRENT[:rows])], "x", rows=rows)
    words = ("1 sample", "header but no rows") if rows else ("no rows", "no columns", "no lists", "content")
    assert any(word in said for word in words)


@formats()
def test_what_the_columns_take_is_compared_with_the_limit(bench: Bench) -> None:
    in_place = not bench.suffix and bench.write in (mapping, pandas)
    columns = [("x", np.arange(ROWS, dtype="f4") if in_place else CURRENT)]
    said = bench.refusal(columns, "x", max_bytes=200)
    assert "bytes" in said
    assert "max_bytes" in said


@formats(("CSV", "npz", "mapping of arrays", "Arrow stream"))
@pytest.mark.parametrize("limit", [math.nan, math.inf, -1, True, "2 GB", None])
def test_a_limit_that_is_no_number_of_bytes(bench: Bench, limit: object) -> None:
    with pytest.raises(pm.UsageError, match=r"max_bytes is .*; give a number of bytes"):
        bench.load([("x", CURRENT)], "x", max_bytes=limit)


def test_headers_of_one_name_are_told_apart_by_their_units(tmp_path: Path) -> None:
    bench = Bench("CSV", tmp_path)
    columns = [("x [mA]", CURRENT * 1e3), ("x [A]", OTHER)]
    np.testing.assert_allclose(bench.load(columns, "x [A]").column("i_q"), OTHER)
    np.testing.assert_allclose(bench.load(columns, "x [mA]").column("i_q"), CURRENT)
    assert "'x [mA]' or 'x [A]'" in bench.refusal(columns, "x")


def test_a_name_in_two_groups_is_refused_with_both_paths(tmp_path: Path) -> None:
    bench = Bench("HDF5", tmp_path)
    columns = [("a/x", CURRENT), ("b/x", OTHER)]
    assert "say which: 'a/x' or 'b/x'" in bench.refusal(columns, "x")
    np.testing.assert_allclose(bench.load(columns, "b/x").column("i_q"), OTHER)


def test_control_characters_of_a_name_are_shown_escaped(tmp_path: Path) -> None:
    bench = Bench("JSON", tmp_path)
    name = "x\x1b]0;title\x07\x1b[2J\u202e"
    said = bench.refusal([(name, np.full(ROWS, "RUN"))], name)
    assert "x\\x1b]0;title\\x07\\x1b[2J\\u202e" in said
    assert said.isprintable()

"""Containers of measurement systems give the same columns as CSV: HDF5, MATLAB v7.3, TDMS, MDF, JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import asammdf
import h5py
import nptdms
import numpy as np
import pmsm_rs as pm
import pytest
from conftest import Columns, csv_text
from pmsm_rs.io.formats import isolated

UNITS = {"t": "s", "v_d": "V", "v_q": "V", "i_d": "A", "i_q": "A", "theta_e": "rad", "omega_e": "rad/s"}


def check(recording: pm.Recording, columns: Columns, rtol: float = 1e-12) -> None:
    assert sorted(recording.names) == sorted(columns)
    for name, values in columns.items():
        np.testing.assert_allclose(recording.column(name), values, rtol=rtol, atol=1e-12, err_msg=name)


def write_mdf(path: Path, groups: list[Columns], time: Any, **options: Any) -> None:
    mdf = asammdf.MDF(version="4.10")
    for k, group in enumerate(groups):
        t = time[k] if isinstance(time, list) else time
        mdf.append(
            [asammdf.Signal(values, t, name=name, unit=UNITS.get(name, "")) for name, values in group.items()]
        )
    mdf.save(path, overwrite=True, **options)
    mdf.close()


def write_tdms(path: Path, columns: Columns, group: str = "run", **properties: Any) -> None:
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(
            [
                nptdms.ChannelObject(group, name, values, {"unit_string": UNITS.get(name, ""), **properties})
                for name, values in columns.items()
            ]
        )


def test_hdf5(columns: Columns, tmp_path: Path) -> None:
    with h5py.File(tmp_path / "r.h5", "w") as file:
        for k, (name, values) in enumerate(columns.items()):
            file.create_dataset(name, data=values, compression="gzip" if k % 2 else None, shuffle=k % 2 == 1)
    check(pm.load(tmp_path / "r.h5"), columns)


def test_hdf5_in_groups_with_units(columns: Columns, tmp_path: Path) -> None:
    with h5py.File(tmp_path / "r.h5", "w") as file:
        for name, values in columns.items():
            where = file.require_group("bench/motor" if name.startswith("i_") else "bench")
            item = where.create_dataset(name, data=values * (1e3 if name == "i_q" else 1.0))
            item.attrs["units"] = "mA" if name == "i_q" else UNITS[name]
    check(pm.load(tmp_path / "r.h5"), columns)


def test_two_runs_in_one_hdf5_file_need_a_choice(
    columns: Columns, tmp_path: Path, machine_file: Path
) -> None:
    with h5py.File(tmp_path / "r.h5", "w") as file:
        for run in ("first", "second"):
            for name, values in columns.items():
                file[f"{run}/{name}"] = values
    with pytest.raises(pm.DataError, match="first/"):
        pm.load(tmp_path / "r.h5", machine_file)
    rules = "\n".join(f'{name} = "second/{name}"' for name in columns)
    machine_file.write_text(f"[machine]\nn_p = 3\n[columns]\n{rules}\n")
    check(pm.load(tmp_path / "r.h5", machine_file), columns)


def test_a_table_in_hdf5(columns: Columns, tmp_path: Path) -> None:
    table = np.rec.fromarrays(list(columns.values()), names=list(columns))
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["log"] = np.asarray(table)
    rules = {name: f"log.{name}" for name in columns}
    path = tmp_path / "m.toml"
    lines = "\n".join(f'{name} = "{source}"' for name, source in rules.items())
    path.write_text(f"[machine]\nn_p = 3\n[columns]\n{lines}\n")
    check(pm.load(tmp_path / "r.h5", path), columns)


def write_matlab(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """As MATLAB's save(..., '-v7.3') writes: a text header, matrices transposed, complex numbers as pairs."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in arrays.items():
            matrix = values.reshape(len(values), -1).T
            if np.iscomplexobj(matrix):
                pairs = np.empty(matrix.shape, dtype=[("real", "f8"), ("imag", "f8")])
                pairs["real"], pairs["imag"] = matrix.real, matrix.imag
                matrix = pairs
            file.create_dataset(name, data=matrix, chunks=matrix.shape, compression="gzip")
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as handle:
        header = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\x00\x02IM"
        handle.write(header)


def test_matlab_73(columns: Columns, tmp_path: Path, machine_file: Path) -> None:
    write_matlab(tmp_path / "r.mat", columns)
    check(pm.load(tmp_path / "r.mat"), columns)
    stacked = np.column_stack(list(columns.values()))
    current = columns["i_d"] + 1j * columns["i_q"]
    write_matlab(tmp_path / "s.mat", {"data": stacked, "i": current})
    rules = "\n".join(
        f'{name} = "data[:,{k}]"' for k, name in enumerate(columns) if not name.startswith("i_")
    )
    machine_file.write_text(f'[machine]\nn_p = 3\n[columns]\n{rules}\ni_d = "i.real"\ni_q = "i.imag"\n')
    check(pm.load(tmp_path / "s.mat", machine_file), columns)


def test_tdms(columns: Columns, tmp_path: Path) -> None:
    write_tdms(tmp_path / "r.tdms", columns)
    check(pm.load(tmp_path / "r.tdms"), columns)


def test_time_of_tdms_waveforms(columns: Columns, tmp_path: Path) -> None:
    rest = {name: values for name, values in columns.items() if name != "t"}
    write_tdms(tmp_path / "r.tdms", rest, wf_increment=1e-3, wf_start_offset=0.0)
    check(pm.load(tmp_path / "r.tdms"), columns)


def test_an_index_file_beside_a_tdms_file_is_not_believed(columns: Columns, tmp_path: Path) -> None:
    write_tdms(tmp_path / "r.tdms", columns)
    (tmp_path / "r.tdms_index").write_bytes(b"TDSh" + bytes(60))
    check(pm.load(tmp_path / "r.tdms"), columns)


@pytest.mark.parametrize("compression", [0, 2])
def test_mdf(columns: Columns, tmp_path: Path, compression: int) -> None:
    t = columns["t"]
    rest = {name: values for name, values in columns.items() if name != "t"}
    write_mdf(tmp_path / "r.mf4", [rest], t, compression=compression)
    check(pm.load(tmp_path / "r.mf4"), columns)
    electrical = {name: rest.pop(name) for name in ("v_d", "v_q", "i_d", "i_q")}
    write_mdf(tmp_path / "s.mf4", [electrical, rest], t, compression=compression)
    check(pm.load(tmp_path / "s.mf4"), columns)


def test_mdf_channels_of_other_groups_do_not_matter(columns: Columns, tmp_path: Path) -> None:
    t = columns["t"]
    rest = {name: values for name, values in columns.items() if name != "t"}
    write_mdf(tmp_path / "r.mf4", [rest, {"oil": np.zeros(20)}], [t, np.arange(20) * 0.1])
    check(pm.load(tmp_path / "r.mf4"), columns)


@pytest.mark.parametrize(
    ("name", "head", "library", "extra"),
    [
        ("r.h5", b"\x89HDF\r\n\x1a\n", "h5py", "hdf5"),
        ("r.mat", b"MATLAB 7.3 MAT-file", "h5py", "hdf5"),
        ("r.tdms", b"TDSm", "nptdms", "tdms"),
        ("r.mf4", b"MDF     4.10", "asammdf", "mdf"),
    ],
)
def test_a_missing_library_is_named_with_the_extra_that_brings_it(
    name: str, head: bytes, library: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(isolated, "find_spec", lambda _name: None)
    (tmp_path / name).write_bytes(head + bytes(200))
    with pytest.raises(
        pm.UsageError, match=rf"{library}.*is not installed.*pip install 'pmsm-rs\[{extra}\]'"
    ):
        pm.load(tmp_path / name)


def test_json(columns: Columns, tmp_path: Path) -> None:
    lists = {name: values.tolist() for name, values in columns.items()}
    records = [dict(zip(lists, row, strict=True)) for row in zip(*lists.values(), strict=True)]
    for name, text in {
        "lists.json": json.dumps(lists),
        "nested.json": json.dumps({"bench": 4, "run": {"note": "warm", "data": lists}}, indent=1),
        "records.json": json.dumps(records),
        "lines.jsonl": "\n".join(json.dumps(record) for record in records) + "\n",
    }.items():
        (tmp_path / name).write_text(text)
        check(pm.load(tmp_path / name), columns)


def test_constants_and_columns_of_another_file(columns: Columns, tmp_path: Path, machine_file: Path) -> None:
    columns["omega_e"] = np.full(len(columns["t"]), 3.0 * 1000.0 * np.pi / 30.0)
    del columns["theta_e"]
    (tmp_path / "a.csv").write_text(csv_text({name: columns[name] for name in ("t", "v_d", "v_q", "i_d")}))
    (tmp_path / "b.csv").write_text(csv_text({"t": columns["t"], "C2": columns["i_q"] * 1e3}))
    machine_file.write_text(
        "[machine]\nn_p = 3\n[columns]\nomega_e = { value = 3000, unit = 'rpm' }\n"
        "i_q = { from = 'C2', file = 'b.csv', unit = 'mA' }\n"
    )
    check(pm.load(tmp_path / "a.csv", machine_file), columns)
    later = {"t": columns["t"] + 0.01, "C2": columns["i_q"]}
    (tmp_path / "b.csv").write_text(csv_text(later))
    with pytest.raises(pm.DataError, match=r"b\.csv, column 'C2': it was not sampled together with .*a\.csv"):
        pm.load(tmp_path / "a.csv", machine_file)


def test_a_map_of_complex_values(tmp_path: Path, machine_file: Path) -> None:
    i = np.linspace(-20, 20, 5)[:, None] + 1j * np.linspace(-30, 30, 7)
    psi = 0.4 + 0.01 * i.real + 0.02j * i.imag
    np.savez(tmp_path / "map.npz", i=i, psi=psi)
    machine_file.write_text(
        "[machine]\nn_p = 2\n[columns]\nt = { period = 1.0 }\nomega_e = { value = 100.0 }\n"
        "i_d = 'i[:].real'\ni_q = 'i[:].imag'\n"
        "v_d = { from = 'psi[:].imag', scale = -100.0 }\nv_q = { from = 'psi[:].real', scale = 100.0 }\n"
    )
    recording = pm.load(tmp_path / "map.npz", machine_file)
    assert recording.kind == "operating_points"
    np.testing.assert_allclose(recording.column("v_q"), 100.0 * psi.real.reshape(-1))
    np.testing.assert_allclose(recording.column("v_d"), -100.0 * psi.imag.reshape(-1))

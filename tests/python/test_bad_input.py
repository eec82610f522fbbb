"""Nothing unusable is accepted silently: each kind is refused with the file, the place and a way out."""

from __future__ import annotations

import io
import pickle
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pmsm_rs as pm
import pyarrow as pa
import pyarrow.parquet
import pytest
import scipy.io
from conftest import MACHINE, Columns, Ran, csv_text, plausible

Run = Callable[..., Ran]


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
    """3 GB of zeros, deflated to 3 MB."""
    out = io.BytesIO()
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f8", "fortran_order": False, "shape": (384 << 20,)}
    )
    zeros = bytes(1 << 24)
    with (
        zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("t.npy", "w", force_zip64=True) as member,
    ):
        member.write(header.getvalue())
        for _ in range(192):
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


NO_NUMBER, NO_TIME, GAP = "is no number", "time", "missing"
# name -> (file name, bytes, words that the message must hold, line or row it must name or None)
BAD: dict[str, tuple[str, bytes | Callable[[], bytes], list[str], int | None]] = {
    "no current": ("r.csv", without("i_d", "i_q"), ["i_q", "missing"], None),
    "no speed": ("r.csv", without("omega_e", "theta_e"), ["omega_e", "missing"], None),
    "no time": ("r.csv", without("t"), ["time", "period"], None),
    "speed in doubt": ("r.csv", renamed(omega_e="speed [rad/s]", theta_e="x"), ["speed", "mechanical"], None),
    "angle in doubt": ("r.csv", renamed(theta_e="position [rad]"), ["position", "theta_m"], None),
    "time without unit": ("r.csv", renamed(t="time"), ["time", "unit"], None),
    "speed without unit": ("r.csv", renamed(omega_e="omega_el", theta_e="x"), ["omega_el", "unit"], None),
    "unit of another kind": ("r.csv", renamed(i_d="i_d [V]"), ["i_d", "voltage", "current"], None),
    "unknown unit": ("r.csv", renamed(i_d="i_d [furlong]"), ["furlong"], None),
    "effective phase value": (
        "r.csv",
        csv_text(
            {**plausible(), "i_a": plausible()["i_d"], "i_b": plausible()["i_d"]}, {"i_a": "i_a [A rms]"}
        ).encode(),
        ["effective"],
        None,
    ),
    "text in numbers": ("r.csv", edited(20, "i_d", "broken"), ["'broken'", NO_NUMBER, "i_d"], 20),
    "OVER in the middle": ("r.csv", edited(31, "v_q", "OVER"), ["'OVER'", NO_NUMBER, "v_q"], 31),
    "OVER in the first row": ("r.csv", edited(2, "v_q", "OVER"), ["'OVER'", NO_NUMBER], 2),
    "NaN": ("r.csv", edited(40, "i_q", "nan"), ["i_q", "not a number"], 40),
    "infinity": ("r.csv", edited(41, "i_q", "inf"), ["i_q", "infinite"], 41),
    "1e400": ("r.csv", edited(42, "i_q", "1e400"), ["i_q", "too large"], 42),
    "overflow mark": ("r.csv", edited(43, "i_q", "9.9e37"), ["i_q", "the value is 99"], 43),
    "empty cell": ("r.csv", edited(44, "i_q", ""), ["i_q", GAP], 44),
    "time running backwards": ("r.csv", time_edited(50, 0.001), ["runs back", "sort"], 52),
    "time standing still": ("r.csv", time_edited(50, 0.049), ["stands still"], 52),
    "empty file": ("r.csv", b"", ["empty"], None),
    "blank file": ("r.csv", b"\n\n  \n", ["no table"], None),
    "header only": ("r.csv", lines_of()[0].encode(), ["header", "no rows"], None),
    "no header": ("r.csv", "\n".join(lines_of()[1:]).encode(), ["no header", "column 1"], None),
    "too few samples": ("r.csv", "\n".join(lines_of()[:9]).encode(), ["8 samples", "16"], None),
    "a row too short": ("r.csv", "\n".join([*lines_of()[:60], "0.06,1"]).encode(), ["2 fields", "7"], 61),
    "cut short": ("r.csv", "\n".join(lines_of()).encode()[:-90], ["fields"], None),
    "a row too long": (
        "r.csv",
        "\n".join([*lines_of()[:60], lines_of()[60] + ",1"]).encode(),
        ["8 fields"],
        61,
    ),
    "duplicate column": ("r.csv", renamed(v_d="i_d"), ["two columns", "i_d"], None),
    "two columns for one quantity": ("r.csv", renamed(v_d="id", i_d="isd"), ["both", "i_d"], None),
    "decimal comma in commas": (
        "r.csv",
        b"t,x\n" + b"".join(f"0,{k},1,{k}\n".encode() for k in range(40)),
        ["header has 2 fields", "4"],
        1,
    ),
    "commas within quotes": (
        "r.csv",
        b"t,i_d\n" + b"".join(f'"0,{k}","1,{k}"\n'.encode() for k in range(40)),
        ["quotes", "decimals or thousands"],
        None,
    ),
    "NUL bytes": ("r.csv", edited(30, "i_d", "1.\0"), ["NUL"], 30),
    "binary as csv": ("r.csv", bytes(range(256)) * 40, ["NUL"], None),
    "control characters": ("r.csv", edited(30, "i_d", "\x07"), ["control"], 30),
    "prose": ("r.csv", b"Dear colleague,\nthe bench is broken again.\nBest regards\n", ["no table"], None),
    "parquet cut short": ("r.parquet", parquet_bytes()[:-200], ["parquet", "cut short"], None),
    "parquet with damage inside": (
        "r.parquet",
        parquet_bytes()[:400] + b"\xff" * 3000 + parquet_bytes()[3400:],
        ["parquet", "cannot be read"],
        None,
    ),
    "parquet footer that lies": (
        "r.parquet",
        parquet_bytes()[:-8] + b"\xff\xff\xff\x7fPAR1",
        ["footer"],
        None,
    ),
    "csv called parquet": ("r.parquet", csv_text(plausible()).encode(), ["parquet", "content"], None),
    "parquet with a missing value": ("r.parquet", parquet_with_gap(), ["i_q", GAP, "counting from 0"], 17),
    "parquet of text": ("r.parquet", parquet_of_text(), ["i_d", "numbers"], None),
    "parquet NaN": (
        "r.parquet",
        lambda: parquet_bytes({**plausible(), "i_d": np.where(np.arange(400) == 5, np.nan, 0.0)}),
        ["i_d", "not a number", "counting from 0"],
        5,
    ),
    "parquet bomb": ("r.parquet", parquet_bomb, ["bytes", "max_bytes"], None),
    "feather cut short": ("r.feather", b"ARROW1\0\0" + b"\xff" * 100, ["Arrow", "cannot be read"], None),
    "objects in npz": ("r.npz", pickled_objects(), ["objects"], None),
    "npz that declares too much": ("r.npz", npz_bomb(), ["bytes", "max_bytes"], None),
    "deflated npz bomb": ("r.npz", npz_deflated_bomb, ["bytes", "max_bytes"], None),
    "npz cut short": ("r.npz", npz_bytes(**plausible())[:900], ["npz", "cannot be read"], None),
    "npz of complex numbers": (
        "r.npz",
        npz_bytes(**{**plausible(), "i_d": np.ones(400, complex)}),
        ["complex"],
        None,
    ),
    "npz of text": (
        "r.npz",
        npz_bytes(**{**plausible(), "i_d": np.full(400, "x")}),
        ["i_d", "numbers"],
        None,
    ),
    "npz of unequal lengths": (
        "r.npz",
        npz_bytes(**{**plausible(), "i_d": np.ones(7)}),
        ["i_d", "7 rows"],
        None,
    ),
    "npz of matrices": (
        "r.npz",
        npz_bytes(**{**plausible(), "i_d": np.ones((400, 2))}),
        ["i_d", "[:,0]"],
        None,
    ),
    "mat cut short": ("r.mat", mat_bytes(**plausible())[:5000], [".mat", "cannot be read"], None),
    "mat without arrays": ("r.mat", mat_bytes(text="nothing"), ["no columns of numbers"], None),
    "gzip": ("r.csv.gz", b"\x1f\x8b\x08" + bytes(100), ["gzip", "unpack"], None),
    "a spreadsheet": ("r.xls", b"\xd0\xcf\x11\xe0" + bytes(100), ["spreadsheet"], None),
    "pickle": ("r.pkl", pickle.dumps(plausible()), ["NUL"], None),
    "mechanical angle called electrical": (
        "r.csv",
        mechanical_angle(),
        ["theta_e", "mechanical", "n_p"],
        None,
    ),
    "angle in degrees": (
        "r.csv",
        changed(theta_e=np.degrees(np.unwrap(plausible()["theta_e"])) / 20.0),
        ["theta_e", "times as fast"],
        None,
    ),
    "angle wrapped in degrees without a speed": (
        "r.csv",
        csv_text(
            {
                **{name: x for name, x in plausible().items() if name != "omega_e"},
                "theta_e": np.linspace(0.0, 2000.0, len(plausible()["t"])) % 360.0,
            }
        ).encode(),
        ["theta_e", "wraps at 360", "deg"],
        None,
    ),
    "angle against speed": (
        "r.csv",
        changed(theta_e=-plausible()["theta_e"]),
        ["against", "scale = -1"],
        None,
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_recordings_are_refused(case: str, tmp_path: Path, machine_file: Path, run: Run) -> None:
    name, content, words, line = BAD[case]
    path = tmp_path / name
    path.write_bytes(content() if callable(content) else content)
    before = sorted(tmp_path.iterdir())
    outputs = [
        "--json",
        tmp_path / "a.json",
        "--report",
        tmp_path / "a.html",
        "--trajectories",
        tmp_path / "a.parquet",
    ]
    ran = run("diagnose", path, "--machine", machine_file, *outputs)
    assert ran.code == 3, ran
    assert ran.out == ""
    assert ran.err.startswith(f"pmsm-rs: {path}")
    assert ran.err.count("\n") == 1
    assert "; " in ran.err, "the message must say what to do"
    for word in words:
        assert word.lower() in ran.err.lower(), ran.err
    if line is not None:
        assert f"line {line}" in ran.err or f"row {line} " in ran.err, ran.err
    assert sorted(tmp_path.iterdir()) == before, "no output may be left behind"

    with pytest.raises(pm.DataError) as caught:
        pm.load(path, machine_file)
    assert caught.value.file == str(path)  # type: ignore[attr-defined]
    assert caught.value.row == line or line is None  # type: ignore[attr-defined]
    assert caught.value.fix  # type: ignore[attr-defined]


@pytest.mark.parametrize("what", ["folder", "nothing"])
def test_what_is_no_file_is_a_usage_error(what: str, tmp_path: Path, machine_file: Path, run: Run) -> None:
    path = tmp_path if what == "folder" else tmp_path / "absent.csv"
    ran = run("identify", path, "--machine", machine_file, "--json", tmp_path / "a.json")
    assert ran.code == 2
    assert str(path) in ran.err
    assert not (tmp_path / "a.json").exists()


def test_a_missing_column_of_the_map_is_named_with_the_nearest(
    columns: Columns, tmp_path: Path, machine_file: Path
) -> None:
    (tmp_path / "r.csv").write_text(csv_text(columns, {"i_d": "current_d_filtered"}))
    machine_file.write_text(MACHINE + '\n[columns]\ni_d = "current_d_filterd"\n')
    with pytest.raises(pm.DataError, match="did you mean 'current_d_filtered'"):
        pm.load(tmp_path / "r.csv", machine_file)


def test_a_measured_load_needs_its_column(columns: Columns, tmp_path: Path, machine_file: Path) -> None:
    (tmp_path / "r.csv").write_text(csv_text(columns))
    machine_file.write_text('[machine]\nn_p = 3\n[load]\nkind = "measured"\n')
    with pytest.raises(pm.DataError, match="tau_m"):
        pm.load(tmp_path / "r.csv", machine_file)


def test_wrong_pole_pairs_show_in_angle_and_speed(columns: Columns, machine_file: Path) -> None:
    columns["omega_m"] = columns.pop("omega_e") / 4.0
    with pytest.raises(pm.DataError, match="n_p"):
        pm.load(columns, machine_file)
    columns["omega_m"] *= 4.0 / 3.0
    assert len(pm.load(columns, machine_file)) == 400


@pytest.mark.parametrize("rows", [400, 100_000])
def test_the_noise_of_a_held_rotor_does_not_contradict_its_angle(
    columns: Columns, machine_file: Path, rows: int
) -> None:
    period = columns["t"][1] - columns["t"][0]
    columns = {name: np.resize(values, rows) for name, values in columns.items()}
    columns["t"] = period * np.arange(rows)
    columns["theta_e"] = np.full(rows, 1.0)
    columns["omega_e"] = np.random.default_rng(1).normal(0.0, 5e-4 / period, rows)
    assert len(pm.load(columns, machine_file)) == rows


def in_rotor_frame(columns: Columns, factor: complex) -> Columns:
    """The phase currents at the logged angle as i_d and i_q, in a convention that differs by `factor`."""
    theta = np.linspace(0.0, 40.0, 400)
    phase = (3.0 - 2.0j) * np.exp(1j * theta)
    names = ("i_a", "i_b", "i_c")
    abc = {name: (phase * np.exp(-2j * np.pi * k / 3.0)).real for k, name in enumerate(names)}
    dq = (3.0 - 2.0j) * factor * np.ones(400)
    rest = {name: columns[name] for name in ("t", "v_d", "v_q")}
    speed = {"theta_e": theta, "omega_e": np.gradient(theta, columns["t"])}
    return {**rest, **speed, **abc, "i_d": dq.real, "i_q": dq.imag}


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (np.sqrt(1.5), "power-invariant"),
        (np.sqrt(0.5), "root mean square"),
        (-1.0, "turned by 180"),
        (1j, "turned by 90"),
    ],
)
def test_another_convention_of_d_and_q_is_refused(
    columns: Columns, machine_file: Path, factor: complex, words: str
) -> None:
    assert len(pm.load(in_rotor_frame(columns, 1.03), machine_file)) == 400
    with pytest.raises(pm.DataError, match=words):
        pm.load(in_rotor_frame(columns, factor), machine_file)


def test_a_masked_value_is_no_value(columns: Columns) -> None:
    mask = np.zeros(400, dtype=bool)
    mask[7] = True
    pm.Recording({**columns, "i_d": np.ma.array(columns["i_d"], mask=False)})
    with pytest.raises(pm.DataError, match="masked"):
        pm.Recording({**columns, "i_d": np.ma.array(columns["i_d"], mask=mask)})


def test_a_period_is_in_seconds(columns: Columns, tmp_path: Path, machine_file: Path) -> None:
    (tmp_path / "r.csv").write_text(csv_text({k: v for k, v in columns.items() if k != "t"}))
    machine_file.write_text('[machine]\nn_p = 3\n[columns]\nt = { period = 0.1, unit = "ms" }\n')
    with pytest.raises(pm.MachineError, match="period is in s"):
        pm.load(tmp_path / "r.csv", machine_file)


def test_a_machine_file_may_begin_with_a_byte_order_mark(columns: Columns, machine_file: Path) -> None:
    machine_file.write_bytes(b"\xef\xbb\xbf" + machine_file.read_bytes())
    assert len(pm.load(columns, machine_file)) == 400


def test_nothing_is_no_recording(columns: Columns) -> None:
    with pytest.raises(pm.DataError, match="no columns"):
        pm.Recording({})
    with pytest.raises(pm.DataError, match="load_value"):
        pm.Recording(columns, load="none", load_value=3.0)


def test_max_bytes_is_honoured(columns: Columns, tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text(csv_text(columns))
    np.savez_compressed(tmp_path / "r.npz", **{**columns, "x": np.zeros(100_000)})
    scipy.io.savemat(tmp_path / "r.mat", {**columns, "x": np.zeros(100_000)}, do_compression=True)
    pyarrow.parquet.write_table(pa.table({**columns, "v_d": np.zeros(400)}), tmp_path / "r.parquet")
    for name in ("r.csv", "r.npz", "r.mat", "r.parquet"):
        with pytest.raises(pm.DataError, match="max_bytes"):
            pm.load(tmp_path / name, max_bytes=9_000)


@pytest.mark.parametrize(
    "bad",
    [
        {"t": [1.0, 2.0]},
        {"speed": np.ones(20)},
        {"t": np.arange(20.0), "omega_m": np.ones((20, 2)), "tau_e": np.ones(20)},
        {"t": np.arange(20.0), "omega_m": ["a"] * 20, "tau_e": np.ones(20)},
        {"t": np.arange(20.0), "omega_m": np.ones(20, complex), "tau_e": np.ones(20)},
        {"t": np.arange(20.0), "omega_m": np.ones(19), "tau_e": np.ones(20)},
        {"t": np.arange("2020-01-01", 20, dtype="M8[D]"), "omega_m": np.ones(20), "tau_e": np.ones(20)},
    ],
)
def test_bad_arrays_are_refused(bad: Columns) -> None:
    with pytest.raises(pm.DataError):
        pm.Recording(bad)


@pytest.mark.parametrize("bad", [17, None, "absent.csv", [1.0, 2.0], np.ones(5)])
def test_what_is_no_recording_is_refused(bad: object) -> None:
    with pytest.raises(pm.PmsmError):
        pm.load(bad)

"""Arrays, column rules and conventions that contradict a recording are refused with what is wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pmsm_rs as pm
import pyarrow as pa
import pyarrow.parquet
import pytest
import scipy.io
from conftest import MACHINE, Columns, csv_text


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

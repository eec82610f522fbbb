"""Inspection: what each column of a file is, also where the file cannot be diagnosed yet."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pmsm_rs as pm
import pyarrow
import pyarrow.parquet
import pytest
from conftest import Columns, Ran, csv_text, plausible
from hypothesis import given, settings
from hypothesis import strategies as st
from inspected import signal, written
from pmsm_rs.io.reading import told

Run = Callable[..., Ran]


def test_every_column_is_shown_with_what_it_is_taken_for(columns: Columns, tmp_path: Path) -> None:
    header = {"t": "time_s", "v_d": "Vd_ref", "omega_e": "omega_el_rad_s"}
    found = pm.inspect(written({**columns, "status": columns["i_d"]}, tmp_path, header))
    assert found.is_ready
    assert found.kind == "full"
    assert [entry.column for entry in found.columns][:2] == ["time_s", "Vd_ref"]
    v_d = signal(found, "Vd_ref")
    assert (v_d.names, v_d.how, v_d.unit, v_d.rows, v_d.missing) == (("v_d",), "its name", "V", 400, 0)
    assert (v_d.low, v_d.high) == (columns["v_d"].min(), columns["v_d"].max())
    assert signal(found, "i_q").how == "canonical name"
    assert signal(found, "omega_el_rad_s").unit == "rad/s"
    unused = signal(found, "status")
    assert unused.names == ()
    assert unused.why is not None
    assert found.sampling[0].period == pytest.approx(1e-3)
    assert found.why_not == {}


def test_what_it_is_taken_for_is_what_the_loader_takes(columns: Columns, tmp_path: Path) -> None:
    header = {"t": "time_ms", "v_d": "ud_soll", "i_q": "Iq_meas [A]", "omega_e": "omega_e [rpm]"}
    file = written(columns, tmp_path, header)
    found, recording = pm.inspect(file), pm.load(file)
    taken = {name: (s.column, s.unit) for s in found.columns for name in s.names}
    assert taken == {name: (rule.source, rule.unit) for name, rule in recording.account.columns.items()}
    assert {s.column for s in found.columns if not s.names} == {*recording.account.ignored}


def test_all_that_is_unclear_is_told_at_once(columns: Columns, tmp_path: Path) -> None:
    header = {"t": "time", "theta_e": "Winkel", "omega_e": "speed", "i_q": "iq_ref", "v_d": "Vd [furlong]"}
    file = written(columns, tmp_path, header)
    found = pm.inspect(file)
    with pytest.raises(pm.DataError) as caught:
        pm.load(file)
    assert not found.is_ready
    assert [(t.problem, t.column) for t in found.tasks] == [
        (p.problem, p.column)
        for p in caught.value.problems  # type: ignore[attr-defined]
    ]
    assert signal(found, "speed").use == (
        'omega_e = { from = "speed", unit = "rad/s" }',
        'omega_m = { from = "speed", unit = "rad/s" }',
    )
    assert "5 things are to be settled" in str(found)


def test_a_file_without_any_signal_is_inspected(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text("a,b\n1,2\n3,4\n")
    found = pm.inspect(tmp_path / "r.csv")
    assert not found.is_ready
    assert found.sampling == ()
    assert [t.column for t in found.tasks] == ["t", "omega_e", "i_q"]
    assert '#NAME = { from = "a", unit = "..." }' in found.machine_file
    assert "No column was recognised" in str(found)


def test_missing_values_are_counted_with_the_line_of_the_first(columns: Columns, tmp_path: Path) -> None:
    lines = csv_text(columns).splitlines()
    for line in (5, 9, 10):
        cells = lines[line].split(",")
        cells[4] = "" if line != 9 else "nan"
        lines[line] = ",".join(cells)
    (tmp_path / "r.csv").write_text("\n".join(lines) + "\n")
    found = pm.inspect(tmp_path / "r.csv")
    assert signal(found, "i_q").missing == 3
    assert signal(found, "i_q").first_missing == "line 6"
    [task] = found.tasks
    assert task.column == "i_q"
    assert "3 values are missing, the first at line 6" in task.problem
    assert "3 missing values in 'i_q'" in str(found)


def test_missing_values_of_parquet_are_counted(columns: Columns, tmp_path: Path) -> None:
    table = {
        name: [None if k in {7, 8} and name == "v_q" else x for k, x in enumerate(values.tolist())]
        for name, values in columns.items()
    }
    pyarrow.parquet.write_table(pyarrow.table(table), tmp_path / "r.parquet")
    found = pm.inspect(tmp_path / "r.parquet")
    assert signal(found, "v_q").missing == 2
    assert signal(found, "v_q").first_missing == "row 7 (counting from 0)"
    assert not found.is_ready
    assert signal(pm.inspect(pyarrow.table(table)), "v_q").missing == 2


def test_a_value_that_is_no_number_is_told_with_its_line(columns: Columns, tmp_path: Path) -> None:
    lines = csv_text(columns).splitlines()
    lines[3] = lines[3].replace(lines[3].split(",")[3], "ERR", 1)
    (tmp_path / "r.csv").write_text("\n".join(lines) + "\n")
    found = pm.inspect(tmp_path / "r.csv")
    [task] = found.tasks
    assert (task.column, task.problem) == ("i_d", "'ERR' is no number (line 4)")
    assert signal(found, "i_q").rows == 400


def test_a_broken_row_is_one_task(columns: Columns, tmp_path: Path) -> None:
    lines = csv_text(columns).splitlines()
    lines[5] += ",1,2"
    (tmp_path / "r.csv").write_text("\n".join(lines) + "\n")
    found = pm.inspect(tmp_path / "r.csv")
    [task] = found.tasks
    assert "(line 6)" in task.problem


@pytest.mark.parametrize(("name", "content"), [("r.csv", ""), ("r.csv", "\0\1"), ("r.png", "\x89PNG")])
def test_what_holds_no_table_is_refused(name: str, content: str, tmp_path: Path, run: Run) -> None:
    (tmp_path / name).write_text(content, encoding="latin-1")
    with pytest.raises(pm.DataError):
        pm.inspect(tmp_path / name)
    ran = run("inspect", tmp_path / name)
    assert ran.code == 3
    assert ran.out == ""
    assert ran.err.count("\n") == 1


def test_a_file_that_is_not_there_is_wrong_usage(tmp_path: Path, run: Run) -> None:
    assert run("inspect", tmp_path / "absent.csv").code == 2


def test_the_kind_and_the_questions_are_those_of_the_diagnosis(columns: Columns) -> None:
    log = {name: columns[name] for name in ("t", "i_d", "i_q", "theta_e", "omega_e")}
    found = pm.inspect(log)
    assert found.kind == pm.load(log).kind == "mechanical"
    assert "voltages" in found.why_not
    assert "nothing can be asked of the voltages: the recording has none" in str(found)


def test_rows_too_far_apart_for_the_voltages_are_told_as_in_the_diagnosis(columns: Columns) -> None:
    slow = pm.Machine(n_p=3, r_s=10.0, l_d=0.01, l_q=0.02)
    found = pm.inspect(columns, slow)
    assert found.kind == "full"
    assert "rows 1 electrical time constants (l/r_s = 1 ms) apart" in found.why_not["voltages"]
    run = pm.load(columns, slow)
    asked = told(run.account, columns["t"], run.kind, run.load, machine=slow)["questions"]
    assert asked["electrical"] is json.loads(found.to_json())["questions"]["electrical"] is False
    assert found.why_not["voltages"] in asked["why_not"]
    brief = told(run.account, columns["t"], run.kind, run.load, machine=slow, spacing_told=True)["questions"]
    assert "the rows lie too far apart, and show parameters at most" in brief["why_not"]
    assert "time constants" not in brief["why_not"]
    # Each row of a drive at 1 kHz is one of its periods.
    assert not pm.inspect(columns, pm.Machine(n_p=3, r_s=10.0, l_d=0.01, f_sample=1000.0)).why_not
    unknown = pm.inspect(columns)
    assert unknown.shortest_constant == pytest.approx(2e-3)
    assert "yes, if l/r_s of the motor is above 2 ms" in str(unknown)
    assert pm.inspect(columns, pm.Machine(n_p=3, r_s=1.0, l_d=0.01)).shortest_constant == 0.0


def test_gaps_are_those_of_the_diagnosis(columns: Columns) -> None:
    torn = {name: np.delete(values, [100, 101, 102]) for name, values in columns.items()}
    assert pm.inspect(torn).sampling[0].gaps == 1
    motion = {name: torn[name] for name in ("t", "i_d", "i_q", "theta_e", "omega_e")}
    assert pm.inspect(motion).sampling[0].gaps == 0


def test_a_rotor_that_stands_is_a_finding(columns: Columns) -> None:
    still = {**columns, "theta_e": np.full(400, 1.0), "omega_e": np.zeros(400)}
    found = pm.inspect(still)
    assert any("locked" in item["fix"] for item in found.findings)
    assert 'write kind = "locked"' in found.machine_file
    assert not pm.inspect(columns).findings


NAMES = st.text(min_size=1, max_size=12) | st.sampled_from(["t", "i_q", "speed", "Vd_ref", "theta", "time"])


VALUES = st.lists(st.floats() | st.integers() | st.none() | st.text(max_size=3), max_size=6)


@settings(max_examples=150)
@given(st.dictionaries(NAMES, VALUES, max_size=6))
def test_anything_is_inspected_or_refused(table: dict[str, list[object]]) -> None:
    try:
        found = pm.inspect(table)
    except pm.PmsmError:
        return
    assert str(found)
    json.loads(found.to_json())
    tomllib.loads(found.machine_file)


def test_what_is_used_is_read_where_all_columns_take_too_much_memory(tmp_path: Path) -> None:
    columns = plausible(4000)
    log = {**columns, **{f"signal {k}": np.zeros(4000) for k in range(60)}}
    pyarrow.parquet.write_table(pyarrow.table(log), tmp_path / "r.parquet")
    found = pm.inspect(tmp_path / "r.parquet", max_bytes=600_000)
    assert found.is_ready
    assert signal(found, "i_q").rows == 4000
    assert "more than the 600000 allowed" in str(signal(found, "signal 7").why)


def test_each_column_of_text_is_told_by_itself(tmp_path: Path) -> None:
    words = {f"state{k}": np.where(np.arange(400) % 50 == 49, f"off{k}", "1") for k in range(100)}
    path = tmp_path / "r.csv"
    columns = {**plausible(), **words}
    rows = zip(*columns.values(), strict=True)
    path.write_text("\n".join([",".join(columns), *(",".join(map(str, row)) for row in rows)]) + "\n")
    told = {signal.column: signal.why for signal in pm.inspect(path).columns}
    assert [told[name] for name in words] == [
        f"'off{k}' is no number (line 51); correct the value or cut the line" for k in range(100)
    ]


def test_a_supply_beside_a_dc_link_is_not_told(columns: Columns) -> None:
    log = {**columns, "v_dc": columns["i_q"] + 40.0, "Input voltage": columns["i_q"] + 40.0}
    assert pm.load(log).account.unused == ()


def test_an_array_of_which_a_column_is_used_is_not_told_as_unused(tmp_path: Path) -> None:
    t = np.arange(400) * 1e-3
    arrays = {"t": t, "omega_m": np.sin(t), "tau_measured": np.stack([t, np.cos(t)], axis=1)}
    np.savez(tmp_path / "r.npz", **arrays)
    (tmp_path / "m.toml").write_text(
        '[machine]\nn_p = 3\n[columns]\ntau_e = "tau_measured[:,1]"\nomega_m = "omega_m"\n'
    )
    account = pm.load(tmp_path / "r.npz", tmp_path / "m.toml").account
    assert account.columns["tau_e"].source == "tau_measured[:,1]"
    assert "tau_measured" not in [entry.column for entry in account.unused]
    assert "tau_measured" not in account.ignored

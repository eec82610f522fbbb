"""Inspection: what a file is, also where it cannot be diagnosed yet, and the machine file to start from."""

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
from pmsm_rs.config.machine_file import read_machine
from pmsm_rs.inspection.text import plain, text
from pmsm_rs.io.reading import told
from pmsm_rs.io.sampling import Sampling
from pmsm_rs.io.signals import STRETCHES, Signal, course
from pmsm_rs.plot.sparkline import ASCII, sparkline
from pmsm_rs.quantities.poles import pole_pairs
from pmsm_rs.support.demo import recording_files

Run = Callable[..., Ran]


def written(columns: Columns, folder: Path, header: dict[str, str] | None = None) -> Path:
    (folder / "r.csv").write_text(csv_text(columns, header))
    return folder / "r.csv"


def signal(found: pm.Inspection, column: str) -> Signal:
    [entry] = [entry for entry in found.columns if entry.column == column]
    return entry


def opened(found: pm.Inspection, *names: str) -> str:
    """The machine file with the open lines of `names` taken."""
    lines = found.machine_file.splitlines()
    return "\n".join(line[1:] if line.startswith(tuple(f"#{n} =" for n in names)) else line for line in lines)


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


@pytest.mark.parametrize("take", [("theta_e", "theta_m"), ("omega_e", "omega_m"), ("theta_e", "omega_m")])
def test_pole_pairs_are_told_where_the_motion_shows_them(take: tuple[str, str], columns: Columns) -> None:
    theta = np.unwrap(columns["theta_e"])
    motion = {
        "theta_e": columns["theta_e"],
        "omega_e": columns["omega_e"],
        "theta_m": np.remainder(theta / 4.0, 2.0 * np.pi),
        "omega_m": columns["omega_e"] / 4.0,
    }
    log = {name: values for name, values in columns.items() if name not in motion}
    found = pm.inspect({**log, **{name: motion[name] for name in take}})
    machine = tomllib.loads(found.machine_file)["machine"]
    assert machine == {"n_p": 4}
    assert f"{take[0]} turns 4 times as fast as {take[1]}" in found.machine_file


def test_no_pole_pairs_are_made_up(columns: Columns) -> None:
    t, still = columns["t"], np.zeros(400)
    assert pole_pairs({"t": t, "theta_e": columns["theta_e"], "theta_m": still}) is None
    assert pole_pairs({"t": t, "omega_e": columns["omega_e"], "omega_m": columns["omega_e"] / 2.5}) is None
    assert pole_pairs({"t": t, "omega_e": columns["omega_e"], "omega_m": columns["i_d"]}) is None
    assert pole_pairs({"t": t, "omega_e": columns["omega_e"], "omega_m": still * np.nan}) is None
    assert pole_pairs({"t": t, "omega_e": columns["omega_e"]}) is None


@pytest.mark.parametrize(
    ("n_p", "name", "what"),
    [(4.0, "omega_m", "mechanical, with 4 pole pairs"), (1.0, "omega_e", "electrical")],
)
def test_the_motion_tells_what_a_doubtful_column_is(
    n_p: float, name: str, what: str, columns: Columns, tmp_path: Path
) -> None:
    log = {**columns, "omega_e": columns["omega_e"] / n_p}
    found = pm.inspect(written(log, tmp_path, {"omega_e": "speed [rad/s]"}))
    assert not found.is_ready
    [finding] = found.findings
    assert what in finding["consequence"]
    assert name in finding["fix"]
    content = tomllib.loads(found.machine_file)
    assert content["columns"] == {name: {"from": "speed [rad/s]", "unit": "rad/s"}}
    assert content["machine"] == ({"n_p": 4} if n_p > 1.0 else {})
    settled = found.machine_file.replace("#n_p =", "n_p = 4")
    (tmp_path / "m.toml").write_text(settled, encoding="utf-8")
    assert pm.inspect(tmp_path / "r.csv", tmp_path / "m.toml").is_ready


def test_a_mechanical_angle_tells_what_a_speed_is(columns: Columns, tmp_path: Path) -> None:
    log = {**columns, "theta_m": np.unwrap(columns["theta_e"]) / 4.0}
    del log["theta_e"]
    found = pm.inspect(written(log, tmp_path, {"omega_e": "speed [rad/s]"}))
    [finding] = found.findings
    assert "electrical, with 4 pole pairs" in finding["consequence"]
    log["omega_e"] = columns["i_d"]
    assert not pm.inspect(written(log, tmp_path, {"omega_e": "speed [rad/s]"})).findings


def test_pole_pairs_that_are_not_those_of_the_machine_file_are_a_finding(columns: Columns) -> None:
    log = {**columns, "theta_m": np.unwrap(columns["theta_e"]) / 4.0}
    found = pm.inspect(log, pm.Machine(n_p=3))
    assert any("n_p = 3" in item["finding"] for item in found.findings)
    assert not any("n_p" in item["finding"] for item in pm.inspect(log, pm.Machine(n_p=4)).findings)


def test_the_machine_file_says_what_the_recording_tells(columns: Columns, tmp_path: Path) -> None:
    log = {**columns, "v_dc": np.full(400, 48.0), "tau_m": columns["i_q"]}
    found = pm.inspect(written(log, tmp_path))
    content = tomllib.loads(found.machine_file)
    assert content["drive"] == {"v_dc": 48.0}
    assert content["load"] == {"kind": "measured"}
    assert "#f_sample = 1000" in found.machine_file
    assert "the recording reaches 3 A" in found.machine_file
    for name, unit in (("r_s", "ohm"), ("l_d", "H"), ("psi_m", "V s"), ("j", "kg m^2"), ("b", "N m s")):
        [line] = [line for line in found.machine_file.splitlines() if line.startswith(f"#{name} =")]
        assert unit in line


def test_a_slow_log_offers_no_rate_of_the_control(columns: Columns) -> None:
    slow = {**columns, "t": columns["t"] * 20.0}
    assert "#f_sample =         # Hz, rate of the control; this log is slower, at 50 Hz" in (
        pm.inspect(slow).machine_file
    )
    motion = {name: columns[name] for name in ("t", "i_d", "i_q", "theta_e", "omega_e")}
    assert "#f_sample =    " in pm.inspect(motion).machine_file


def test_only_columns_that_may_add_something_are_offered(columns: Columns, tmp_path: Path) -> None:
    header = {"omega_e": "speed", "theta_e": "angle", "i_q": "Test motor q-axis current"}
    log = {
        **columns,
        "Reference Velocity": np.linspace(0.0, 1.0, 400),
        "Absorber q-axis current": columns["i_d"],
        "N": np.full(400, 2500.0),
    }
    text = pm.inspect(written(log, tmp_path, header)).machine_file
    assert '#omega_m = { from = "speed"' in text
    assert "check the unit, which the file does not state" in text
    assert "Take one line of each name at most." in text
    assert "Reference Velocity" not in text
    assert '"N"' not in text
    del log["omega_e"], log["theta_e"]
    assert (
        '#omega_e = { from = "Reference Velocity"' in pm.inspect(written(log, tmp_path, header)).machine_file
    )
    # What was given leaves nothing to take.
    settled = 'i_q = "Test motor q-axis current"\nomega_m = { from = "speed", unit = "rad/s" }\n'
    (tmp_path / "m.toml").write_text(f"[machine]\nn_p = 3\n[columns]\n{settled}")
    log |= {"omega_e": columns["omega_e"]}
    text = pm.inspect(written(log, tmp_path, header), tmp_path / "m.toml").machine_file
    assert "Absorber" not in text


def test_the_columns_of_an_array_are_offered(columns: Columns) -> None:
    found = pm.inspect({"data": np.stack([*columns.values()], axis=1)})
    assert '#NAME = { from = "data[:,0]", unit = "..." }' in found.machine_file


def test_the_lines_that_settle_a_file_make_it_readable(columns: Columns, tmp_path: Path) -> None:
    header = {"omega_e": "speed [rad/s]", "theta_e": "Theta [rad]"}
    file = written(columns, tmp_path, header)
    found = pm.inspect(file)
    assert not found.is_ready
    settled = opened(found, "omega_e", "theta_e").replace("#n_p =", "n_p = 3")
    (tmp_path / "m.toml").write_text(settled, encoding="utf-8")
    assert read_machine(tmp_path / "m.toml").machine.n_p == 3
    again = pm.inspect(file, tmp_path / "m.toml")
    assert again.is_ready
    assert signal(again, "speed [rad/s]").how == "[columns]"


def test_a_machine_file_that_was_given_is_kept(columns: Columns, tmp_path: Path) -> None:
    log = {**columns, "x": columns["i_q"]}
    del log["i_q"]
    rules = (
        '[machine]\nn_p = 3\nr_s = 0.9\n[load]\nkind = "known_constant"\nvalue = 0.5\n'
        '[columns]\ni_q = { from = "x", unit = "A", scale = -1.0 }\ni_d = { value = 0.0 }\ntheta_e = false\n'
    )
    (tmp_path / "m.toml").write_text(rules)
    found = pm.inspect(written(log, tmp_path), tmp_path / "m.toml")
    (tmp_path / "again.toml").write_text(found.machine_file, encoding="utf-8")
    first, again = read_machine(tmp_path / "m.toml"), read_machine(tmp_path / "again.toml")
    assert again.machine == first.machine
    assert (again.load, again.load_value) == (first.load, first.load_value)
    assert again.columns == first.columns
    assert found.made == {"i_d": "the constant 0"}
    assert signal(found, "x").high == -columns["i_q"].min()


def test_the_next_command_can_be_copied_however_long_a_path_is(
    columns: Columns, tmp_path: Path, run: Run
) -> None:
    folder = tmp_path / ("long " * 40).strip()
    folder.mkdir()
    file = written(columns, folder)
    ran = run("inspect", file)
    assert ran.code == 0, ran.err
    assert f"inspect '{file}' --write machine.toml" in ran.out


def test_write_makes_the_file_and_never_replaces_one(columns: Columns, tmp_path: Path, run: Run) -> None:
    file, out = written(columns, tmp_path), tmp_path / "machine.toml"
    ran = run("inspect", file, "--write", out)
    assert ran.code == 0, ran.err
    assert out.read_text(encoding="utf-8") == pm.inspect(file).machine_file
    assert f"diagnose {file} --machine {out}" in ran.out
    out.write_text("mine")
    ran = run("inspect", file, "--write", out)
    assert ran.code == 2
    assert "--force" in ran.err
    assert ran.out == ""
    assert out.read_text() == "mine"
    assert run("inspect", file, "--write", out, "--force").code == 0
    assert out.read_text(encoding="utf-8") == pm.inspect(file).machine_file
    with pytest.raises(pm.UsageError, match="such a file already"):
        pm.inspect(file).write_machine(out)
    pm.inspect(file).write_machine(out, force=True)
    assert run("inspect", file, "--write", file, "--force").code == 2


def test_json_holds_all_of_it(columns: Columns, tmp_path: Path, run: Run) -> None:
    log = {**columns, "gaps": np.where(columns["t"] < 0.3, np.nan, 1.0)}
    file, out = written(log, tmp_path), tmp_path / "a.json"
    assert run("inspect", file, "--json", out).code == 0
    answer = json.loads(out.read_text())
    assert answer["schema"] == "pmsm-rs.inspection/1"
    assert answer["ready"] is True
    assert answer["questions"] == {"electrical": True, "mechanical": True, "why_not": {}}
    assert {entry["column"] for entry in answer["columns"]} == {*log}
    assert answer["columns"][-1]["course"][0] is None
    assert answer["sampling"][0]["rate"] == pytest.approx(1e3)
    assert answer["machine_file"] == pm.inspect(file).machine_file


def test_the_demo_recording_can_be_diagnosed_with_what_is_written(tmp_path: Path, run: Run) -> None:
    recording, _, machine = recording_files()
    ran = run("inspect", recording, "--machine", machine)
    assert ran.code == 0
    assert "A waveform with voltages, currents and motion." in ran.out
    assert "n_p = 4" in ran.out
    assert f"pmsm-rs diagnose {recording} --machine {machine}" in ran.out


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


def test_gaps_and_jitter_of_the_clock_are_told() -> None:
    even = np.arange(1000) * 1e-4
    assert Sampling.of(even).sentence() == "1000 rows, one every 0.1 ms (10 kHz), 99.9 ms in all, no gaps"
    torn = np.where(even > 0.05, even + 1.0, even)
    assert "1 gap of 1 s at t = 0.05 s" in Sampling.of(torn).sentence()
    assert Sampling.of(torn).gaps == 1
    assert "time does not go forward at 1 row" in Sampling.of(np.array([0.0, 1.0, 2.0, 1.5])).sentence()
    assert "steps of" in Sampling.of(np.array([0.0, 1.0, 2.2, 3.2, 4.2])).sentence()
    assert "without a sample rate" in Sampling.of(np.zeros(1)).sentence()


def test_sparklines() -> None:
    assert sparkline([0.0, 3.5, 7.0], 0.0, 7.0) == "▁▅█"
    assert sparkline([0.0, float("nan"), 7.0], 0.0, 7.0, ASCII) == "_ #"
    assert sparkline([1.0, 1.0], 1.0, 1.0) == "constant"
    assert sparkline([], None, None) == ""
    assert sparkline([-1.7e308, 1.7e308], -1.7e308, 1.7e308) == "▁█"
    assert course(np.arange(1000.0))[-1] == 999.0
    assert len(course(np.arange(1000.0))) == STRETCHES
    assert len(course(np.arange(3.0))) == 3


def test_a_terminal_without_other_signs_gets_ascii(
    columns: Columns, tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = written({**columns, "ω/β": columns["i_q"]}, tmp_path)
    found = pm.inspect(file)
    assert text(found, blocks=False).isascii()
    assert plain("Ω·°ш") == "ohm.deg\\u0448"
    monkeypatch.setattr("pmsm_rs.cli.inspecting._shows_blocks", lambda: False)
    assert run("inspect", file).out.isascii()


def test_names_cannot_steer_the_terminal(columns: Columns, tmp_path: Path, run: Run) -> None:
    evil = "a\x1b[31mb\u202e"
    found = pm.inspect({**columns, evil: columns["i_q"], f"omega_{evil}": columns["i_q"]})
    shown = str(found) + found.machine_file
    assert "\x1b" not in shown
    assert "\u202e" not in shown
    tomllib.loads(found.machine_file)


def test_many_columns_are_cut_short_in_text_and_whole_in_json(columns: Columns) -> None:
    log = {**columns, **{f"signal {k}": columns["i_q"] for k in range(300)}}
    found = pm.inspect(log)
    assert len(found.columns) == 307
    assert "and 260 more" in str(found)
    assert len(str(found).splitlines()) < 120
    assert len(json.loads(found.to_json())["columns"]) == 307


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


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("Output Torque", 'tau_m = { from = "Output Torque", unit = "N·m" }'),
        ("Input voltage", 'v_dc = { from = "Input voltage", unit = "V" }'),
        ("battery_voltage", 'v_dc = { from = "battery_voltage", unit = "V" }'),
    ],
)
def test_a_signal_of_the_bench_gets_a_line_and_is_not_taken(
    name: str, line: str, columns: Columns, tmp_path: Path
) -> None:
    found = pm.inspect(written({**columns, name: columns["i_q"] + 40.0}, tmp_path))
    entry = signal(found, name)
    assert (entry.names, entry.use) == ((), (line,))
    assert f"#{line}" in found.machine_file


@pytest.mark.parametrize(
    "name", ["Input voltage ref", "Input voltage ripple", "Input voltage d", "mains voltage"]
)
def test_another_voltage_of_the_supply_gets_no_line(name: str, columns: Columns, tmp_path: Path) -> None:
    assert signal(pm.inspect(written({**columns, name: columns["i_q"]}, tmp_path)), name).use == ()


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

"""Inspection writes the machine file to start from, with open lines for what is in doubt."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pmsm_rs as pm
import pytest
from conftest import Columns, Ran
from inspected import opened, signal, written
from pmsm_rs.config.machine_file import read_machine
from pmsm_rs.quantities.poles import pole_pairs

Run = Callable[..., Ran]


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

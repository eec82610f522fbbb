"""The simulated drive: configuration, what is written, and what is refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pmsm_rs as pm
import pytest
from conftest import Ran

Run = Callable[..., Ran]

CONFIG = """
duration = 0.1
settle = 0.05
seed = 3

[drive]
f_sample = 10000

[sensors]
noise_i = 0.05
noise_tau = 0.01

[reference]
n = { t = [0, 0.05], value = [300, 600] }

[load]
tau = { t = [0, 0.06], value = [3, 5], shape = "steps" }
kind = "measured"

[effects.dead_time]
v_err = 2.0
"""


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "drive.toml"
    path.write_text(CONFIG)
    return path


def test_default_machine_is_table_1() -> None:
    machine = pm.simulate(duration=0.01, reference={"i_d": 1.0}, load={"kind": "locked"}).machine
    assert (machine.n_p, machine.r_s, machine.l_d, machine.l_q) == (4, 0.17, 1.9e-3, 1.9e-3)
    assert (machine.j, machine.b, machine.v_dc, machine.f_sample) == (0.008, 0.00115, 560.0, 100e3)
    # The torque and the voltage constant of the table, the latter as the peak from line to line.
    assert machine.psi_m is not None
    assert 1.5 * 4 * machine.psi_m * np.sqrt(2) == pytest.approx(1.629, rel=1e-12)
    assert np.sqrt(3) * 4 * machine.psi_m == pytest.approx(1.33, rel=1e-3)


def test_file_mapping_and_keywords_say_the_same(config: Path) -> None:
    import tomllib

    tables = tomllib.loads(CONFIG)
    runs = [pm.simulate(config), pm.simulate(tables), pm.simulate(**tables)]
    runs.append(pm.simulate(config, seed=4))
    logs = [run.recording.column("i_a") for run in runs]
    assert np.array_equal(logs[0], logs[1])
    assert np.array_equal(logs[0], logs[2])
    assert not np.array_equal(logs[0], logs[3])


def test_truth_and_recording_agree(config: Path) -> None:
    run = pm.simulate(config)
    rec, truth = run.recording, run.truth
    assert len(rec) == 1000
    assert rec.load == "measured"
    assert set(rec.names) == {"t", "v_d", "v_q", "i_a", "i_b", "i_c", "theta_e", "omega_e", "tau_m"}
    assert rec.column("t")[0] == 0.0
    assert truth.effects["dead_time"]["v_err"] == 2.0
    assert truth.base["r_s"] == 0.17
    np.testing.assert_allclose(rec.column("omega_e"), 4 * truth.traces["omega_m"], rtol=1e-12)
    assert np.std(rec.column("tau_m") - truth.traces["tau_load"]) == pytest.approx(0.01, rel=0.2)
    assert truth.traces["tau_load"][0] == 3.0
    assert truth.traces["tau_load"][-1] == 5.0
    theta = rec.column("theta_e")
    phases = [rec.column(f"i_{x}") * np.cos(theta - k * 2 * np.pi / 3) for k, x in enumerate("abc")]
    i_d = 2 / 3 * np.sum(phases, axis=0)
    assert np.std(i_d - truth.traces["i_d"]) == pytest.approx(0.05 * np.sqrt(2 / 3), rel=0.15)


def test_command_writes_what_it_says(config: Path, run: Run, tmp_path: Path) -> None:
    out, machine = tmp_path / "r.parquet", tmp_path / "m.toml"
    ran = run("simulate", str(config), "-o", str(out), "--truth", "--machine-file", str(machine))
    assert (ran.code, ran.err) == (0, "")
    assert ran.out == f"{out}: 1000 samples, 0.0999 s\n"
    made = pm.simulate(config)
    rec = pm.load(out, machine)
    assert rec.load == "measured"
    for name in made.recording.names:
        assert np.array_equal(rec.column(name), made.recording.column(name)), name
    text = json.loads((tmp_path / "r.truth.json").read_text())
    assert text["base"] == made.truth.base
    assert text["effects"] == made.truth.effects
    assert text["seed"] == 3
    assert (tmp_path / "r.truth.parquet").stat().st_size > 1000
    csv = tmp_path / "r.csv"
    assert run("simulate", str(config), "-o", str(csv)).code == 0
    np.testing.assert_allclose(pm.load(csv, machine).column("i_a"), rec.column("i_a"), rtol=1e-12)


def test_machine_of_a_file_is_found_beside_the_configuration(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(
        "[machine]\nr_s=1.0\nl_d=0.01\nl_q=0.01\npsi_m=0.1\nn_p=2\nj=0.001\nb=0.0\n[drive]\nv_dc=100\ni_rated=5\n"
    )
    path = tmp_path / "c.toml"
    path.write_text(
        'duration = 0.01\nmachine = "mine.toml"\n[reference]\nomega_m = 5\n[nameplate]\nr_s = 1.2\n'
    )
    made = pm.simulate(path)
    assert (made.truth.base["r_s"], made.machine.r_s, made.machine.n_p) == (1.0, 1.2, 2)
    own = pm.simulate(path, machine=pm.Machine(n_p=3, r_s=1, l_d=0.01, l_q=0.01, psi_m=0.1, j=1e-3, b=0,
                                               v_dc=100, i_rated=5))  # fmt: skip
    assert own.machine.n_p == 3


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"durtion": 1}, "durtion: unknown key (did you mean 'duration'?)"),
        ({"drive": {"f_samples": 1}}, "drive.f_samples: unknown key (did you mean 'f_sample'?)"),
        ({"drive": {"inverter": "switchin"}}, "'switchin' is not known (did you mean 'switching'?)"),
        ({"drive": {"delay": 2}}, "delay is 2"),
        ({"drive": {"f_sw": 1e4}}, "drive.f_sw: only a switching inverter has one"),
        ({"drive": {"inverter": "switching", "f_sw": 3e3}}, "f_sw is 3000 Hz"),
        ({"effects": {"dead_tim": {}}}, "there is no such effect (did you mean 'dead_time'?)"),
        ({"effects": {"dead_time": {"v_er": 1}}}, "dead_time.v_er: unknown key (did you mean 'v_err'?)"),
        ({"effects": {"dead_time": {"v_err": -1}}}, "dead_time.v_err is -1 V"),
        ({"machine": "liu_2009"}, "there is no machine 'liu_2009'; did you mean 'liu_2008'?"),
        ({"machine": {"r_s": 1.0}}, "machine.n_p: is missing"),
        ({"reference": {}}, "reference: say what the drive is to do"),
        ({"reference": {"omega_m": {"t": [1, 0], "value": [1, 2]}}}, "omega_m: the times must increase"),
        ({"reference": {"omega_m": {"t": [0], "values": [1]}}}, "reference.omega_m: unknown key 'values'"),
        ({"load": {"kind": "heavy"}}, "load.kind: 'heavy' is not known"),
        ({"load": {"kind": "none", "tau": 1.0}}, "the load is said to be none"),
        ({"drift": {"j": -1.0}}, "j is -1 kg m^2"),
        ({"sensors": {"speed": "encoder"}}, "sensors.encoder_bandwidth: goes with speed = 'encoder'"),
        ({"duration": 1e9}, "duration is 1000000000 s"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(wrong: dict[str, object], words: str) -> None:
    with pytest.raises(pm.UsageError) as refused:
        pm.simulate({"duration": 0.01, "reference": {"omega_m": 10.0}, **wrong})
    assert words in str(refused.value)


def test_wrong_files_are_usage_errors(run: Run, tmp_path: Path) -> None:
    assert run("simulate", "absent.toml", "-o", "r.parquet").code == 2
    path = tmp_path / "c.toml"
    path.write_text("[[")
    ran = run("simulate", str(path), "-o", str(tmp_path / "r.parquet"))
    assert ran.code == 2
    assert "no valid TOML" in ran.err
    path.write_text(CONFIG)
    assert run("simulate", str(path), "-o", str(tmp_path / "r.xlsx")).code == 2
    assert list(tmp_path.iterdir()) == [path]


def test_paper_s_parameters_are_found_in_a_simulated_run() -> None:
    made = pm.simulate(
        duration=0.2,
        drive={"f_sample": 1e4},
        sensors={"noise_i": 0.05, "noise_omega_e": 0.1},
        reference={"omega_m": {"t": [0, 0.15], "value": [0, 80]}},
        load={"tau": 3.0},
    )
    fit = pm.identify(made.recording, made.machine, fit=["r_s", "tau_load"], method="lm")
    assert fit.parameters["r_s"].value == pytest.approx(0.17, rel=0.01)
    assert fit.parameters["tau_load"].value == pytest.approx(3.0, rel=0.005)

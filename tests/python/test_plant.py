"""The independent plant: it is the plain machine when nothing is switched on, keeps its energy, and hides
nothing."""

from __future__ import annotations

import json
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pmsm_rs as pm
import pytest
from concealed import diagnose, diagnosed

pytest.importorskip("numba")
pq = pytest.importorskip("pyarrow.parquet")
integrate = pytest.importorskip("scipy.integrate")

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from proof import bench, make_demo  # noqa: E402
from proof.case import account, clean_channels, make_case, nameplate_of, noise_of  # noqa: E402
from proof.effects import CATALOGUE, EQUATION  # noqa: E402
from proof.generate import SOLVABLE  # noqa: E402
from proof.machines import HUB, PUMP, SERVO, SPINDLE, TRACTION  # noqa: E402
from proof.manoeuvres import make  # noqa: E402
from proof.oracle import oracle  # noqa: E402
from proof.plant import simulate  # noqa: E402

# one noticeable strength per effect, for the servo
STRENGTH: dict[str, dict[str, float]] = {
    "coulomb_friction": {"tau_c": 0.2},
    "stribeck_friction": {"tau_c": 0.15, "tau_s": 0.3, "w_s": 8.0},
    "asymmetric_friction": {"tau_c_pos": 0.3, "tau_c_neg": 0.15, "b_pos": 2e-4},
    "load_dependent_friction": {"mu": 0.03},
    "quadratic_drag": {"k": 1.5e-5},
    "cogging_torque": {"tau_cog": 0.2, "second_rel": 0.2},
    "cogging_asymmetry": {"tau_slots": 0.15, "tau_poles": 0.1},
    "load_torque_pulsation": {"tau_pul": 0.4},
    "gravity_torque": {"tau_g": 0.4},
    "time_varying_load": {"amplitude": 0.8, "f": 3.0},
    "two_mass_shaft": {"f_antires": 45.0, "f_res": 80.0},
    "back_emf_harmonics": {"e5_rel": 0.03, "e7_rel": 0.02},
    "saturation_d": {"drop_at_rated": 0.3},
    "saturation_q": {"drop_at_rated": 0.2},
    "cross_saturation": {"psi_drop_at_rated": 0.05},
    "inductance_harmonics": {"rel_6": 0.03, "rel_4": 0.03},
    "rs_thermal_drift": {"rise_at_rated": 1.0, "tau": 1.0},
    "magnet_thermal_drift": {"psi_drop_final": 0.1, "tau": 1.0},
    "iron_loss": {"r_c": 600.0},
    "dead_time": {"v_err": 1.0},
    "voltage_delay": {"extra_samples": 0.3},
    "dc_link_sag": {"r_source": 3.0},
    "phase_resistance_imbalance": {"r_excess_rel": 0.1},
    "inter_turn_short": {"share": 0.03, "r_fault": 0.05},
    "current_offset": {"o_a": 0.08, "o_b": -0.03},
    "current_gain_imbalance": {"g_a": 0.03},
    "encoder_angle_offset": {"offset_el_rad": 0.03},
    "encoder_eccentricity": {"amplitude_el_rad": 0.01},
    "encoder_delay": {"t_delay": 2e-5},
    "encoder_harmonics": {"amplitude_1_el_rad": 0.01, "amplitude_2_el_rad": 0.006, "phase_2": 1.0},
    "x_tight_spot": {"tau": 0.5},
    "x_friction_hump": {"tau": 0.5},
    "x_weak_leg": {"loss_rel": 0.02},
    "x_loose_terminal": {"r_extra": 0.3},
    "x_eddy_brake": {"k": 0.02},
    "x_root_friction": {"k": 0.03},
    "x_dahl_presliding": {"tau_c": 0.3},
    "x_backlash": {"gap": 0.05},
    "x_cam_load": {"tau": 0.5},
    "x_angle_friction": {"tau": 0.2},
    "x_gear_mesh": {"mu": 0.3},
    "x_sleeve_current": {"l_rel": 1.0},
    "x_rectifier_ripple": {"ripple_rel": 0.03},
    "x_flux_hysteresis": {"i_rel": 0.03},
    "x_current_lag": {"lag": 3e-5},
    "x_converter_skew": {"skew": 3e-5},
    "x_sensor_bow": {"loss_at_rated": 0.05},
    "x_late_angle": {"t_rated": 2e-5},
    "x_disc_flaw": {"amplitude_el_rad": 0.03},
}
# parameters that shape an effect without giving it strength
SHAPE = {
    "coulomb_friction": {"tau_c": 0.0, "w_smooth": 0.4},
    "stribeck_friction": {"tau_c": 0.0, "tau_s": 0.0, "w_s": 3.0},
    "cogging_torque": {"tau_cog": 0.0, "order_mech": 12.0, "phase": 1.0, "second_rel": 0.5},
    "load_torque_pulsation": {"tau_pul": 0.0, "per_rev": 2.0, "phase": 1.0},
    "time_varying_load": {"amplitude": 0.0, "f": 9.0},
    "two_mass_shaft": {"f_antires": 0.0, "f_res": 70.0},
    "back_emf_harmonics": {"e5_rel": 0.0, "phase5": 2.0},
    "rs_thermal_drift": {"rise_at_rated": 0.0, "tau": 0.3},
    "magnet_thermal_drift": {"psi_drop_final": 0.0, "tau": 0.3, "speed_share": 0.5},
    "iron_loss": {"r_c": 0.0, "leakage_share": 0.3},
    "dead_time": {"v_err": 0.0, "i_th": 0.5},
    "dc_link_sag": {"r_source": 0.0, "c_dc": 5e-3},
    "inter_turn_short": {"share": 0.0, "r_fault": 0.2},
    "x_friction_hump": {"tau": 0.0, "w_hump": 30.0, "width": 5.0},
    "x_eddy_brake": {"k": 0.0, "w_critical": 20.0},
    "x_dahl_presliding": {"tau_c": 0.0, "theta_0": 0.1},
    "x_backlash": {"gap": 0.0, "load_share": 0.2},
    "x_sleeve_current": {"l_rel": 0.0, "tau_rel": 3.0},
    "x_rectifier_ripple": {"ripple_rel": 0.0, "f": 100.0},
    "x_flux_hysteresis": {"i_rel": 0.0, "flux_rel": 0.1},
}


def dq_residual(machine, log, t_s):
    """Measured minus simulated i_d, i_q (n, 2) of the plain dq machine, its flux form integrated by DOP853.

    With voltage held and speed linear within an interval the equations are linear in the flux, so the
    transition of every interval is integrated at once and the intervals are chained afterwards.
    """
    w0, w1 = log["omega_e"][:-1], log["omega_e"][1:]
    v = np.stack([log["v_d"][:-1], log["v_q"][:-1]])
    a, b = machine.r_s / machine.l_d, machine.r_s / machine.l_q

    def slope(s, x):
        # rows: two columns of the transition matrix, then the forced response, each as flux d, flux q
        d, q = x.reshape(3, 2, -1)[:, 0], x.reshape(3, 2, -1)[:, 1]
        w = w0 + s * (w1 - w0)
        out = np.stack([-a * d + w * q, -b * q - w * d], axis=1)
        out[2, 0] += v[0] + a * machine.psi_m
        out[2, 1] += v[1]
        return t_s * out.ravel()

    x = np.zeros((3, 2, len(w0)))
    x[0, 0] = x[1, 1] = 1.0
    done = integrate.solve_ivp(slope, (0.0, 1.0), x.ravel(), method="DOP853", rtol=1e-10, atol=1e-13)
    col_d, col_q, forced = done.y[:, -1].reshape(3, 2, -1).transpose(0, 2, 1)
    flux = np.empty((len(w0) + 1, 2))
    flux[0] = machine.psi_m, 0.0
    for k in range(len(w0)):
        flux[k + 1] = col_d[k] * flux[k, 0] + col_q[k] * flux[k, 1] + forced[k]
    model = np.stack([(flux[:, 0] - machine.psi_m) / machine.l_d, flux[:, 1] / machine.l_q], axis=1)
    return np.stack(park(log["i_a"], log["i_b"], log["i_c"], log["theta_e"]), axis=1) - model


def park(a, b, c, theta):
    """Amplitude-invariant Park transform, written out by its definition."""
    angles = theta[None] - np.array([0.0, 1.0, 2.0])[:, None] * 2.0 * np.pi / 3.0
    phases = np.stack([a, b, c])
    return 2.0 / 3.0 * (phases * np.cos(angles)).sum(0), -2.0 / 3.0 * (phases * np.sin(angles)).sum(0)


def rms(x):
    return float(np.sqrt(np.mean(np.square(x))))


@pytest.mark.parametrize("machine", [SERVO, HUB, PUMP], ids=lambda m: m.name)
def test_nothing_switched_on_is_the_plain_dq_machine(machine):
    run = simulate(machine, {}, make(machine, "rich", "none", duration=1.0, seed=4), seed=8)
    rest = dq_residual(machine, run.log, 1.0 / machine.f_sample)
    clean, theta = clean_channels(run), run.log["theta_e"]
    noise = park(*(run.log[k] - clean[k] for k in ("i_a", "i_b", "i_c")), theta)
    # power invariance leaves two thirds of a phase sensor's variance; the ADC step adds its own
    expected = np.sqrt(2.0 / 3.0 * (machine.noise_i**2 + machine.lsb_i**2 / 12.0))
    for axis in (0, 1):
        assert rms(noise[axis]) == pytest.approx(expected, rel=0.02)
        assert rms(rest[:, axis]) == pytest.approx(rms(noise[axis]), rel=0.02)


def test_without_noise_the_plain_dq_machine_agrees_to_a_millionth():
    run = simulate(SERVO, {}, make(SERVO, "rich", "none", duration=0.5, seed=4), seed=8, noise=False)
    # what is left is the curvature of the speed within an interval
    assert np.abs(dq_residual(SERVO, run.log, 1.0 / SERVO.f_sample)).max() < 1e-5 * SERVO.i_rated


def test_torque_and_speed_obey_the_mechanical_equation():
    run = simulate(SERVO, {}, make(SERVO, "rich", "none", duration=1.0, seed=4), seed=8, noise=False)
    w, tau = run.truth["omega_m"], run.truth["tau_e"]
    i_d, i_q = park(*(run.truth[k] for k in ("i_a", "i_b", "i_c")), SERVO.n_p * run.truth["theta_m"])
    textbook = 1.5 * SERVO.n_p * (SERVO.psi_m * i_q + (SERVO.l_d - SERVO.l_q) * i_d * i_q)
    assert np.abs(tau - textbook).max() < 1e-9 * SERVO.tau_rated
    push = np.concatenate([[0.0], np.cumsum(0.5 * (tau[1:] + tau[:-1]) - SERVO.b * 0.5 * (w[1:] + w[:-1]))])
    assert np.abs(w - w[0] - push / SERVO.j / SERVO.f_sample).max() < 1e-3 * SERVO.w_rated


@pytest.mark.parametrize("effect", [None, *(e for e in CATALOGUE if e != "magnet_thermal_drift")])
def test_power_balances(effect):
    """Energy taken in = lost in resistances + given to the shaft + gained by the field (a fading magnet
    excepted)."""
    effects = {} if effect is None else {effect: STRENGTH[effect]}
    run = simulate(SERVO, effects, make(SERVO, "rich", "none", duration=0.3, seed=2), seed=8)
    t = run.truth
    gap = t["e_in"] - t["e_lost"] - t["e_shaft"] - (t["e_field"] - t["e_field"][0])
    assert np.abs(gap).max() < 1e-7 * np.abs(t["e_in"]).max()


@pytest.mark.parametrize("effect", CATALOGUE)
def test_strength_zero_is_off_bit_for_bit(effect):
    manoeuvre = make(SERVO, "rich", "unknown_piecewise", duration=0.2, seed=2)
    off = simulate(SERVO, {}, manoeuvre, seed=8)
    zero = simulate(SERVO, {effect: SHAPE.get(effect, {})}, manoeuvre, seed=8)
    assert off.log.keys() == zero.log.keys()
    for name, column in off.log.items():
        assert np.array_equal(column, zero.log[name]), name


@pytest.mark.parametrize("effect", CATALOGUE)
def test_every_effect_shows_in_the_equation_it_belongs_to(effect):
    manoeuvre = make(SERVO, "rich", "none", duration=1.0, seed=3)
    effects = {effect: STRENGTH[effect]}
    plain = account(SERVO, effects, manoeuvre, simulate(SERVO, effects, manoeuvre, seed=8))["plain_refit"]
    if EQUATION[effect][0] == "mechanical":
        assert plain["omega_e"] > 1.5
        assert max(plain["i_d"], plain["i_q"]) < 1.02
    else:
        assert max(plain["i_d"], plain["i_q"]) > 1.1


@pytest.mark.parametrize("effect", [e for e in CATALOGUE if e != "x_backlash"])
def test_the_true_equations_come_back_to_the_noise(effect):
    """So a case can be solved; impacts in a play are too sensitive for that."""
    manoeuvre = make(SERVO, "rich", "unknown_piecewise", duration=0.25, seed=3)
    effects = {effect: STRENGTH[effect]}
    run = simulate(SERVO, effects, manoeuvre, seed=8)
    noise = noise_of(run)[1]
    assert all(v < SOLVABLE * noise[k] for k, v in oracle(SERVO, effects, manoeuvre, run).items())


def test_wrong_equations_do_not_come_back_to_the_noise():
    manoeuvre = make(SERVO, "rich", "none", duration=0.25, seed=3)
    run = simulate(SERVO, {"dead_time": {"v_err": 1.0}}, manoeuvre, seed=8)
    assert oracle(SERVO, {}, manoeuvre, run)["i_q"] > 3.0 * noise_of(run)[1]["i_q"]


def test_the_noise_does_not_depend_on_what_is_switched_on():
    manoeuvre = make(SERVO, "locked", "locked", duration=0.2, seed=3)
    fine = replace(SERVO, lsb_i=0.0)
    noises = []
    for effects in ({}, {"current_offset": STRENGTH["current_offset"]}):
        run = simulate(fine, effects, manoeuvre, seed=8)
        noises.append(run.log["i_a"] - clean_channels(run)["i_a"])
    assert np.allclose(*noises, atol=1e-12)


def test_a_machine_whose_flux_no_current_makes_is_refused():
    effects = {"cross_saturation": {"psi_drop_at_rated": 1.0}}
    with pytest.raises(RuntimeError, match="runs away at sample"):
        simulate(SPINDLE, effects, make(SPINDLE, "rich", "none", duration=0.5, seed=2), seed=1)


def test_unknown_names_are_refused():
    manoeuvre = make(SERVO, "rich", "none", duration=0.1)
    with pytest.raises(KeyError):
        simulate(SERVO, {"gremlins": {}}, manoeuvre, seed=1)
    with pytest.raises(KeyError, match="v_error"):
        simulate(SERVO, {"dead_time": {"v_error": 1.0}}, manoeuvre, seed=1)
    with pytest.raises(ValueError, match="locked"):
        make(SERVO, "rich", "locked")


@pytest.mark.parametrize(
    ("stator_hold", "log_command", "said"),
    [(False, False, []), (True, False, ["its mean"]), (True, True, ["the vector"])],
)
def test_an_inverter_that_holds_its_voltage_in_the_stator_is_no_mismatch(
    tmp_path, stator_hold, log_command, said
):
    """At 0.13 rad per period the mean current between two samples is an ampere off, and so the torque."""
    truth = make_case(
        tmp_path / "open",
        TRACTION,
        {},
        "fast",
        "none",
        3,
        truth_folder=tmp_path / "sealed",
        stator_hold=stator_hold,
        log_command=log_command,
    )
    off = truth["runs"]["recording"]["plain_refit"]["omega_e"]
    assert (off > 1.2) is stator_hold
    answer = diagnose(tmp_path / "open")
    assert answer.verdict == "no_mismatch"
    found = [f["finding"] for f in answer.data_quality if "stator" in f["finding"]]
    assert len(found) == len(said)
    assert all(words in finding for words, finding in zip(said, found, strict=True))


@pytest.mark.parametrize("log_command", [False, True])
def test_how_voltages_are_held_is_seen_beside_friction_that_is_missing(tmp_path, log_command):
    """The currents tell of it where the motion has something else to tell."""
    friction = {"coulomb_friction": {"tau_c": 1.0}}
    held = {"stator_hold": True, "log_command": log_command}
    answer = diagnosed(tmp_path, TRACTION, friction, "fast", "none", 3, **held)
    assert (answer.verdict, answer.model["effects"]) == ("named", ["coulomb_friction"])
    assert any("stator" in finding["finding"] for finding in answer.data_quality)


@pytest.mark.parametrize(
    ("effects", "verdict"), [({}, "no_mismatch"), ({"coulomb_friction": {"tau_c": 1.0}}, "named")]
)
def test_a_simulation_without_noise_is_judged_like_a_recording(effects, verdict):
    """Two ways to integrate the same equations differ, and that is nobody's physics."""
    manoeuvre = make(TRACTION, "rich", "none", duration=1.0, seed=4)
    run = simulate(TRACTION, effects, manoeuvre, seed=8, noise=False)
    names = ("n_p", "r_s", "l_d", "l_q", "psi_m", "j", "b", "v_dc", "i_rated")
    machine = pm.Machine(**{name: getattr(nameplate_of(TRACTION, 4), name) for name in names})
    answer = pm.diagnose(pm.Recording(t=run.t, **run.log), machine)
    assert (answer.verdict, answer.effects) == (verdict, tuple(effects))


def test_a_poor_recording_that_does_not_foresee_the_validation_run_says_so(tmp_path):
    """At one speed and load an angle offset hides in the parameters; another run is then predicted badly."""
    make_case(
        tmp_path / "open",
        SERVO,
        {"encoder_angle_offset": {"offset_el_rad": -0.012}},
        "poor",
        "unknown_piecewise",
        1333452,
        truth_folder=tmp_path / "sealed",
        duration=1.73,
    )
    alone, judged = (diagnose(tmp_path / "open", judged=j) for j in (False, True))
    assert judged.verdict == "no_mismatch"
    said = [[f for f in a.data_quality if "validation run" in f["finding"]] for a in (alone, judged)]
    assert [len(s) for s in said] == [0, 1]
    assert "times the noise in i_" in said[1][0]["finding"]


def test_a_case_hides_its_truth_and_states_only_the_nameplate(tmp_path):
    effects = {"coulomb_friction": {"tau_c": 0.2}}
    truth = make_case(
        tmp_path / "open",
        SERVO,
        effects,
        "rich",
        "known_constant",
        5,
        truth_folder=tmp_path / "sealed",
        duration=0.6,
    )
    assert sorted(p.name for p in (tmp_path / "open").iterdir()) == [
        "machine.toml", "recording.parquet", "validation.parquet"
    ]  # fmt: skip
    assert json.loads((tmp_path / "sealed" / "truth.json").read_text()) == truth
    machine = tomllib.loads((tmp_path / "open" / "machine.toml").read_text())
    for name, value in machine["machine"].items():
        off = abs(value / getattr(SERVO, name) - 1.0)
        assert off == 0.0 if name == "n_p" else 0.0499 < off < 0.2001
    assert machine["load"] == {"kind": "known_constant", "value": truth["load_const"]}
    for name in ("recording", "validation"):
        table = pq.read_table(tmp_path / "open" / f"{name}.parquet")
        assert [str(f.type) for f in table.schema] == ["double"] + 7 * ["float"]
        assert table.num_rows == 6000
        assert truth["runs"][name]["plain_refit"]["omega_e"] > 1.5
    with pytest.raises(ValueError, match="truth"):
        make_case(tmp_path, SERVO, {}, truth_folder=tmp_path)


def test_an_effect_outside_the_catalogue_is_expected_to_be_called_unknown(tmp_path):
    effects = {"x_tight_spot": {"tau": 0.5}}
    truth = make_case(tmp_path / "open", SERVO, effects, truth_folder=tmp_path / "sealed", duration=0.3)
    assert truth["expected"] == "unknown"
    assert truth["components"] == []


@pytest.mark.parametrize("kind", bench.KINDS)
def test_a_lesser_logger_keeps_rows_and_truth_together(kind):
    run = simulate(SERVO, {}, make(SERVO, "rich", "none", duration=0.2, seed=3), seed=8)
    worse = bench.degrade(run, kind, SERVO, 8)
    for column in (*worse.log.values(), *worse.truth.values()):
        assert column.shape == worse.t.shape
    assert np.all(np.diff(worse.t) > 0.0)
    assert ("i_c" in worse.log) == (kind != "two_currents")
    changed = len(worse.t) < len(run.t) or worse.log.keys() != run.log.keys()
    assert changed or any(not np.array_equal(run.log[k], worse.log[k]) for k in run.log)


@pytest.mark.parametrize(("f_res", "most"), [(60.06, 0.01), (66.0, 0.05)])
def test_a_shaft_begins_under_its_load(f_res, most):
    m = make(SERVO, "rich", "known_constant", duration=0.2, seed=3)
    stiff = simulate(SERVO, {}, m, seed=3, noise=False).truth["omega_m"]
    shaft = {"two_mass_shaft": {"f_antires": 60.0, "f_res": f_res}}
    twisting = simulate(SERVO, shaft, m, seed=3, noise=False).truth["omega_m"]
    # before the currents rise; let go under its load it would ring by 0.65 rad/s
    early = slice(0, 20)
    assert np.abs(twisting - stiff)[early].max() < most


def test_the_demo_is_what_its_recipe_makes():
    demo = ROOT / "python" / "pmsm_rs" / "demo_data"
    effects = {make_demo.EFFECT: make_demo.PARAMETERS}
    sealed = json.loads((demo / "sealed.json").read_text())
    assert {sealed["effect"]: sealed["parameters"]} == effects
    assert sealed["base_true"] == {k: getattr(SERVO, k) for k in sealed["base_true"]}
    nameplate = nameplate_of(SERVO, make_demo.SEED)
    for number, name in enumerate(("recording", "validation")):
        assert (demo / f"{name}.parquet").stat().st_size < make_demo.LARGEST
        table = pq.read_table(demo / f"{name}.parquet")
        assert table.num_rows == 20_000
        seed = 1000 * make_demo.SEED + number
        manoeuvre = make(SERVO, "rich", "unknown_constant", duration=2.0, seed=seed)
        run = simulate(SERVO, effects, manoeuvre, seed=seed, nameplate=nameplate)
        for column, values in run.log.items():
            # another rounding may move a sample across an ADC or encoder step, which the loop then carries on
            same = np.isclose(table[column].to_numpy(), values, rtol=1e-3, atol=1e-3 * np.abs(values).max())
            assert same.mean() > 0.99, column
        plain = account(SERVO, effects, manoeuvre, run)["plain_refit"]
        assert 5.0 < max(plain["i_d"], plain["i_q"]) < 8.0

"""Steady points that show parameters alone: shorted terminals, and torque without voltages. Formulas are the
test's own.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pmsm_rs as pm
import pytest
from pmsm_rs.view.headline import headline

R_S, L_D, L_Q, PSI_M, N_P = 0.02, 1.5e-4, 4e-4, 0.05, 4


def shorted(rows: int, angle: float = 0.0, seed: int = 2) -> dict[str, np.ndarray]:
    """Currents of shorted terminals over speed, with 0.2 % of noise; `angle` (rad) bounds a random error of
    the rotor angle.
    """
    rng = np.random.default_rng(seed)
    omega = np.geomspace(15.0, 1500.0, rows)
    currents = []
    for w in omega:
        voltages = np.array([[R_S, -w * L_Q], [w * L_D, R_S]])
        d, q = np.linalg.solve(voltages, [0.0, -w * PSI_M])
        c, s = np.cos(x := rng.uniform(-angle, angle)), np.sin(x)
        currents.append([c * d - s * q, s * d + c * q] * (1.0 + 0.002 * rng.standard_normal(2)))
    i_d, i_q = np.array(currents).T
    zero = np.zeros(rows)
    return {"t": 10.0 * np.arange(rows), "i_d": i_d, "i_q": i_q, "v_d": zero, "v_q": zero, "omega_e": omega}


def shaft(columns: dict[str, np.ndarray]) -> np.ndarray:
    """The torque that brakes the shorted machine, by the heat in its winding, and some drag."""
    heat = 1.5 * R_S * (columns["i_d"] ** 2 + columns["i_q"] ** 2)
    torque: np.ndarray = -heat * N_P / columns["omega_e"] - 0.3
    return torque


def test_five_shorted_points_show_the_winding_where_the_flux_is_known() -> None:
    answer = pm.diagnose(pm.Recording(**shorted(5)), pm.Machine(n_p=N_P, psi_m=PSI_M))
    for name, true in (("r_s", R_S), ("l_d", L_D), ("l_q", L_Q)):
        assert answer.base[name].value == pytest.approx(true, rel=0.03)
    assert (answer.verdict, answer.effects, answer.ranking) == ("undetermined", (), ())
    assert headline(answer).startswith("Only parameters can be told: the terminals are shorted")
    assert str(answer).count("the terminals are shorted") == 1, "in the headline, and not again below it"
    [finding] = [f for f in answer.data_quality if f["finding"] in (answer.reason or "")]
    assert f"  ! {finding['consequence'][:40]}" in str(answer), "its consequence is told all the same"
    assert "All effects of the catalogue, for the reason above." in str(answer)


@pytest.mark.parametrize("angle", [0.0, 0.5])
def test_a_torque_gives_shorted_points_their_scale_even_where_the_angle_is_wrong(angle: float) -> None:
    columns = shorted(14, angle)
    columns["tau_m"] = shaft(columns)
    answer = pm.diagnose(pm.Recording(**columns), pm.Machine(n_p=N_P))
    for name, true in (("r_s", R_S), ("l_d", L_D), ("l_q", L_Q), ("psi_m", PSI_M)):
        assert answer.base[name].value == pytest.approx(true, rel=0.05)
    said = any("their angle is off" in f["finding"] for f in answer.data_quality)
    assert said == bool(angle)


def test_shorted_points_without_a_scale_say_what_is_needed() -> None:
    answer = pm.diagnose(pm.Recording(**shorted(8)), pm.Machine(n_p=N_P))
    assert not answer.base
    ratio = re.search(r"r_s/psi_m = ([\d.]+) A/s", answer.reason or "")
    assert ratio is not None
    assert float(ratio[1]) == pytest.approx(R_S / PSI_M, rel=0.02)
    assert answer.reason is not None
    assert "give psi_m under [machine], or map the measured torque to tau_m" in answer.reason


@pytest.mark.parametrize("second", ["set", "moving"])
def test_the_only_torque_that_moves_gives_shorted_points_their_scale(second: str, tmp_path: Path) -> None:
    columns = shorted(14)
    torque = shaft(columns)
    columns["M_HMmess [Nm]"] = torque
    columns["SO_M [Nm]"] = 0.5 * torque if second == "moving" else np.zeros(14)
    file = tmp_path / "points.csv"
    kept = [name for name in columns if name not in {"v_d", "v_q"}]
    rows = np.column_stack([columns[name] for name in kept])
    np.savetxt(file, rows, delimiter=",", header=",".join(kept), comments="")
    zero = 'v_d = { value = 0.0, unit = "V" }\nv_q = { value = 0.0, unit = "V" }\n'
    machine = tmp_path / "machine.toml"
    machine.write_text(f"[machine]\nn_p = {N_P}\n[columns]\n{zero}")
    answer = pm.diagnose(file, machine)
    if second == "moving":
        assert not answer.base, "two torques of which nothing says which was measured"
    else:
        assert answer.base["r_s"].value == pytest.approx(R_S, rel=0.05)


def dyno(outliers: int, seed: int = 5) -> dict[str, np.ndarray]:
    """A map over i_q and speed in both directions of rotation, with friction and wild readings."""
    rng = np.random.default_rng(seed)
    i_q, omega = (x.ravel() for x in np.meshgrid(np.linspace(-20.0, 20.0, 9), np.linspace(-300.0, 300.0, 10)))
    i_d = 0.2 * rng.standard_normal(i_q.size)
    tau = 1.5 * N_P * (PSI_M + (L_D - L_Q) * i_d) * i_q - 2e-4 * omega - 0.08 * np.sign(omega)
    tau += 0.01 * rng.standard_normal(i_q.size)
    tau[rng.choice(i_q.size, outliers, replace=False)] += 5.0
    return {"t": 2.0 * np.arange(i_q.size), "i_d": i_d, "i_q": i_q, "omega_m": omega, "tau_m": tau}


@pytest.mark.parametrize("outliers", [0, 6])
def test_a_torque_map_shows_flux_and_friction(outliers: int) -> None:
    machine = pm.Machine(n_p=N_P, l_d=L_D, l_q=L_Q, psi_m=1.05 * PSI_M)
    answer = pm.diagnose(pm.Recording(**dyno(outliers)), machine)
    assert answer.base["psi_m"].value == pytest.approx(PSI_M, rel=0.005)
    assert answer.base["b"].value == pytest.approx(2e-4, rel=0.1)
    drag = re.search(r"constant drag of ([\d.]+) (m?)N m", answer.reason or "")
    assert drag is not None
    assert float(drag[1]) * (1e-3 if drag[2] else 1.0) == pytest.approx(0.08, rel=0.1)
    assert (answer.verdict, answer.effects, answer.ranking) == ("undetermined", (), ())
    wild = [f for f in answer.data_quality if f["consequence"] == "they have no weight"]
    assert bool(wild) == bool(outliers)
    assert "Only parameters can be told" in headline(answer)
    found = pm.inspect(dyno(outliers), machine)
    assert "Steady points of torque" in str(found)
    assert found.why_not["motion"] in answer.read[0]["questions"]["why_not"]
    assert not answer.read[0]["questions"]["mechanical"]


def test_a_torque_map_that_contradicts_the_nameplate_says_so() -> None:
    answer = pm.diagnose(pm.Recording(**dyno(0)), pm.Machine(n_p=N_P, psi_m=4.0 * PSI_M))
    assert any("the nameplate states" in f["finding"] for f in answer.data_quality)

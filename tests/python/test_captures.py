"""Captures of an oscilloscope without angle and speed, made here by a simulation of its own."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable

import numpy as np
import pmsm_rs as pm
import pytest
from numpy.typing import NDArray

Array = NDArray[np.float64]
Columns = dict[str, Array]
THIRD = 2.0 * np.pi / 3.0
PSI, R_S, L_D, L_Q, PAIRS = 0.08, 0.4, 2.5e-3, 4e-3, 4
NAMEPLATE = pm.Machine(n_p=PAIRS, r_s=0.45, l_d=2.8e-3, l_q=3.6e-3, psi_m=0.085)


def loaded(columns: Columns, machine: pm.Machine | None = NAMEPLATE) -> pm.Recording:
    return pm.load(columns, machine)


def told(recording: pm.Recording) -> str:
    return " ".join(remark.finding for remark in recording.account.remarks)


def terminals(speed: Callable[[Array], Array], *, seconds: float = 0.8, noise: float = 0.02) -> Columns:
    """Phase voltages of open terminals with a 5th, a 7th and a third harmonic, the last common to all."""
    t = np.arange(0.0, seconds, 2e-4)
    omega = speed(t)
    theta = 0.7 + np.concatenate(([0.0], np.cumsum(0.5 * np.diff(t) * (omega[1:] + omega[:-1]))))
    rng = np.random.default_rng(5)

    def phase(x: int) -> Array:
        at = theta - x * THIRD
        wave = np.sin(at) + 0.03 * np.sin(5.0 * at) + 0.01 * np.sin(7.0 * at) + 0.05 * np.sin(3.0 * at)
        return -omega * PSI * wave + noise * rng.standard_normal(len(t))

    return {"t": t} | {f"v_{name}": phase(x) for x, name in enumerate("abc")}


def against_a(whole: Columns) -> Columns:
    """The same as two channels of which v_a is the ground see it."""
    ground = whole["v_a"]
    return {"t": whole["t"], "v_a": 0.0 * ground} | {n: whole[n] - ground for n in ("v_b", "v_c")}


SPEEDS: dict[str, Callable[[Array], Array]] = {
    "constant": lambda t: np.full_like(t, 260.0),
    "rising": lambda t: 150.0 + 300.0 * t,
    "backwards": lambda t: -260.0 - 40.0 * np.sin(3.0 * t),
}


@pytest.mark.parametrize("speed", SPEEDS.values(), ids=SPEEDS)
@pytest.mark.parametrize("channels", [against_a, lambda whole: whole], ids=["two", "three"])
def test_open_terminals_give_flux_and_harmonics(
    channels: Callable[[Columns], Columns], speed: Callable[[Array], Array]
) -> None:
    recording = loaded(channels(terminals(speed, seconds=0.5)), pm.Machine(n_p=PAIRS))
    assert recording.kind == "open_circuit"
    assert "No speed was logged" in told(recording)
    answer = pm.diagnose(recording, pm.Machine(n_p=PAIRS), threads=2)
    assert answer.base["psi_m"].value == pytest.approx(PSI, rel=0.01)
    assert answer.effects == ("back_emf_harmonics",)
    found = answer.ranking[0].parameters
    assert found["e5_rel"].value == pytest.approx(0.03, abs=0.003)
    assert found["e7_rel"].value == pytest.approx(0.01, abs=0.003)


def motor(*, seconds: float = 0.6, noise: float = 1.0) -> tuple[Columns, Array]:
    """A motor that starts from standstill and takes up a load, by Euler steps of its own, and its angle. The
    voltages are those of each moment, as an oscilloscope sees them.
    """
    fine, every, inertia = 5e-6, 20, 8e-4
    count = every * round(seconds / (every * fine))
    theta, omega, i_d, i_q = 0.3, 0.0, 0.0, 0.0
    sum_d, sum_q = 0.0, 0.0
    out = np.empty((count // every, 6))
    for k in range(count):
        t = k * fine
        wanted_q = max(-12.0, min(12.0, 0.06 * ((0.0 if t < 0.05 else 350.0) - omega)))
        wanted_d = 0.0 if t < 0.3 else -3.0
        off_d, off_q = wanted_d - i_d, wanted_q - i_q
        sum_d, sum_q = sum_d + off_d * fine, sum_q + off_q * fine
        v_d = 4.0 * off_d + 600.0 * sum_d - omega * L_Q * i_q
        v_q = 4.0 * off_q + 600.0 * sum_q + omega * (L_D * i_d + PSI)
        if k % every == 0:
            out[k // every] = (t, theta, v_d, v_q, i_d, i_q)
        load = (0.2 if t < 0.4 else 1.2) * math.tanh(omega / 5.0)
        torque = 1.5 * PAIRS * (PSI + (L_D - L_Q) * i_d) * i_q
        i_d += fine / L_D * (v_d - R_S * i_d + omega * L_Q * i_q)
        i_q += fine / L_Q * (v_q - R_S * i_q - omega * (L_D * i_d + PSI))
        omega += fine * PAIRS * (torque - load) / inertia
        theta += fine * omega
    t, theta_e, *axes = out.T
    rng = np.random.default_rng(11)

    def seen(d: Array, q: Array, x: int, spread: float) -> Array:
        at = theta_e - x * THIRD
        return d * np.cos(at) - q * np.sin(at) + spread * rng.standard_normal(len(t))

    columns = {"t": t}
    for x, name in enumerate("ab"):
        columns[f"v_{name}"] = seen(axes[0], axes[1], x, 0.1 * noise)
        columns[f"i_{name}"] = seen(axes[2], axes[3], x, 0.02 * noise)
    return columns, theta_e


@pytest.fixture(scope="module")
def running() -> tuple[Columns, Array]:
    return motor()


def test_the_angle_of_a_running_motor_is_that_of_its_flux(running: tuple[Columns, Array]) -> None:
    columns, theta = running
    recording = loaded(columns)
    assert recording.kind == "electrical"
    assert recording.angle_error is not None
    assert recording.angle_error < np.radians(3.0)
    rows = np.searchsorted(columns["t"], recording.column("t"))
    off = np.angle(np.exp(1j * (recording.column("theta_e") - theta[rows])))
    assert np.sqrt(np.mean(off**2)) < np.radians(3.0)
    assert "No angle was logged" in told(recording)
    assert "rows were left out" in told(recording)
    again = pickle.loads(pickle.dumps(recording))
    assert (again.kind, again.angle_error) == (recording.kind, recording.angle_error)


def test_a_healthy_running_motor_gives_its_parameters_and_no_name(running: tuple[Columns, Array]) -> None:
    recording = loaded(running[0])
    answer = pm.diagnose(recording, NAMEPLATE, threads=2)
    assert answer.base["psi_m"].value == pytest.approx(PSI, rel=0.03)
    assert answer.base["r_s"].value == pytest.approx(R_S, rel=0.1)
    assert answer.effects == ()
    assert not [entry.effect for entry in answer.ranking if entry.probability > 0.5]
    unseen = " ".join(str(entry) for entry in answer.data["cannot_see"])
    assert "the rotor angle was taken from the voltages" in unseen
    assert "could be an error of this angle" in str(answer.data["data_quality"])


def refusal(columns: Columns, machine: pm.Machine | None = NAMEPLATE) -> str:
    with pytest.raises(pm.DataError) as caught:
        loaded(columns, machine)
    return str(caught.value)


def test_what_a_capture_cannot_tell_is_refused_in_a_sentence(running: tuple[Columns, Array]) -> None:
    whole = terminals(SPEEDS["constant"])
    assert "in which direction" in refusal({"t": whole["t"], "v_a": whole["v_a"]})
    short = {name: values[:150] for name, values in whole.items()}
    assert "electrical turns" in refusal(short)
    two = against_a(whole)
    assert "v_a = { value = 0.0 }" in refusal({n: two[n] for n in ("t", "v_b", "v_c")})
    columns = running[0]
    assert "l_q is not known" in refusal(columns, pm.Machine(n_p=PAIRS))
    assert "the only phase current" in refusal({n: x for n, x in columns.items() if n != "i_b"})
    exchanged = columns | {"i_a": columns["i_b"], "i_b": columns["i_a"]}
    assert "phase" in refusal(exchanged)
    turned = columns | {name: -columns[name] for name in ("i_a", "i_b")}
    assert "none can be negative" in refusal(turned)


def test_a_capture_that_has_its_speed_is_left_as_it_is() -> None:
    whole = terminals(SPEEDS["constant"])
    recording = loaded(whole | {"omega_e": np.full_like(whole["t"], 260.0)})
    assert np.array_equal(recording.column("v_a"), whole["v_a"])
    assert not recording.account.remarks

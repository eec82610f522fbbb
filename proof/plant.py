"""Simulates a PMSM drive in phase variables: the independent witness against which the package is proved.

It shares neither code nor formulation with the package: three line flux linkages with position-dependent
inductances from one co-energy (`coenergy`), an inverter of three averaged legs, adaptive integration
(`dynamics`), closed-loop control (`drive`).  Needs numpy and numba, which is an extra of the proof and no
dependency of the package.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .drive import LOG, RUNAWAY, TRUTH, run
from .effects import Effects, build
from .manoeuvres import Manoeuvre
from .parameters import Machine


@dataclass(frozen=True)
class Run:
    """One simulated recording.

    t (n,) s; `log` maps the canonical column names to arrays (n,) as a bench would have them; `truth` maps
    names of drive.TRUTH to arrays (n,): true phase currents (A), theta_m (rad), omega_m (rad/s), tau_e (N·m),
    v_dc (V), winding heat, the energies taken in, lost, given to the shaft and stored in the field (J), and
    currents (A) and electrical speed (rad/s) as the sensors have them before noise and quantisation, and the
    twist of the shaft (rad) and the speed of the load (rad/s).
    """

    t: np.ndarray
    log: dict[str, np.ndarray]
    truth: dict[str, np.ndarray]


def controller_gains(machine: Machine, nameplate: Machine) -> np.ndarray:
    """Gains for `drive.control` from the nameplate, as an engineer would commission the drive.

    Current loop at a 25th of the sample rate, speed loop at 20 Hz, both in the technical-optimum sense.
    """
    w_c = 2.0 * np.pi * machine.f_sample / 25.0
    w_s = 2.0 * np.pi * 20.0
    per_amp = 1.5 * nameplate.n_p * nameplate.psi_m
    kp_w = nameplate.j * w_s / per_amp
    return np.array(
        [kp_w, kp_w * w_s / 4.0, nameplate.l_d * w_c, nameplate.l_q * w_c, nameplate.r_s * w_c, nameplate.l_d,
         nameplate.l_q, nameplate.psi_m, 1.5 * machine.i_rated, 0.98 * machine.v_dc / np.sqrt(3.0),
         1.0 / machine.f_sample, float(machine.n_p)]
    )  # fmt: skip


def simulate(
    machine: Machine,
    effects: Effects,
    manoeuvre: Manoeuvre,
    *,
    seed: int,
    nameplate: Machine | None = None,
    noise: bool = True,
    stator_hold: bool = False,
    log_command: bool = False,
) -> Run:
    """Run the drive through a manoeuvre.

    effects maps effect names to parameters (`effects.CATALOGUE`); controllers are tuned to the nameplate
    (default: the machine itself).  noise=False leaves sensor noise, ADC and encoder steps out.  stator_hold
    freezes the command in the stator for each interval and logs its mean in the rotor's frame, or with
    log_command the command itself; the default holds it in the rotor's frame.  Each noise has a stream of its
    own, so the same seed gives the same noise whatever is switched on.  Raises
    KeyError for an unknown effect or parameter, ValueError for a combination that has no equations,
    RuntimeError where the integration breaks down or the currents run away.
    """
    p = build(machine, effects, locked=manoeuvre.locked)
    if stator_hold and p.delay > 0.0:
        raise ValueError("stator_hold and voltage_delay cannot be switched on together")
    n = len(manoeuvre.w_ref)
    streams = [np.random.default_rng([seed, s]) for s in range(5)]
    on = 1.0 if noise else 0.0
    noise_i = on * machine.noise_i * streams[0].standard_normal((n, 3))
    noise_w = on * machine.noise_w * streams[1].standard_normal(n)
    start = np.array([streams[2].uniform(-np.pi, np.pi), manoeuvre.w_start])
    log, truth, done = run(
        p.packed(), start, manoeuvre.w_ref, manoeuvre.i_d_ref, manoeuvre.i_q_add,
        manoeuvre.locked or manoeuvre.currents_alone,
        manoeuvre.tau_load, noise_i, noise_w, on * machine.lsb_i, on * machine.lsb_theta_e,
        controller_gains(machine, nameplate or machine), stator_hold, log_command,
    )  # fmt: skip
    if done < n:
        sane = np.abs(truth[done, :3]).max() <= RUNAWAY * machine.i_rated
        raise RuntimeError(
            f"{machine.name} {'cannot be integrated' if sane else 'runs away'} at sample {done} of {n}"
        )
    cut = manoeuvre.settle
    columns = {name: log[cut:, c].copy() for c, name in enumerate(LOG)}
    if manoeuvre.load == "measured":
        columns["tau_m"] = (manoeuvre.tau_load + on * machine.noise_tau * streams[3].standard_normal(n))[cut:]
    if p.r_source > 0.0 and manoeuvre.log_v_dc:
        columns["v_dc"] = truth[cut:, 6] + on * 1e-3 * machine.v_dc * streams[4].standard_normal(n - cut)
    t = np.arange(n - cut) / machine.f_sample
    return Run(t, columns, {name: truth[cut:, c].copy() for c, name in enumerate(TRUTH)})

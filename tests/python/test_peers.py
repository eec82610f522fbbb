"""The simulated drive against motulator's, on the same machine and references; skipped where motulator is not
installed (pip extra `peers`).

motulator supplies converter, machine, mechanics and solver. The controllers are written here once more, from
the description of the drive in the manual, since motulator's own have another structure.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pmsm_rs as pm
import pytest

control = pytest.importorskip("motulator.common.control", reason="pip install pmsm-rs[peers]")
drive = pytest.importorskip("motulator.drive.model")
utils = pytest.importorskip("motulator.drive.utils")

R_S, L_D, L_Q, PSI, N_P, J, B = 0.17, 1.9e-3, 3.8e-3, 0.19, 4, 0.008, 0.00115
V_DC, I_LIMIT, T_S = 560.0, 110.0, 1e-4
DURATION, TIMES, SPEEDS = 0.2, [0.0, 0.08, 0.12, 0.2], [0.0, 90.0, 90.0, 40.0]
LOAD_STEP, LOADS, I_D = 0.1, (3.0, 12.0), -12.0


class Cascade(control.ControlSystem):
    """PI speed and current control with decoupling, limits and back-calculation."""

    def __init__(self) -> None:
        super().__init__(T_S)
        omega_c, omega_s = 2 * np.pi * 400.0, 2 * np.pi * 20.0
        self.kp_w = J * omega_s / (1.5 * N_P * PSI)
        self.ki_w = self.kp_w * omega_s / 4
        self.kp, self.ki = np.array([L_D, L_Q]) * omega_c, R_S * omega_c
        self.i_w, self.i_dq = 0.0, np.zeros(2)
        self.load = LOADS[0]
        self.rows: list[list[float]] = []

    def get_feedback_signals(self, mdl: Any) -> SimpleNamespace:
        theta = N_P * mdl.mechanics.meas_position()
        phases = mdl.machine.meas_currents()
        i = 2 / 3 * np.dot(np.exp(-1j * theta) * np.exp(2j / 3 * np.pi * np.arange(3)), phases)
        omega = N_P * mdl.mechanics.meas_speed()
        # Held over the period, so that no step of the solver straddles the change.
        self.load = LOADS[0] if self.clock.t < LOAD_STEP - 0.5 * T_S else LOADS[1]
        self.rows.append([self.clock.t, i.real, i.imag, omega])
        return SimpleNamespace(theta=theta, i=np.array([i.real, i.imag]), omega=omega)

    def output(self, fbk: SimpleNamespace) -> SimpleNamespace:
        ref = super().output(fbk)
        error = np.interp(ref.t, TIMES, SPEEDS) - fbk.omega / N_P
        wish = self.kp_w * error + self.i_w
        room = np.sqrt(I_LIMIT**2 - I_D**2)
        i_q = np.clip(wish, -room, room)
        self.i_w += T_S * self.ki_w * (error + (i_q - wish) / self.kp_w)
        e = np.array([I_D, i_q]) - fbk.i
        ahead = fbk.omega * np.array([-L_Q * fbk.i[1], L_D * fbk.i[0] + PSI])
        wanted = self.kp * e + self.i_dq + ahead
        v = wanted * min(1.0, V_DC / np.sqrt(3) / np.hypot(*wanted)) if wanted.any() else wanted
        self.i_dq = self.i_dq + T_S * self.ki * (e + (v - wanted) / self.kp)
        vector = (v[0] + 1j * v[1]) * np.exp(1j * (fbk.theta + 1.5 * T_S * fbk.omega))
        legs = np.real(vector * np.exp(-2j / 3 * np.pi * np.arange(3)))
        ref.d_abc = 0.5 + (legs - 0.5 * (legs.max() + legs.min())) / V_DC
        return ref

    # Abstract in the class above.
    def update(self, fbk: SimpleNamespace, ref: SimpleNamespace) -> None:
        super().update(fbk, ref)

    def save(self, **_: Any) -> None:
        """The rows are all that is wanted."""


@pytest.mark.parametrize("inverter", ["averaged", "switching"])
def test_drive_agrees_with_motulator(inverter: str) -> None:
    cascade = Cascade()
    plant = drive.Drive(
        drive.VoltageSourceConverter(u_dc=V_DC),
        drive.SynchronousMachine(utils.SynchronousMachinePars(n_p=N_P, R_s=R_S, L_d=L_D, L_q=L_Q, psi_f=PSI)),
        drive.StiffMechanicalSystem(J=J, B_L=B, tau_L=lambda t: cascade.load),
    )
    if inverter == "switching":
        # Duty cycles as they are: its counter would round them to 12 bits.
        plant.pwm = drive.CarrierComparison(N=2**40)
    # The default tolerance of its solver is a thousandth; short steps make it finer than that.
    drive.Simulation(plant, cascade).simulate(t_stop=DURATION, max_step=T_S / 5)
    t, i_d, i_q, omega = np.array(cascade.rows).T

    made = pm.simulate(
        duration=DURATION,
        machine=pm.Machine(n_p=N_P, r_s=R_S, l_d=L_D, l_q=L_Q, psi_m=PSI, j=J, b=B),
        drive={
            "v_dc": V_DC,
            "i_limit": I_LIMIT,
            "f_sample": 1 / T_S,
            "substeps": 4,
            **({"hold": "stator"} if inverter == "averaged" else {"inverter": inverter, "f_sw": 0.5 / T_S}),
        },
        control={"current_bandwidth": 400.0, "speed_bandwidth": 20.0},
        reference={"omega_m": {"t": TIMES, "value": SPEEDS}, "i_d": I_D},
        load={"tau": {"t": [0.0, LOAD_STEP], "value": LOADS, "shape": "steps"}},
    )
    n = len(made.recording)
    assert np.allclose(t[:n], made.recording.column("t"), atol=1e-9)
    truth = made.truth.traces
    for name, theirs, ours, unit in (
        ("i_d", i_d, truth["i_d"], np.ptp(truth["i_q"])),
        ("i_q", i_q, truth["i_q"], np.ptp(truth["i_q"])),
        ("omega_e", omega, N_P * truth["omega_m"], np.ptp(N_P * truth["omega_m"])),
    ):
        worst = np.abs(theirs[:n] - ours).max() / unit
        assert worst < 1e-8, f"{name}: {worst:.1e} of its range"

"""The field's own simulators on the window of the jobs: one machine under given voltages, and its fitness.

Each sample is solved as the simulator itself solves one: motulator by scipy's solve_ivp on the right-hand
side of its Drive, gym-electric-motor by its ScipyOdeSolver on that of its motor and load. What they save for
plots is left out.
"""

from __future__ import annotations

import cmath
from collections.abc import Callable

import numpy as np
from gym_electric_motor.physical_systems.electric_motors import PermanentMagnetSynchronousMotor
from gym_electric_motor.physical_systems.mechanical_loads import PolynomialStaticLoad
from gym_electric_motor.physical_systems.solvers import ScipyOdeSolver
from motulator.drive import model, utils
from scipy.integrate import solve_ivp
from window import PERIOD, POLE_PAIRS, TRUTH, Array, weight

R_S, L_D, L_Q, PSI_M, INERTIA, FRICTION, LOAD = map(float, TRUTH)
PAIRS = int(POLE_PAIRS)
V_DC = 560.0


def cost(run: Array, columns: dict[str, Array]) -> float:
    """Fitness of i_d, i_q, omega_e of shape (samples, 3)."""
    errors = run - np.stack([columns[name] for name in ("i_d", "i_q", "omega_e")], axis=1)
    errors *= np.array([1.5**0.5, 1.5**0.5, weight(columns)])
    return float(np.sum(errors**2))


def motulator(columns: dict[str, Array]) -> Callable[[], float]:
    """The voltage is held in the stator where the rotor is when a sample begins."""

    def call() -> float:
        machine = model.SynchronousMachine(
            utils.SynchronousMachinePars(n_p=PAIRS, R_s=R_S, L_d=L_D, L_q=L_Q, psi_f=PSI_M)
        )
        mechanics = model.StiffMechanicalSystem(J=INERTIA, B_L=FRICTION, tau_L=lambda _t: LOAD)
        drive = model.Drive(model.VoltageSourceConverter(u_dc=V_DC), machine, mechanics)
        machine.state.psi_s = complex(L_D * columns["i_d"][0] + PSI_M, L_Q * columns["i_q"][0])
        mechanics.state.w_M = columns["omega_e"][0] / PAIRS
        run = np.empty((len(columns["v_d"]), 3))
        for k, (v_d, v_q) in enumerate(zip(columns["v_d"], columns["v_q"], strict=True)):
            current = machine.state.psi_s - PSI_M
            run[k] = current.real / L_D, current.imag / L_Q, PAIRS * np.real(mechanics.state.w_M)
            angle = cmath.phase(machine.state.exp_j_theta_m)
            drive.converter.inp.q_cs = complex(v_d, v_q) * cmath.exp(1j * angle) / V_DC
            done = solve_ivp(drive.rhs, (k * PERIOD, (k + 1) * PERIOD), drive.get_initial_values())
            drive.set_states(done.y[:, -1].tolist())
        return cost(run, columns)

    return call


def gym(columns: dict[str, Array]) -> Callable[[], float]:
    """The voltage is held in the rotor's frame; the constant load is taken from the torque."""
    motor = PermanentMagnetSynchronousMotor(
        motor_parameter={
            "p": PAIRS,
            "l_d": L_D,
            "l_q": L_Q,
            "r_s": R_S,
            "psi_p": PSI_M,
            "j_rotor": INERTIA / 2,
        }
    )
    mechanics = PolynomialStaticLoad(
        load_parameter={"a": 0.0, "b": FRICTION, "c": 0.0, "j_load": INERTIA / 2}
    )
    mechanics.set_j_rotor(INERTIA / 2)

    def slope(t: float, y: Array, v: Array) -> Array:
        faster = mechanics.mechanical_ode(t, y[:1], motor.torque(y[1:4]) - LOAD)
        return np.concatenate([faster, motor.electrical_ode(y[1:4], v, y[0])])

    def call() -> float:
        solver = ScipyOdeSolver()
        solver.set_system_equation(slope)
        first = [columns["omega_e"][0] / PAIRS, columns["i_d"][0], columns["i_q"][0], 0.0]
        solver.set_initial_value(np.array(first), 0.0)
        run = np.empty((len(columns["v_d"]), 3))
        for k, v in enumerate(zip(columns["v_d"], columns["v_q"], strict=True)):
            y = solver.y
            run[k] = y[1], y[2], PAIRS * y[0]
            solver.set_f_params(np.array(v))
            solver.integrate((k + 1) * PERIOD)
        return cost(run, columns)

    return call

"""Drives whose equations come from other people's simulators: motulator and gym-electric-motor.

Machine, mechanics and, for motulator, the inverter are theirs; sensors and controllers are those of `drive`,
so that a case looks the same whoever simulated it.  Their own solvers start anew at every sample, which
costs ten times as much as the equations; here a classical Runge-Kutta step (M. W. Kutta, 1901) goes through
their right-hand sides, SUBSTEPS to a sample.

motulator (MIT, Aalto University): space vectors in the rotor's frame, stator flux as the state, duty ratios
held in the stator; a current map i_s(ψ_s) for saturation, two masses, friction as a function of speed.
gym-electric-motor (MIT, Paderborn University): currents in the rotor's frame as the state, voltage held in
the rotor's frame; load torque a sign(ω) + b ω + c ω².
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from .drive import LOG, RUNAWAY, TRUTH, control, measure
from .dynamics import N_STATES
from .effects import Effects, build, effect_values
from .manoeuvres import Manoeuvre
from .parameters import Machine, Parameters
from .plant import Run, controller_gains

SIMULATORS = ("motulator", "gym-electric-motor")
SUBSTEPS = 2
# exponent of motulator's saturating current map; the plant's knee has another shape
EXPONENT = 4


class Equations(Protocol):
    """A drive's equations in somebody else's variables y."""

    holds_stator: bool

    def start(self, theta_e: float) -> np.ndarray:
        """States at rest without current at the electrical angle theta_e in rad."""
        ...

    def apply(self, v_d: float, v_q: float, hold: float, tau_load: float) -> None:
        """Set the command (V), the angle (rad) at which it is held in the stator, and the load (N·m)."""
        ...

    def slope(self, y: np.ndarray) -> np.ndarray:
        """dy/dt."""
        ...

    def look(self, y: np.ndarray) -> tuple[complex, float, float, float]:
        """Current i_d + j i_q (A), electrical angle (rad), mechanical speed (rad/s), torque (N·m)."""
        ...


class Motulator:
    """motulator's Drive: VoltageSourceConverter, SynchronousMachine, stiff or two-mass mechanics."""

    holds_stator = True

    def __init__(self, machine: Machine, effects: Effects) -> None:
        from motulator.drive import model, utils

        m, p, e = machine, build(machine, effects), effect_values(effects)
        refuse("motulator", e, ("saturation_d", "saturation_q", "two_mass_shaft", *FRICTION))
        drop_d = e.get("saturation_d", {}).get("drop_at_rated", 0.0)
        drop_q = e.get("saturation_q", {}).get("drop_at_rated", 0.0)

        def axis(flux: float, inductance: float, drop: float) -> float:
            reference = (1.0 - drop) * inductance * m.i_rated
            return flux / inductance * (1.0 + drop / (1.0 - drop) * abs(flux / reference) ** EXPONENT)

        def currents(psi: complex) -> complex:
            return complex(axis(psi.real - m.psi_m, m.l_d, drop_d), axis(psi.imag, m.l_q, drop_q))

        pars = utils.SynchronousMachinePars(n_p=m.n_p, R_s=m.r_s, L_d=m.l_d, L_q=m.l_q, psi_f=m.psi_m)
        self.load = 0.0
        resistance = friction(p)
        if p.j_load > 0.0:
            shaft = utils.TwoMassMechanicalSystemPars(
                J_M=m.j - p.j_load, J_L=p.j_load, K_S=p.k_shaft, C_S=p.d_shaft, B_L=resistance
            )
            mechanics = model.TwoMassMechanicalSystem(shaft, tau_L=lambda _t: self.load)
        else:
            mechanics = model.StiffMechanicalSystem(J=m.j, B_L=resistance, tau_L=lambda _t: self.load)
        self.machine, self.v_dc = m, m.v_dc
        self.model = model.Drive(
            model.VoltageSourceConverter(u_dc=m.v_dc),
            model.SynchronousMachine(pars, i_s=currents if drop_d or drop_q else None),
            mechanics,
        )

    def start(self, theta_e: float) -> np.ndarray:
        self.model.machine.state.exp_j_theta_m = cmath.exp(1j * theta_e)
        self.model.mechanics.state.exp_j_theta_M = cmath.exp(1j * theta_e / self.machine.n_p)
        return np.array(self.model.get_initial_values(), dtype=complex)

    def apply(self, v_d: float, v_q: float, hold: float, tau_load: float) -> None:
        self.model.converter.inp.q_cs = complex(v_d, v_q) * cmath.exp(1j * hold) / self.v_dc
        self.load = tau_load

    def slope(self, y: np.ndarray) -> np.ndarray:
        return np.array(self.model.rhs(0.0, y.tolist()), dtype=complex)

    def look(self, y: np.ndarray) -> tuple[complex, float, float, float]:
        self.model.set_states(y.tolist())
        electrical, mechanical = self.model.machine, self.model.mechanics
        angle = cmath.phase(electrical.state.exp_j_theta_m)
        return complex(electrical.i_s), angle, float(mechanical.meas_speed()), float(electrical.tau_M)


class Gym:
    """gym-electric-motor's PermanentMagnetSynchronousMotor with its PolynomialStaticLoad."""

    holds_stator = False

    def __init__(self, machine: Machine, effects: Effects) -> None:
        from gym_electric_motor.physical_systems.electric_motors import PermanentMagnetSynchronousMotor
        from gym_electric_motor.physical_systems.mechanical_loads import PolynomialStaticLoad

        m, p, e = machine, build(machine, effects), effect_values(effects)
        refuse("gym-electric-motor", e, FRICTION)
        self.motor = PermanentMagnetSynchronousMotor(
            motor_parameter={"p": m.n_p, "l_d": m.l_d, "l_q": m.l_q, "r_s": m.r_s, "psi_p": m.psi_m}
            | {"j_rotor": 0.4 * m.j}
        )
        self.mechanics = PolynomialStaticLoad(
            load_parameter={"a": p.tau_c, "b": m.b, "c": p.drag, "j_load": 0.6 * m.j}
        )
        self.mechanics.set_j_rotor(0.4 * m.j)
        self.voltage, self.load = np.zeros(2), 0.0

    def start(self, theta_e: float) -> np.ndarray:
        return np.array([0.0, 0.0, 0.0, theta_e])

    def apply(self, v_d: float, v_q: float, hold: float, tau_load: float) -> None:
        self.voltage, self.load = np.array([v_d, v_q]), tau_load

    def slope(self, y: np.ndarray) -> np.ndarray:
        torque = self.motor.torque(y[1:4]) - self.load
        faster = self.mechanics.mechanical_ode(0.0, y[:1], torque)
        return np.concatenate([faster, self.motor.electrical_ode(y[1:4], self.voltage, y[0])])

    def look(self, y: np.ndarray) -> tuple[complex, float, float, float]:
        return complex(y[1], y[2]), float(y[3]), float(y[0]), float(self.motor.torque(y[1:4]))


FRICTION = ("coulomb_friction", "quadratic_drag")
MADE_BY: dict[str, Callable[[Machine, Effects], Equations]] = {
    "motulator": Motulator,
    "gym-electric-motor": Gym,
}


def refuse(simulator: str, effects: dict[str, Any], offered: tuple[str, ...]) -> None:
    """Raise ValueError where the simulator has no equation for an effect."""
    lacking = sorted(set(effects) - set(offered))
    if lacking:
        raise ValueError(
            f"{simulator} has no equations for {', '.join(lacking)}; it has {', '.join(offered)}"
        )


def friction(p: Parameters) -> Callable[[float], float]:
    """Torque over speed (N·m·s) at the absolute mechanical speed, as motulator wants it."""

    def over_speed(w: float) -> float:
        dry = math.tanh(w / p.w_smooth) / w if w > 1e-9 * p.w_smooth else 1.0 / p.w_smooth
        return p.b + p.drag * w + p.tau_c * dry

    return over_speed


def simulate_by(
    simulator: str,
    machine: Machine,
    effects: Effects,
    manoeuvre: Manoeuvre,
    *,
    seed: int,
    nameplate: Machine | None = None,
    substeps: int = SUBSTEPS,
) -> Run:
    """Run the drive of one of SIMULATORS through a manoeuvre, with the sensors and noise of `plant.simulate`.

    Of the truth i_a … i_c, theta_m (wrapped at a whole electrical turn), omega_m, tau_e, v_dc and what the
    sensors see are filled.  Raises KeyError for an unknown simulator, ValueError for effects it has no
    equations for or a manoeuvre that starts in motion, ImportError where it is not installed,
    RuntimeError where it diverges.
    """
    if manoeuvre.locked or manoeuvre.w_start != 0.0:
        raise ValueError("the other simulators start at rest and turn")
    equations = MADE_BY[simulator](machine, effects)
    p, gains = build(machine, effects).packed(), controller_gains(machine, nameplate or machine)
    n, t_s = len(manoeuvre.w_ref), 1.0 / machine.f_sample
    streams = [np.random.default_rng([seed, s]) for s in range(4)]
    noise_i = machine.noise_i * streams[0].standard_normal((n, 3))
    noise_w = machine.noise_w * streams[1].standard_normal(n)
    log, truth = np.zeros((n, len(LOG))), np.zeros((n, len(TRUTH)))
    integral, command, state, memory = np.zeros(3), np.zeros(2), np.zeros(N_STATES), np.zeros((2, 3))
    turns = np.exp(-2j * np.pi / 3.0 * np.arange(3))
    y = equations.start(float(streams[2].uniform(-np.pi, np.pi)))
    h = t_s / substeps
    for k in range(n):
        current, angle, w, torque = equations.look(y)
        if not math.isfinite(w) or abs(current) > RUNAWAY * machine.i_rated:
            raise RuntimeError(f"{simulator}: {machine.name} runs away at sample {k} of {n}")
        phases = (current * cmath.exp(1j * angle) * turns).real
        state[2], state[3] = angle / machine.n_p, w
        measure(
            state, phases, noise_i[k], noise_w[k], machine.lsb_i, machine.lsb_theta_e, t_s, p, memory, log[k],
            truth[k, 12:16],
        )  # fmt: skip
        log[k, 0], log[k, 1] = command
        truth[k, :3] = phases
        truth[k, 3:7] = angle / machine.n_p, w, torque, machine.v_dc
        hold = 0.0
        if equations.holds_stator:
            # angle expected in the middle of the interval, from the sample the command was computed from
            past = log[max(k - 1, 0)]
            hold, half = past[5] + 1.5 * t_s * past[6], 0.5 * t_s * past[6]
            log[k, :2] *= math.sin(half) / half if half != 0.0 else 1.0
        equations.apply(command[0], command[1], hold, float(manoeuvre.tau_load[k]))
        for _ in range(substeps):
            k1 = equations.slope(y)
            k2 = equations.slope(y + 0.5 * h * k1)
            k3 = equations.slope(y + 0.5 * h * k2)
            k4 = equations.slope(y + h * k3)
            y = y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        wanted = manoeuvre.w_ref[k], manoeuvre.i_d_ref[k], manoeuvre.i_q_add[k]
        control(log[k], *wanted, False, integral, gains, command)
    columns = {name: log[:, c].copy() for c, name in enumerate(LOG)}
    if manoeuvre.load == "measured":
        columns["tau_m"] = manoeuvre.tau_load + machine.noise_tau * streams[3].standard_normal(n)
    t = np.arange(n) / machine.f_sample
    return Run(t, columns, {name: truth[:, c].copy() for c, name in enumerate(TRUTH)})

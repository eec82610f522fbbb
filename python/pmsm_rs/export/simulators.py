"""The model for simulators that have models of their own: what they can express, and what they cannot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .common import header, not_expressed
from .program import LIBM, Language, code, needs

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ..model import Model

NUMPY = Language(
    functions={kind: f"np.{name}" for kind, name in LIBM.items()},
    select="np.where({test} > 0.0, {yes}, {no})",
    define="        {name} = {value}",
)
_FLUX_MAPS = ("saturation_d", "saturation_q", "cross_saturation")

_MOTULATOR = '''"""
{header}

Built on motulator 0.5 (github.com/Aalto-Electric-Drives/motulator): `machine()` and `mechanics()` are its own
models.
{left_out}
"""

import numpy as np
from motulator.drive import model
from motulator.drive.utils import SynchronousMachinePars

PARAMETERS = SynchronousMachinePars(n_p={n_p}, R_s={r_s!r}, L_d={l_d!r}, L_q={l_q!r}, psi_f={psi_m!r})
J, B = {j!r}, {b!r}
{flux}

def friction(w_M):
    """Friction and drag over the speed, N m/(rad/s): torque by speed, at the speed w_M >= 0 in rad/s."""
    omega_m = np.maximum(np.abs(w_M), 1e-9)
    with np.errstate(all="ignore"):
{friction}


def mechanics(tau_L=lambda t: 0 * t):
    """The rotor with its friction; `tau_L` is the load torque over time, N m."""
    return model.StiffMechanicalSystem(J=J, B_L=friction, tau_L=tau_L)
'''

_LINEAR = '''

def machine():
    """The motor with constant inductances."""
    return model.SynchronousMachine(PARAMETERS)

'''

_SATURATED = '''

def current(psi_s):
    """Stator current (A) of a stator flux linkage (V s), complex, in the rotor's frame."""
    lambda_d, lambda_q = np.real(psi_s), np.imag(psi_s)
    with np.errstate(all="ignore"):
{lines}
        return {i_d} + 1j * ({i_q})


def machine():
    """The motor with its flux map."""
    return model.SynchronousMachine(PARAMETERS, i_s=current, psi_s0=PARAMETERS.psi_f)

'''


def motulator(model: Model) -> tuple[str, list[str]]:
    """A Python module that makes motulator's machine and mechanics, and what they do not hold."""
    told = model.equations()
    base, torque = model.specification["base"], told["torque"]
    even = [name for name, _ in torque["outputs"] if _is_drag(torque, name)]
    maps = [name for name in _FLUX_MAPS if name in model.effects]
    left_out = _left_out(model, [*even, *maps], "motulator")
    flux = _LINEAR
    if maps:
        # The maps of these effects do not depend on the angle.
        written = code(
            told["flux"], NUMPY, {"lambda_d": "lambda_d", "lambda_q": "lambda_q", "theta_m": "0.0"}
        )
        flux = _SATURATED.format(
            lines="\n".join(written.lines), i_d=written.outputs["i_d"], i_q=written.outputs["i_q"]
        )
    names = {"omega_m": "omega_m", "theta_m": "0.0", "tau_e": "0.0", "t": "0.0"}
    written = code(torque, NUMPY, names)
    terms = " + ".join(f"({written.outputs[name]})" for name in even)
    friction = [*written.lines, f"        return B + ({terms or '0.0 * omega_m'}) / omega_m"]
    text = _MOTULATOR.format(
        header="\n".join(header(model)).replace("\\", "\\\\"),
        left_out="\n".join(left_out),
        n_p=int(told["n_p"]),
        flux=flux.rstrip() + "\n",
        friction="\n".join(friction),
        **{name: base[name] for name in ("r_s", "l_d", "l_q", "psi_m", "j", "b")},
    )
    return text, left_out


def gym_electric_motor(model: Model) -> tuple[str, list[str]]:
    """Parameters for gym-electric-motor's motor and polynomial load, and what they do not hold."""
    base, chosen = model.specification["base"], _chosen(model)
    known = [name for name in ("coulomb_friction", "quadratic_drag") if name in chosen]
    left_out = _left_out(model, known, "gym-electric-motor")
    tau_c = chosen.get("coulomb_friction", {}).get("tau_c", 0.0)
    drag = chosen.get("quadratic_drag", {}).get("k", 0.0)
    motor = {
        "p": int(model.specification["scales"]["n_p"]),
        "r_s": base["r_s"],
        "l_d": base["l_d"],
        "l_q": base["l_q"],
        "psi_p": base["psi_m"],
        "j_rotor": base["j"],
    }
    load = {"a": tau_c, "b": base["b"], "c": drag, "j_load": 1e-12}
    text = (
        f'"""\n{chr(10).join(header(model))}\n\n'
        "For gym-electric-motor 3 (github.com/upb-lea/gym-electric-motor):\n"
        "motor=dict(motor_parameter=MOTOR), load=PolynomialStaticLoad(load_parameter=LOAD).\n"
        f"{chr(10).join(left_out)}\n" + '"""\n\n'
        f"# SI units; the load is a + b*omega + c*omega^2 in N m.\nMOTOR = {motor!r}\nLOAD = {load!r}\n"
    )
    return text, left_out


def mujoco(model: Model) -> tuple[str, list[str]]:
    """MuJoCo XML of a hinge that the motor drives by its q current, and what it does not hold."""
    base, chosen, scales = model.specification["base"], _chosen(model), model.specification["scales"]
    known = [name for name in ("coulomb_friction",) if name in chosen]
    left_out = _left_out(model, known, "a MuJoCo joint")
    tau_c = chosen.get("coulomb_friction", {}).get("tau_c", 0.0)
    k_t = 1.5 * scales["n_p"] * base["psi_m"]
    left_out.append(
        "The actuator gives the torque of i_q with i_d = 0. "
        "Voltages, inductances and the reluctance torque are not in it."
    )
    # Two dashes would end a comment of XML.
    comment = [line.replace("--", "- -") for line in (*header(model), *left_out)]
    said = "\n".join(["<!--", *comment, "-->"])
    limit = repr(scales["i_max"])
    rotor = f'armature="{base["j"]!r}" damping="{base["b"]!r}" frictionloss="{tau_c!r}"'
    driven = f'gaintype="fixed" biastype="none" gainprm="{k_t!r}" ctrlrange="-{limit} {limit}"'
    text = f"""<mujoco model="motor">
{said}
  <option timestep="{min(scales["period"], 1e-3)!r}" integrator="RK4" gravity="0 0 0"/>
  <worldbody>
    <body name="rotor">
      <inertial pos="0 0 0" mass="1e-6" diaginertia="1e-12 1e-12 1e-12"/>
      <joint name="shaft" type="hinge" axis="0 0 1" {rotor}/>
    </body>
  </worldbody>
  <actuator>
    <!-- control: i_q in A; gain: 3/2 n_p psi_m in N m/A -->
    <general name="i_q" joint="shaft" {driven}/>
  </actuator>
  <sensor>
    <jointpos name="theta_m" joint="shaft"/>
    <jointvel name="omega_m" joint="shaft"/>
  </sensor>
</mujoco>
"""
    return text, left_out


def _chosen(model: Model) -> dict[str, Mapping[str, Any]]:
    return {entry["effect"]: entry["parameters"] for entry in model.specification["effects"]}


def _is_drag(program: Mapping[str, Any], name: str) -> bool:
    """Whether a torque depends on the speed alone, and is as large in either direction."""
    import numpy as np

    from .program import evaluate

    if needs(program, name) != {"omega_m"}:
        return False
    omega = np.array([1e-2, 1.0, 30.0, 300.0])
    rest = {"theta_m": 0.0, "tau_e": 0.0, "t": 0.0}
    forth, back = (evaluate(program, {"omega_m": sign * omega, **rest})[name] for sign in (1.0, -1.0))
    return bool(np.allclose(forth, -back, rtol=1e-9, atol=1e-300))


def _left_out(model: Model, known: Sequence[str], tool: str) -> list[str]:
    rest = not_expressed(model, known)
    return [f"{tool} cannot express, and this file does not hold: {', '.join(rest)}."] if rest else []

"""Forms of physics that the package's catalogue has no equation for, and what the plant makes of them.

Each form states where it comes from, in which equation it acts and over which variables.  Where the
contract's catalogue has a name for the form, or for a part of it, `accepted` lists that name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from .parameters import Machine

Numbers = Mapping[str, float]


@dataclass(frozen=True)
class Form:
    """One form.

    equations: as the answer's `located` names them, the main one first; over: variables of the remainder, as
    the answer's `remaining` names them; parameters with their defaults, strength zero; source: where the form
    comes from; plant: the plant's numbers from the parameters; accepted: names that are right for it.
    """

    equations: tuple[str, ...]
    over: tuple[str, ...]
    parameters: dict[str, float]
    source: str
    plant: Callable[[Machine, Numbers], dict[str, float]]
    accepted: tuple[str, ...] = ()


MOTION, VOLTAGE, SENSOR = ("mechanical",), ("q", "d"), ("sensor",)

FORMS: dict[str, Form] = {
    "x_tight_spot": Form(
        MOTION,
        ("theta_m",),
        {"tau": 0.0, "width": 0.3, "place": 1.0},
        "a rotor that rubs at one place: eccentric stator, dented bearing ring",
        lambda m, v: {"tau_rub": v["tau"], "width_rub": v["width"], "place_rub": v["place"]},
    ),
    "x_friction_hump": Form(
        MOTION,
        ("omega_e",),
        {"tau": 0.0, "w_hump": 60.0, "width": 15.0},
        "a seal or belt that is excited around one speed",
        lambda m, v: {"tau_hump": v["tau"], "w_hump": v["w_hump"], "width_hump": v["width"]},
    ),
    "x_eddy_brake": Form(
        MOTION,
        ("omega_e",),
        {"k": 0.0, "w_critical": 50.0},
        "eddy-current brake, k w/(1 + (w/w_c)^2): J. H. Wouterse, IEE Proc. B 138 (1991) 153",
        lambda m, v: {"k_eddy": v["k"], "w_eddy": v["w_critical"]},
    ),
    "x_root_friction": Form(
        MOTION,
        ("omega_e",),
        {"k": 0.0},
        "full-film lubrication whose friction grows with the root of the speed; the contract names it",
        lambda m, v: {"k_root": v["k"]},
        ("concave_friction",),
    ),
    "x_dahl_presliding": Form(
        MOTION,
        ("omega_e", "theta_m"),
        {"tau_c": 0.0, "theta_0": 0.02},
        "P. R. Dahl, Aerospace Corp. TOR-0158 (1968): a spring that begins to slide; the contract names it",
        lambda m, v: {"tau_dahl": v["tau_c"], "theta_dahl": v["theta_0"]},
        ("presliding_friction",),
    ),
    "x_backlash": Form(
        MOTION,
        ("theta_m", "omega_e"),
        {"gap": 0.0, "load_share": 0.4, "f_contact": 150.0, "damping": 0.1},
        "play of a coupling, dead-zone model: M. Nordin, P.-O. Gutman, Automatica 38 (2002) 1633; the "
        "contract names it",
        lambda m, v: _backlash(m, v),
        ("backlash",),
    ),
    "x_cam_load": Form(
        MOTION,
        ("theta_m",),
        {"tau": 0.0, "width": 0.8, "place": 1.0},
        "a cam or punch that loads part of each turn; its harmonics are loads periodic in the turn, too",
        lambda m, v: {"tau_cam": v["tau"], "width_cam": v["width"], "place_cam": v["place"]},
        ("load_torque_pulsation", "cogging_torque"),
    ),
    "x_angle_friction": Form(
        MOTION,
        ("theta_m", "omega_e"),
        {"tau": 0.0, "phase": 0.0},
        "a bent shaft in its seal, dry friction times 1 + cos: its mean is Coulomb friction",
        lambda m, v: {"tau_lean": v["tau"], "phase_lean": v["phase"]},
        ("coulomb_friction",),
    ),
    "x_gear_mesh": Form(
        MOTION,
        ("theta_m", "tau_e"),
        {"mu": 0.0, "teeth": 9.0, "phase": 0.0},
        "teeth whose sliding reverses at the pitch point: M. Vaishya, R. Singh, J. Sound Vib. 248 (2001) 671",
        lambda m, v: {"mu_mesh": v["mu"], "teeth": v["teeth"], "phase_mesh": v["phase"]},
    ),
    "x_weak_leg": Form(
        VOLTAGE,
        ("theta_e", "v_d", "v_q"),
        {"loss_rel": 0.0},
        "an inverter leg whose voltage falls short by a share: a tired gate driver",
        lambda m, v: {"leg_loss": v["loss_rel"]},
    ),
    "x_loose_terminal": Form(
        VOLTAGE,
        ("t", "i_q", "i_d"),
        {"r_extra": 0.0, "f": 7.0},
        "a terminal of phase a that rattles",
        lambda m, v: {"r_loose": v["r_extra"], "f_loose": v["f"]},
    ),
    "x_sleeve_current": Form(
        ("d", "q"),
        ("i_d", "i_q", "v_d", "v_q"),
        {"l_rel": 0.0, "tau_rel": 8.0},
        "eddy currents in a magnet sleeve, an R-L branch on the rotor's d and q flux as a damper winding: "
        "Krause, Analysis of Electric Machinery, 3rd ed., ch. 5",
        lambda m, v: _sleeve(m, v),
    ),
    "x_rectifier_ripple": Form(
        VOLTAGE,
        ("t", "v_d", "v_q"),
        {"ripple_rel": 0.0, "f": 300.0},
        "DC link behind a rectifier with a small capacitor: twice or six times the line frequency",
        lambda m, v: {"ripple": v["ripple_rel"], "f_ripple": v["f"]},
    ),
    "x_flux_hysteresis": Form(
        ("d", "q"),
        ("omega_e", "theta_e", "i_d", "i_q"),
        {"i_rel": 0.0, "flux_rel": 0.3},
        "hysteresis of the flux as dry friction of its walls (Bergqvist, Physica B 233 (1997) 342); the "
        "contract counts it to the iron's loss",
        lambda m, v: {"i_hyst": v["i_rel"] * m.i_rated, "flux_hyst": v["flux_rel"] * m.psi_m},
        ("iron_loss",),
    ),
    "x_current_lag": Form(
        SENSOR,
        ("omega_e", "i_d", "i_q"),
        {"lag": 0.0},
        "first-order filter in front of the converters of the phase currents",
        lambda m, v: {"lag_i": v["lag"]},
    ),
    "x_converter_skew": Form(
        SENSOR,
        ("theta_e", "omega_e", "i_d", "i_q"),
        {"skew": 0.0},
        "one converter that samples phases a, b, c one after another",
        lambda m, v: {"skew_i": v["skew"]},
    ),
    "x_sensor_bow": Form(
        SENSOR,
        ("theta_e", "i_d", "i_q"),
        {"loss_at_rated": 0.0},
        "current sensors whose core begins to saturate: a cubic characteristic",
        lambda m, v: {"bow_i": v["loss_at_rated"] / m.i_rated**2},
    ),
    "x_late_angle": Form(
        SENSOR,
        ("omega_e", "i_d", "i_q"),
        {"t_rated": 0.0},
        "a tracking converter of a resolver that is later the faster it turns",
        lambda m, v: {"late": v["t_rated"] / m.w_rated},
    ),
    "x_disc_flaw": Form(
        SENSOR,
        ("theta_m",),
        {"amplitude_el_rad": 0.0, "width": 0.4, "place": 1.0},
        "a scratch or dirt on part of the encoder's disc",
        lambda m, v: {"flaw": v["amplitude_el_rad"], "width_flaw": v["width"], "place_flaw": v["place"]},
    ),
}


def _sleeve(m: Machine, v: Numbers) -> dict[str, float]:
    """l_rel: 1/leakage of the sleeve in units of 1/l_d, so that zero is no sleeve; tau_rel in samples."""
    if v["l_rel"] == 0.0:
        return {}
    l_sleeve = m.l_d / v["l_rel"]
    return {"l_sleeve": l_sleeve, "r_sleeve": l_sleeve * m.f_sample / v["tau_rel"]}


def _backlash(m: Machine, v: Numbers) -> dict[str, float]:
    """A load behind the gap with its share of the inertia; f_contact is that of the load on its contact."""
    if v["gap"] == 0.0:
        return {}
    j_load, w = v["load_share"] * m.j, 2.0 * 3.141592653589793 * v["f_contact"]
    return {
        "gap": v["gap"],
        "j_load": j_load,
        "k_shaft": j_load * w * w,
        "d_shaft": 2.0 * v["damping"] * j_load * w,
    }

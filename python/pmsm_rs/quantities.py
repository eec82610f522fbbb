"""The canonical columns of a recording, and the names under which other tools log them."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Final, NamedTuple


class Quantity(NamedTuple):
    """Dimension (a key of units.UNITS), the unit assumed for the canonical name, and the meaning."""

    dimension: str
    unit: str
    meaning: str


CANONICAL: Final[dict[str, Quantity]] = {
    "t": Quantity("time", "s", "sample time"),
    "v_d": Quantity("voltage", "V", "commanded voltage, d axis"),
    "v_q": Quantity("voltage", "V", "commanded voltage, q axis"),
    "v_a": Quantity("voltage", "V", "voltage of phase a"),
    "v_b": Quantity("voltage", "V", "voltage of phase b"),
    "v_c": Quantity("voltage", "V", "voltage of phase c"),
    "i_a": Quantity("current", "A", "current of phase a"),
    "i_b": Quantity("current", "A", "current of phase b"),
    "i_c": Quantity("current", "A", "current of phase c"),
    "i_d": Quantity("current", "A", "current, d axis"),
    "i_q": Quantity("current", "A", "current, q axis"),
    "theta_e": Quantity("angle", "rad", "electrical rotor angle"),
    "theta_m": Quantity("angle", "rad", "mechanical rotor angle"),
    "omega_e": Quantity("speed", "rad/s", "electrical speed"),
    "omega_m": Quantity("speed", "rad/s", "mechanical speed"),
    "n": Quantity("speed", "rpm", "mechanical speed in rpm"),
    "tau_m": Quantity("torque", "N·m", "measured load torque, opposing positive speed"),
    "tau_e": Quantity("torque", "N·m", "motor torque"),
    "v_dc": Quantity("voltage", "V", "DC-link voltage"),
    "temperature": Quantity("temperature", "°C", "winding temperature"),
    "temperature_magnet": Quantity("temperature", "°C", "magnet temperature"),
}
"""Columns of a recording in the order in which they are listed to users."""

# Names that mean one quantity wherever they are used. The flag says that the SI unit may be assumed where
# none is
# stated: nobody logs i_d in mA without saying so, but angles, speeds and times come in every unit.
_ALIASES: Final[dict[str, tuple[str, bool]]] = {
    **{name: ("t", False) for name in ("t", "time", "x_axis", "timestamp", "zeit", "source")},
    **{
        name: ("i_d", True)
        for name in ("id", "i_d", "isd", "i_sd", "d_axis_current", "current_d", "d_current")
    },
    **{
        name: ("i_q", True)
        for name in ("iq", "i_q", "isq", "i_sq", "q_axis_current", "current_q", "q_current")
    },
    **{
        name: ("v_d", True)
        for name in ("vd", "v_d", "ud", "u_d", "usd", "u_sd", "d_axis_voltage", "voltage_d")
    },
    **{
        name: ("v_q", True)
        for name in ("vq", "v_q", "uq", "u_q", "usq", "u_sq", "q_axis_voltage", "voltage_q")
    },
    **{name: ("i_a", True) for name in ("ia", "i_a", "iu", "i_u", "phase_a_current", "current_a")},
    **{name: ("i_b", True) for name in ("ib", "i_b", "iv", "i_v", "phase_b_current", "current_b")},
    **{name: ("i_c", True) for name in ("ic", "i_c", "iw", "i_w", "phase_c_current", "current_c")},
    **{name: ("v_a", True) for name in ("v_a", "u_a")},
    **{name: ("v_b", True) for name in ("v_b", "u_b")},
    **{name: ("v_c", True) for name in ("v_c", "u_c")},
    **{
        name: ("theta_e", False) for name in ("theta_e", "theta_el", "electrical_angle", "angle_el", "phi_el")
    },
    **{
        name: ("theta_m", False)
        for name in ("theta_m", "theta_mech", "mechanical_angle", "angle_mech", "phi_mech")
    },
    **{name: ("omega_e", False) for name in ("omega_e", "omega_el", "electrical_speed", "w_el")},
    **{name: ("omega_m", False) for name in ("omega_m", "omega_mech", "mechanical_speed", "w_mech")},
    **{name: ("tau_m", False) for name in ("tau_m", "tau_load", "load_torque", "torque_load")},
    **{name: ("tau_e", False) for name in ("tau_e", "electromagnetic_torque", "airgap_torque")},
    **{
        name: ("v_dc", True)
        for name in ("v_dc", "vdc", "u_dc", "udc", "dc_link_voltage", "bus_voltage", "vbus")
    },
    **{
        name: ("temperature", False) for name in ("temperature", "winding_temperature", "temperature_winding")
    },
    **{name: ("temperature_magnet", False) for name in ("temperature_magnet", "magnet_temperature")},
}

# Whole logs with documented units: (a name that only this tool writes, name -> (canonical, unit)).
# VESC Tool logs (vedderb/vesc_tool, vescinterface.cpp); moteus telemetry (mjbots/moteus, docs/reference.md).
LOGS: Final[dict[str, tuple[frozenset[str], dict[str, tuple[str, str]]]]] = {
    "VESC": (
        frozenset({"d_axis_current", "erpm"}),
        {
            "ms_today": ("t", "ms"),
            "d_axis_current": ("i_d", "A"),
            "q_axis_current": ("i_q", "A"),
            "d_axis_voltage": ("v_d", "V"),
            "q_axis_voltage": ("v_q", "V"),
            "erpm": ("omega_e", "rpm"),
            "input_voltage": ("v_dc", "V"),
            "temp_motor": ("temperature", "°C"),
        },
    ),
    "moteus": (
        frozenset({"d_a", "q_a", "velocity"}),
        {
            "d_a": ("i_d", "A"),
            "q_a": ("i_q", "A"),
            "velocity": ("omega_m", "Hz"),
            "position": ("theta_m", "rev"),
            "electrical_theta": ("theta_e", "rad"),
            "bus_v": ("v_dc", "V"),
            "motor_temp_c": ("temperature", "°C"),
        },
    ),
}

# Names that mean one of several quantities: which ones, so that the refusal can say how to settle it.
DOUBTFUL: Final[dict[str, tuple[str, ...]]] = {
    **{
        name: ("theta_e", "theta_m")
        for name in ("theta", "angle", "position", "phi", "rotor_angle", "rotor_position")
    },
    **{
        name: ("omega_e", "omega_m")
        for name in ("speed", "omega", "velocity", "w", "motor_speed", "rotor_speed")
    },
}

MECHANICAL_RPM: Final = frozenset({"n", "rpm", "speed", "motor_speed", "rotor_speed", "n_rpm", "velocity"})
"""Names that, in rpm, are always the speed of the shaft."""


@lru_cache(maxsize=1024)
def normal(name: str) -> str:
    """A name in lower case with single underscores, without a log's own prefix such as `servo_stats.`."""
    last = name.rsplit(".", 1)[-1] if re.match(r"^[A-Za-z_]+\.[A-Za-z_]", name) else name
    return re.sub(r"[^a-z0-9]+", "_", last.strip().lower()).strip("_")


def alias(name: str) -> tuple[str, bool] | None:
    """The canonical column that a normalised name means, and whether its SI unit may be assumed."""
    return _ALIASES.get(name)

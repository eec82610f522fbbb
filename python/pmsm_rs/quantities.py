"""The canonical columns of a recording, and the logs of other tools whose names are documented."""

from __future__ import annotations

import re
from collections.abc import Iterable
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


def ordered(names: Iterable[str]) -> list[str]:
    """Those of the canonical `names`, in their order."""
    given = {*names}
    return [name for name in CANONICAL if name in given]


TEMPERATURES: Final[dict[str, str]] = {
    **dict.fromkeys(("temperature", "winding_temperature", "temperature_winding"), "temperature"),
    **dict.fromkeys(("temperature_magnet", "magnet_temperature"), "temperature_magnet"),
}
"""Normalised names of temperatures; a drive logs many, of which these are the motor's."""

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


@lru_cache(maxsize=1024)
def normal(name: str) -> str:
    """A name in lower case with single underscores, without a log's own prefix such as `servo_stats.`."""
    last = name.rsplit(".", 1)[-1] if re.match(r"^[A-Za-z_]+\.[A-Za-z_]", name) else name
    return re.sub(r"[^a-z0-9]+", "_", last.strip().lower()).strip("_")

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
    **dict.fromkeys(("wicklungstemperatur", "temperatur_wicklung"), "temperature"),
    **dict.fromkeys(("temperature_magnet", "magnet_temperature"), "temperature_magnet"),
    **dict.fromkeys(("magnettemperatur", "temperatur_magnet"), "temperature_magnet"),
}
"""Normalised names of temperatures; a drive logs many, of which these are the motor's."""

_ODRIVE: Final[dict[str, tuple[str, str | None]]] = {
    "iq_measured": ("i_q", "A"),
    "id_measured": ("i_d", "A"),
    "vq_setpoint": ("v_q", "V"),
    "vd_setpoint": ("v_d", "V"),
    "vel_estimate": ("omega_m", "Hz"),
    "pos_estimate": ("theta_m", "rev"),
    "pos_vel_mapper_vel": ("omega_m", "Hz"),
    "pos_vel_mapper_pos_rel": ("theta_m", "rev"),
    "encoder_phase": ("theta_e", "rad"),
    "vbus_voltage": ("v_dc", "V"),
}

# Whole logs with documented units: (a name that only this tool writes, name -> (canonical, unit)).
# VESC Tool logs (vedderb/vesc_tool, vescinterface.cpp); moteus telemetry (mjbots/moteus, docs/reference.md);
# ODrive properties (docs.odriverobotics.com, API reference, from firmware 0.5 on in turns); the monitor of
# SimpleFOC (docs.simplefoc.com/monitoring), which prints currents in mA, while own code often logs A.
LOGS: Final[dict[str, tuple[frozenset[str], dict[str, tuple[str, str | None]]]]] = {
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
            "d_v": ("v_d", "V"),
            "q_v": ("v_q", "V"),
            "velocity": ("omega_m", "Hz"),
            "position": ("theta_m", "rev"),
            "electrical_theta": ("theta_e", "rad"),
            "bus_v": ("v_dc", "V"),
            "motor_temp_c": ("temperature", "°C"),
        },
    ),
    "ODrive": (frozenset({"iq_measured", "vel_estimate"}), _ODRIVE),
    "ODrive 0.6": (frozenset({"iq_measured", "pos_vel_mapper_vel"}), _ODRIVE),
    "SimpleFOC": (
        frozenset({"target", "voltage_q", "velocity", "angle"}),
        {
            "voltage_q": ("v_q", "V"),
            "voltage_d": ("v_d", "V"),
            "current_q": ("i_q", None),
            "current_d": ("i_d", None),
            "velocity": ("omega_m", "rad/s"),
            "angle": ("theta_m", "rad"),
        },
    ),
}
"""Per tool the names that only its logs have, and what others of its names are, with the unit, None where
that is asked.
"""


_PREFIXED: Final = re.compile(r"[A-Za-z_]+\.[A-Za-z_]")
_BETWEEN_WORDS: Final = re.compile(r"[^a-z0-9]+")


@lru_cache(maxsize=1024)
def normal(name: str) -> str:
    """A name in lower case with single underscores, without a log's own prefix such as `servo_stats.`."""
    last = name.rsplit(".", 1)[-1] if _PREFIXED.match(name) else name
    return _BETWEEN_WORDS.sub("_", last.strip().lower()).strip("_")


@lru_cache(maxsize=1024)
def spellings(name: str) -> tuple[str, ...]:
    """The ways in which LOGS may have a name, in lower case with single underscores.

    The first is the whole of it, the next lack the parts that points set off in front, such as `axis0.`.
    """
    parts = name.strip().lower().split(".")
    ways = (".".join(parts[k:]) for k in range(len(parts)))
    return tuple(_BETWEEN_WORDS.sub("_", way).strip("_") for way in ways)

"""Mistakes with which a log is made: what they do to its columns, and which findings tell them.

The log has v_d, v_q in V, the phase currents or i_d, i_q in A, theta_e in rad and omega_e in rad/s.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .limits import in_axes

Log = dict[str, np.ndarray]
# column -> the column whose values it has, and the factor on them
Held = dict[str, tuple[str, float]]

CURRENTS, AXES, VOLTAGES = ("i_a", "i_b", "i_c"), ("i_d", "i_q"), ("v_d", "v_q")
TURN = ("theta_e", "omega_e")


@dataclass(frozen=True)
class Mistake:
    """One mistake, and what tells it.

    axes: the log has i_d and i_q in place of the phase currents; columns: what columns hold in place of their
    own values; turned: rad by which theta_e is too large; ahead: rows by which it is ahead; late: columns
    that are `rows` rows late; without: columns that the log lacks; poles: factor on n_p in the machine file.
    words: mistakes that the tool may say; findings: a code, and parts of the text of such a finding; effects:
    names of effects.  Any one of these tells the mistake.  why: the reason where these are equivalents.
    """

    words: tuple[str, ...] = ()
    findings: tuple[tuple[str, ...], ...] = ()
    effects: tuple[str, ...] = ()
    why: str = ""
    axes: bool = False
    columns: Held = field(default_factory=dict)
    turned: float = 0.0
    ahead: float = 0.0
    late: tuple[str, ...] = ()
    rows: int = 0
    without: tuple[str, ...] = ()
    poles: int = 1


def made(log: Mapping[str, np.ndarray], mistake: Mistake) -> Log:
    """The log, columns (n,), as it is with the mistake; shorter by the rows by which columns are late."""
    true = in_axes(dict(log)) if mistake.axes else dict(log)
    out = true | {name: factor * true[source] for name, (source, factor) in mistake.columns.items()}
    if mistake.turned or mistake.ahead:
        step = float(np.median(np.diff(true["t"])))
        angle = true["theta_e"] + mistake.turned + mistake.ahead * step * true["omega_e"]
        out["theta_e"] = angle - 2.0 * math.pi * np.rint(angle / (2.0 * math.pi))
    last = len(true["t"]) - mistake.rows
    late = {name: out[name][:last] for name in mistake.late}
    return {name: late.get(name, x[mistake.rows :]) for name, x in out.items() if name not in mistake.without}


def swapped(one: str, other: str) -> Held:
    """Two columns interchanged."""
    return {one: (other, 1.0), other: (one, 1.0)}


def times(names: tuple[str, ...], factor: float) -> Held:
    """Columns multiplied."""
    return {name: (name, factor) for name in names}


def negative(*names: str) -> str:
    """The tool's words for columns of the wrong sign."""
    return f"{' and '.join(names)} had the opposite sign"


# findings and refusals by their codes
TORQUE_SIGN = ("PR202", "opposite sign against the acceleration")
AGAINST_SPEED = ("PR111", "theta_e turns against omega_e")
PHASES_BACK = ("PR115", "phase currents turn back twice as fast")
SPEED_LATE = ("PR224", "late, as the angle shows")
HELD_IN_STATOR = ("PR223", "the vector that is held")
OFFSET = "encoder_angle_offset"

BOTH_TURNED = "-v and -i cannot be told apart: with both, the magnet's axis points the other way. 180° is -i."
TWO_PHASES = "Any two interchanged phases turn the currents backwards, seen from row to row."
AN_OFFSET = "It is the effect encoder_angle_offset."
SENSE = "The other sense of rotation is the other direction of the q-axis, and of the torque."


def interchanged_phases(one: str, other: str) -> Mistake:
    """Two phase currents interchanged."""
    words = (f"{one} and {other} were interchanged",)
    return Mistake(words, (PHASES_BACK,), columns=swapped(one, other), why=TWO_PHASES)


def of_sign(*names: str, **more: Any) -> Mistake:
    """One column, or several, of the wrong sign."""
    return Mistake((negative(*names),), columns=times(names, -1.0), **more)


def turned_angle(degrees: int) -> Mistake:
    """An angle that is too large by so many degrees."""
    words = (f"theta_e was {abs(degrees)}° too {'large' if degrees > 0 else 'small'}",)
    return Mistake(words, effects=(OFFSET,), why=AN_OFFSET, turned=math.radians(degrees))


def scaled(names: tuple[str, ...], square: float, what: str) -> Mistake:
    """Columns in another scale, whose square is given.

    what: voltages, currents or both; currents are those of the axes.
    """
    larger = square > 1.0
    root = f"√{max(square, 1.0 / square):g}"
    both = what == "currents and voltages"
    words = f"{what if both else f'the {what}'} were {root} times too {'large' if larger else 'small'}"
    scale = f"the scale of {'both' if both else 'the'} {what}"
    convention = root.replace("√1.5", "√(3/2)")
    logged = "voltages and currents" if both else what
    size = f"{convention} times as large" if larger else f"divided by {convention}"
    return Mistake(
        (words,),
        (("PR204", scale, f"may be {root},"), ("PR212", f"the {logged} were logged {size}")),
        axes="i_d" in names,
        columns=times(names, math.sqrt(square)),
        why="The values against the nameplate tell the same scale.",
    )


def mistakes(n_p: int, v_dc: float) -> dict[str, Mistake]:
    """All mistakes by name, for a machine with n_p pole pairs at a link of v_dc in V."""
    all_i, all_v, half_turn = negative("all currents"), negative("all voltages"), "theta_e was 180° too large"
    reversed_i = (all_i, all_v, half_turn)
    return {
        "swapped-v_d-v_q": Mistake(("v_d and v_q were interchanged",), columns=swapped("v_d", "v_q")),
        "swapped-i_d-i_q": Mistake(
            ("i_d and i_q were interchanged",), axes=True, columns=swapped("i_d", "i_q")
        ),
        "swapped-i_a-i_b": interchanged_phases("i_a", "i_b"),
        "swapped-i_b-i_c": interchanged_phases("i_b", "i_c"),
        "phases-c-a-b": Mistake(
            (
                "the currents of the phases c, a, b were in the columns of a, b, c",
                "theta_e was 120° too small",
            ),
            columns={"i_a": ("i_c", 1.0), "i_b": ("i_a", 1.0), "i_c": ("i_b", 1.0)},
            effects=(OFFSET,),
            why="Only the phase currents are seen through the angle, and a third of a turn of it is a phase.",
        ),
        "minus-i": Mistake(reversed_i, (TORQUE_SIGN,), (OFFSET,), BOTH_TURNED, columns=times(CURRENTS, -1.0)),
        "minus-v": Mistake(reversed_i, (), (OFFSET,), BOTH_TURNED, columns=times(VOLTAGES, -1.0)),
        "minus-i_b": of_sign("i_b"),
        "minus-i_q": of_sign(
            "i_q", axes=True, findings=(TORQUE_SIGN,), why="The torque is that of i_q, and has its sign."
        ),
        "minus-v_q": of_sign("v_q"),
        "minus-i_d": of_sign("i_d", axes=True),
        "minus-v_d": of_sign("v_d"),
        "angle+30": turned_angle(30),
        "angle-60": turned_angle(-60),
        "angle+90": turned_angle(90),
        "angle+180": Mistake(reversed_i, (TORQUE_SIGN,), (OFFSET,), BOTH_TURNED, turned=math.pi),
        "angle-half-a-row-ahead": Mistake(
            (),
            (SPEED_LATE, HELD_IN_STATOR),
            ("encoder_delay", "voltage_delay"),
            "Beside such an angle the speed is half a row late. The voltages act half a row late, too, "
            "as those do that the stator holds.",
            ahead=0.5,
        ),
        "v-times-root-1.5": scaled(VOLTAGES, 1.5, "voltages"),
        "i-times-root-1.5": scaled(AXES, 1.5, "currents"),
        "both-times-root-1.5": scaled((*AXES, *VOLTAGES), 1.5, "currents and voltages"),
        "i-rms": scaled(AXES, 0.5, "currents"),
        "v-times-root-3": scaled(VOLTAGES, 3.0, "voltages"),
        "v-as-modulation-index": Mistake(
            (),
            (
                ("PR212", "the voltages were logged", "as a duty cycle is"),
                ("PR204", "the scale of the voltages", "/v_dc, as"),
                ("PR201", "the voltages were", "times too small", "/v_dc, as"),
            ),
            why="Indices of one voltage differ by less than a nameplate may be off.",
            columns=times(VOLTAGES, 2.0 / v_dc),
        ),
        "backwards-axes": Mistake(
            (negative("the angle and the speed"), negative("i_q", "v_q")),
            (TORQUE_SIGN,),
            why=SENSE,
            axes=True,
            columns=times(TURN, -1.0),
        ),
        "backwards-phases": Mistake(
            (negative("the angle and the speed"),),
            (PHASES_BACK,),
            why="The refusal names the sense of angle and speed beside the order of the phases.",
            columns=times(TURN, -1.0),
        ),
        "minus-speed": Mistake((), (AGAINST_SPEED,), columns=times(("omega_e",), -1.0)),
        "speed-in-rpm": Mistake(
            ("the speed was in rpm and not in rad/s",),
            axes=True,
            columns=times(("omega_e",), 30.0 / math.pi),
            without=("theta_e",),
        ),
        "i-3-rows-late": Mistake(
            ("the currents were logged 3 rows late", "the voltages were logged 3 rows early"),
            effects=("voltage_delay",),
            why="Currents that are logged late and voltages that act late are one shift against each other.",
            late=CURRENTS,
            rows=3,
        ),
        "v-1-row-late": Mistake(("the voltages were logged one row late",), late=VOLTAGES, rows=1),
        "n_p-times-2": Mistake(
            (f"n_p was {n_p} and not {2 * n_p}",),
            (("PR204", "the number of pole pairs n_p", "poles stand to pole pairs"),),
            why="The inertia against the nameplate tells the same number.",
            poles=2,
        ),
    }

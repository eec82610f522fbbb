"""The words of which column names are made, in English, German and the Latin letters of textbooks.

A name is read word by word (see `naming`): a quantity, an axis or phase, a frame, and what was done to the
signal. Only a name whose every word is known here is taken without asking.
"""

from __future__ import annotations

from typing import Final


def _words(text: str, meaning: str) -> dict[str, str]:
    return dict.fromkeys(text.split(), meaning)


def _set(text: str) -> frozenset[str]:
    return frozenset(text.split())


QUANTITIES: Final[dict[str, str]] = {
    **_words("voltage voltages volt volts spannung spannungen", "voltage"),
    **_words("current currents curr cur strom stroeme", "current"),
    **_words("angle ang winkel theta phi position pos lage", "angle"),
    **_words("speed spd velocity vel velo omega drehzahl geschwindigkeit winkelgeschwindigkeit rpm", "speed"),
    **_words("frequency freq frequenz", "frequency"),
    **_words("torque trq moment drehmoment tau", "torque"),
}
"""Words for a quantity."""

AXES: Final[dict[str, str]] = {
    **{axis: axis for axis in "dqabc"},
    **{"u": "a", "v": "b", "w": "c"},
    # The s of the stator stands before the axis or behind it.
    **{name: axis for axis in "dqabc" for name in (f"s{axis}", f"{axis}s") if name != "as"},
    **_words("direct laengs daxis", "d"),
    **_words("quadrature quer qaxis", "q"),
    **_words("alpha alfa", "alpha"),
    **_words("beta", "beta"),
}
"""Axes and phases."""
BETWEEN: Final = frozenset({"ab", "bc", "ca", "uv", "vw", "wu", "ac", "ba", "cb", "uw", "vu", "wv"})
"""Two phases: a voltage between them is the voltage of none."""

SYMBOLS: Final[dict[str, tuple[str, str]]] = {
    f"{letter}{written}": (quantity, axis)
    for letter, quantity in (("u", "voltage"), ("v", "voltage"), ("i", "current"))
    for written, axis in (*AXES.items(), ("as", "a"))
    if len(written) < 3 or written in {"alpha", "beta"}
    # `uv` and `vw` are voltages between two phases.
    if letter == "i" or written not in {"u", "v", "w"}
}
"""Symbols of one word: quantity, and axis or phase."""

VECTORS: Final[dict[str, str]] = {
    **_words("vdq udq vqd uqd vabc uabc vab valphabeta ualphabeta", "voltage"),
    **_words("idq iqd iabc iab ialphabeta", "current"),
}
"""Vectors, of which another word names the component."""

LETTERS: Final = {"u": "voltage", "v": "voltage", "i": "current"}
"""Letters that are a quantity where an axis or phase comes behind them."""

FRAMED: Final[dict[str, tuple[str, str]]] = {
    **dict.fromkeys(("we", "wel", "wre", "erpm"), ("speed", "e")),
    **dict.fromkeys(("wm", "wrm", "wmech", "nmech", "nmot"), ("speed", "m")),
    **dict.fromkeys(("w", "wr", "n", "nr"), ("speed", "")),
    **dict.fromkeys(("th", "thr"), ("angle", "")),
}
"""Symbols of speed and angle: quantity, and the frame where the symbol says it."""

DC: Final = frozenset({"vdc", "udc", "vbus", "ubus", "uzk", "vzk", "vdclink", "udclink"})
"""The DC-link voltage in one word."""
DC_WORDS: Final = frozenset({"dc", "bus", "zk", "zwischenkreis", "dclink"})
"""The DC link beside a voltage."""

FRAMES: Final[dict[str, str]] = {
    **_words("e el elec electric electrical elektrisch elektrische elektrischer re", "e"),
    **_words("m mech mechanical mechanic mechanisch mechanische mechanischer shaft welle wellen rm", "m"),
}
"""Whether an angle or speed is electrical or mechanical."""

COMMANDED, MEASURED, FILTERED, ESTIMATED = "commanded", "measured", "filtered", "estimated"
ROLES: Final[dict[str, str]] = {
    **_words(
        "ref refs reference cmd cmds command commanded set setpoint soll sollwert target tgt demand "
        "demanded dem des desired req request requested star goal vorgabe",
        COMMANDED,
    ),
    **_words(
        "meas measured measurement ist istwert act actual fb fbk fdb feedback sensed sensor gemessen mess "
        "messwert",
        MEASURED,
    ),
    **_words(
        "filt filtered filter flt lpf lp smooth smoothed avg average mean gefiltert mittelwert", FILTERED
    ),
    **_words(
        "est estimate estimated estimation obs observer observed hat pll smo calc calculated predicted "
        "geschaetzt beobachter",
        ESTIMATED,
    ),
}
"""What was done to the signal."""

SUPPLY: Final = _set(
    "battery batt bat supply source input mains netz versorgung vin vbat vsupply ibus idc iin ibat"
)
"""The supply of the drive, which is no quantity of the motor."""
DC_SUPPLY: Final = _set("battery batt bat supply source input versorgung")
"""The supply beside a voltage, which may be that of the DC link."""
OTHER: Final = SUPPLY | _set(
    "err error diff dev deviation delta fehler abweichung max min limit lim rated nominal nenn peak "
    "offset gain kp ki kd integral integrator ff feedforward decoupling std variance status flag fault mode "
    "state index counter crc hours ripple bemf emf flux psi power accel acceleration beschleunigung jerk "
    "inertia resistance inductance efficiency temp temperature temperatur pwm duty carrier switching "
    "sampling meters"
)
"""Words that make of a name another quantity, such as a control error, a limit or a supply."""

NEUTRAL: Final = _set(
    "motor mot mtr machine rotor stator foc ctrl control controller drive inverter inv servo axis "
    "achse phase phases phasen ph value val wert data sig signal log of the at circuit component root "
    "var vars motorvars dq abc angular rotational encoder enc resolver hall pmsm gm point odrv strang "
    "winding wicklung link"
)
"""Words that say nothing more about the quantity."""
NEUTRAL_FOR: Final[dict[str, frozenset[str]]] = {
    # Of the stator, and of the rotor; s of a speed is that of the field, r of a current that of a cage.
    "voltage": frozenset({"s", "out", "output", "terminal", "klemme"}),
    "current": frozenset({"s", "in"}),
    "torque": frozenset({"out", "output"}),
    "angle": frozenset({"r"}),
    "speed": frozenset({"r"}),
}
"""Words that say nothing more beside one quantity."""
TYPES: Final = frozenset({"f", "lr", "fl"})
"""Letters in front of a name that tell the type of a variable, as in `fActVelo`."""
NUMBERED: Final = frozenset({"axis", "motor", "m", "odrv", "servo", "drive", "inverter", "achse"})
"""Words behind which a number tells one device from another."""

LOAD: Final = frozenset({"load", "last", "l"})
"""Beside a torque: that of the load."""
AIRGAP: Final = frozenset({"electromagnetic", "airgap", "luftspalt", "em"})
"""Beside a torque: that of the motor, before friction."""
TORQUE_FORMING: Final[dict[str, str]] = {
    **_words("torque moment drehmoment momentbildend momentbildender", "q"),
    **_words("flux field feld magnetizing magnetising feldbildend feldbildender", "d"),
}
"""Beside a current: the axis that it flows in."""

TIMES: Final[dict[str, str | None]] = {
    **dict.fromkeys(
        (
            "t",
            "time",
            "times",
            "zeit",
            "messzeit",
            "timestamp",
            "time stamp",
            "zeitstempel",
            "x axis",
            "source",
        ),
        None,
    ),
    **dict.fromkeys(("seconds", "sekunden", "secs"), "s"),
    **dict.fromkeys(("millis", "milliseconds", "millisekunden"), "ms"),
    **dict.fromkeys(("micros", "microseconds", "mikrosekunden"), "us"),
}
"""Names of a time, and the unit that some of them say."""
BESIDE_TIME: Final = frozenset({"elapsed", "relative", "rel", "log"})
"""Words that say nothing more beside a time."""

KNOWN: Final = frozenset(
    {*QUANTITIES, *SYMBOLS, *VECTORS, *FRAMED, *DC, *DC_WORDS, *AXES, *BETWEEN, *FRAMES, *ROLES}
    | {*OTHER, *NEUTRAL, *LOAD, *AIRGAP, *TORQUE_FORMING, *TIMES, *BESIDE_TIME}
    | {word for words in NEUTRAL_FOR.values() for word in words} - {"s", "r"}
    | {"zwischenkreisspannung"}
)
"""Every word."""

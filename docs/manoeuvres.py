"""Fills the table of docs/what_to_record.md: how many effects each kind of recording would have shown.

python docs/manoeuvres.py

The drive is the package's simulated one with the motor `liu_2008` and no effect switched on. What a recording
would not have shown is `cannot_see` of its diagnosis.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

from pmsm_rs import diagnose, effects, simulate

PAGE: Final = Path(__file__).with_name("what_to_record.md")
TOP: Final = 80.0
"""rad/s, mechanical: 0.9 of the rated speed."""
REVERSALS: Final = {"t": [0, 0.3, 0.6, 0.9, 1.2, 1.5, 2.0], "value": [0, TOP, TOP, -TOP, -TOP, 0.6 * TOP, 0]}
SLOW: Final = {
    "t": [0, 0.2, 0.5, 0.6, 1.1, 1.2, 1.5, 1.6, 2.0],
    "value": [0, TOP, TOP, 4, -4, -TOP, -TOP, 0.5 * TOP, 0.5 * TOP],
}
STEPS_D: Final = {"t": [0, 0.35, 0.7, 1.05, 1.4], "value": [0, -15, 0, 10, -5], "shape": "steps"}
STEPS_Q: Final = {
    "t": [0.1 * k for k in range(20)],
    "value": [(-1) ** k * (8 if k % 4 < 2 else 20) for k in range(20)],
    "shape": "steps",
}
RECORDINGS: Final[dict[str, dict[str, Any]]] = {
    "constant speed and load": {"reference": {"omega_m": 60.0}},
    "two speeds, no reversal": {
        "reference": {"omega_m": {"t": [0, 0.8, 1.0, 2.0], "value": [20, 20, TOP, TOP]}}
    },
    "reversals": {"reference": {"omega_m": REVERSALS}},
    "reversals, steps of i_d": {"reference": {"omega_m": REVERSALS, "i_d": STEPS_D}},
    "reversals, steps of i_d, steps of i_q, slow through standstill": {
        "reference": {"omega_m": SLOW, "i_d": STEPS_D, "i_q": STEPS_Q}
    },
    "rotor held, steps of i_d and i_q": {
        "reference": {"i_d": STEPS_D, "i_q": STEPS_Q},
        "load": {"tau": 0.0, "kind": "locked"},
    },
}


def row(name: str, settings: dict[str, Any]) -> str:
    """A row of the table: the recording, how many effects it would have shown, and which not."""
    tables = {"load": {"tau": 5.0, "kind": "unknown_constant"}} | settings
    run = simulate(
        duration=2.0,
        settle=0.3,
        drive={"f_sample": 10e3},
        sensors={"noise_i": 0.05, "noise_omega_e": 0.2},
        **tables,
    )
    answer = diagnose(run.recording, run.machine)
    hidden = [entry["effect"] for entry in answer.cannot_see]
    every = [entry["id"] for entry in effects()]
    shown = len(every) - len(set(hidden))
    names = ", ".join(f"`{effect}`" for effect in every if effect in hidden)
    listed = names if len(set(hidden)) <= 6 else f"{len(set(hidden))} effects"
    return f"| {name} | {shown} of {len(every)} | {listed} |"


def main() -> None:
    """Rewrites the table."""
    rows = [row(name, settings) for name, settings in RECORDINGS.items()]
    table = "\n".join(
        ["| recording of 2 s | effects it would show | would not show |", "|---|---|---|", *rows]
    )
    text = PAGE.read_text(encoding="utf-8")
    pattern = r"(<!-- output of manoeuvres -->)\n.*?<!-- end -->"
    PAGE.write_text(
        re.sub(pattern, lambda found: f"{found[1]}\n{table}\n<!-- end -->", text, flags=re.DOTALL), "utf-8"
    )


if __name__ == "__main__":
    main()

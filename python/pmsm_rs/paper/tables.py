"""What came out, beside what the paper says: as CSV, as Markdown and as lines for the terminal."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from typing import Final

import numpy as np

from . import setup
from .runs import Following, Search, Seeds, generations

CHOICES: Final = (
    (
        "Magnet flux",
        "psi_m = k_t/(3/2·n_p·√2) = 0.19198 V·s, k_t being per A rms; k_e = 1.33 is then the peak "
        "line-to-line voltage per rad/s, √3·n_p·psi_m = 1.330",
    ),
    (
        "Manoeuvre",
        "load 3 N·m, speed reference 80 rad/s (mechanical) with a swing of 8 rad/s once in 0.3 s and one "
        "of 3 rad/s at 27 Hz. The current then changes in every window, as at a constant current r_s hardly "
        "shows. The speed loop has a bandwidth of 40 Hz",
    ),
    (
        "Drift",
        "r_s rises from 0.162 to 0.208 Ω along half a cosine; J swings by 0.5 % and B by 40 %, which keeps "
        "T_Ld near the paper's 2.95 to 3.05 N·m",
    ),
    (
        "Inverter",
        "mean voltage over each 10 µs, one sample late; at 100 kHz the samples are no slower than a carrier",
    ),
    (
        "Noise",
        "0.05 A rms on each phase current, 0.1 % of the rated peak, and 0.1 rad/s rms on the electrical "
        "speed; the paper names none",
    ),
    ("Static friction", "left out, as in the paper's equations (1) to (3)"),
    (
        "Search ranges",
        "from scratch r_s within ±50 % of the nameplate and the load within ±20 % of 3 N·m, which a drive "
        "knows from its torque command. From window to window within ±20 % of the last result, one particle "
        "on it",
    ),
    (
        "Velocity limit",
        "0.05 of each range per generation; how often other limits succeed is in the table",
    ),
    (
        "Initial values",
        "the free run of a window starts from its first sample, freed of noise by a straight line through "
        "the residual of the window's first 4 %",
    ),
    ("Weight w of (9)", "one number per window: rms of the current vector over rms of the speed"),
    ("Truth of a window", "the means of r_s(t) and of T_L + ΔJ·dω/dt + ΔB·ω over the window"),
    ("Converged", "cost within 1 % of the cost after the last generation"),
)
"""What the paper leaves open, and what was chosen."""


@dataclass(frozen=True)
class Outcome:
    """All runs of one reproduction; None where a run was not asked for. `seconds` is that of the whole."""

    search: Search | None
    swarm: Following | None
    fast: Following | None
    seeds: tuple[Seeds, ...]
    seconds: float


def summary(outcome: Outcome) -> list[tuple[str, str, str]]:
    """Rows of quantity, the paper's figure and the one found here."""
    rows: list[tuple[str, str, str]] = []
    if outcome.search is not None:
        cost = outcome.search.cost
        # Generation 0, the first draw, is not in the list.
        count = generations(tuple(cost), float(cost[-1])) + 1
        rows.append(("generations of one search until within 1 % of its last cost", "≤ 20", str(count)))
    for many in outcome.seeds:
        text = (
            f"{100 * many.share('own'):.0f} % (within 1 % of the best of all searches: "
            f"{100 * many.share('best'):.0f} %)"
        )
        limit = f"velocity limit {many.velocity_limit:g}"
        rows.append((f"searches of {len(many.own)} converged by generation 20, {limit}", "routinely", text))
    for found in (outcome.swarm, outcome.fast):
        if found is None:
            continue
        how = "paper's swarm" if found.method == "pso" else "warm least squares"
        for name, symbol in (("r_s", "r_s"), ("tau_load", "T_Ld")):
            errors = 100.0 * found.errors(name)
            text = f"{_rms(errors):.2f} % rms, {np.abs(errors).max():.2f} % at most"
            rows.append((f"tracking error of {symbol}, {how}", "not stated", text))
        if found.method == "pso":
            counts = [_converged(window.history) for window in found.windows]
            text = f"{np.median(counts):.0f} (median), {max(counts)} at most"
            rows.append(("generations per window until within 1 % of its last cost", "about 10", text))
        slow = "minutes per window" if found.method == "pso" else "–"
        for what, seconds in (("wall", found.seconds), ("processor", found.processor)):
            mean, factor = 1e3 * sum(seconds) / len(seconds), found.real_time_factor(seconds)
            text = f"{mean:.1f} ms per window, real-time factor {factor:.2g}"
            rows.append((f"{what} time, {how}", slow, text))
    return rows


def lines(outcome: Outcome) -> str:
    """The summary for a terminal."""
    return "\n".join(f"{name}\n    paper: {paper}; here: {here}" for name, paper, here in summary(outcome))


def windows_csv(found: Following) -> str:
    """One row per window."""
    out = io.StringIO()
    table = csv.writer(out, lineterminator="\n")
    table.writerow(_HEADER)
    table.writerows(_rows(found))
    return out.getvalue()


def markdown(outcome: Outcome, figures: list[str]) -> str:
    """The whole outcome as a page."""
    parts = ["# The paper, reproduced", "", "| quantity | paper | here |", "|---|---|---|"]
    parts += [f"| {name} | {paper} | {here} |" for name, paper, here in summary(outcome)]
    parts += ["", f"All of it took {outcome.seconds:.1f} s.", ""]
    if outcome.swarm is not None:
        parts += ["## Windows of the swarm", "", f"| {' | '.join(_HEADER)} |", "|" + "---|" * len(_HEADER)]
        parts += [f"| {' | '.join(row)} |" for row in _rows(outcome.swarm)]
        parts.append("")
    parts += ["## What the paper leaves open", ""]
    parts += [f"- {name}: {choice}." for name, choice in CHOICES]
    parts += ["", *(f"![{name}]({name}.svg)" for name in figures), ""]
    return "\n".join(parts)


_HEADER = (
    *("window", "t_start_s", "t_end_s", "r_s_true_ohm", "r_s_ohm", "r_s_error_percent"),
    *("T_Ld_true_Nm", "T_Ld_Nm", "T_Ld_error_percent", "cost_first", "cost_last"),
    *("generations_to_1_percent", "wall_ms", "processor_ms", "real_time_factor"),
)


def _rows(found: Following) -> list[list[str]]:
    rows = []
    for k, (window, true) in enumerate(zip(found.windows, found.truth, strict=True)):
        r_s, load = (window.parameters[name].value or float("nan") for name in ("r_s", "tau_load"))
        rows.append(
            [
                str(window.window),
                *(f"{x:.4f}" for x in (window.t_start, window.t_end)),
                *(f"{true[0]:.5f}", f"{r_s:.5f}", f"{100 * (r_s / true[0] - 1):+.2f}"),
                *(f"{true[1]:.4f}", f"{load:.4f}", f"{100 * (load / true[1] - 1):+.2f}"),
                *(f"{x:.4g}" for x in (window.cost_first or 0.0, window.cost or 0.0)),
                str(_converged(window.history)),
                *(f"{1e3 * x[k]:.1f}" for x in (found.seconds, found.processor)),
                f"{setup.WINDOW / found.seconds[k]:.2f}",
            ]
        )
    return rows


def _converged(history: tuple[float, ...]) -> int:
    return generations(history, history[-1])


def _rms(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    return float(np.sqrt(np.mean(values**2)))

"""How far answers stand from the noise on the validation run, where a truth states the sensors' noise alone.

python -m proof.least --open cases/open --sealed cases/sealed --answers answers [--window 0.25]

The speed is simulated in free run, driven by the torque of measured currents, less a load torque where one
is measured.  Their noise moves the rotor of the true machine, too, so that it leaves more than the speed
sensor's noise.  How much more follows from the true parameters alone: noise of the stated size is drawn
--draws times and sent the same way.  Printed are, for every case that was named rightly, the worst channel's
rms over the sensor's noise and over what the true machine leaves, and the shares within 1.1 of either.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from .heldout import CHANNELS, columns
from .reference import WINDOW, park, speed_residual, torque_of
from .summary import HELD_OUT

# of the normal distribution: median of |x| over its standard deviation
QUARTILE = 0.6745


def spread(log: np.ndarray) -> float:
    """Standard deviation of the white noise on a slow signal (n,), by the median of its changes."""
    return float(np.median(np.abs(np.diff(log))) / (QUARTILE * np.sqrt(2.0)))


def least_speed(
    truth: dict[str, Any], log: dict[str, np.ndarray], draws: int, window: float = WINDOW
) -> np.ndarray:
    """Rms (draws,) in rad/s that the true machine leaves in the speed of a validation run.

    truth: `base_true`, `f_sample` (Hz) and the noise of the run; log: its columns, each (n,); window in s.
    """
    base, noise = truth["base_true"], truth["runs"]["validation"]["noise_rms"]
    t_s, rows = 1.0 / truth["f_sample"], len(log["theta_e"])
    i_d, i_q = park(log["i_a"], log["i_b"], log["i_c"], log["theta_e"])
    load = spread(log["tau_m"]) if "tau_m" in log else 0.0
    found = np.empty(draws)
    for draw in range(draws):
        random = np.random.default_rng(draw)
        n_d, n_q, n_w = (random.normal(0.0, noise[c], rows) for c in CHANNELS)
        push = torque_of(base, i_d + n_d, i_q + n_q) - torque_of(base, i_d, i_q)
        push += random.normal(0.0, load, rows)
        rest = speed_residual(base, push, n_w, t_s, int(base["n_p"]), window)
        found[draw] = np.sqrt(np.mean(rest**2))
    return found


def rightly_named(truth: dict[str, Any], answer: dict[str, Any]) -> bool:
    """Whether everything that was put in is named, in a full log of a rich manoeuvre."""
    there = set(truth["components"])
    if not there or truth["manoeuvre"] == "poor" or truth.get("degraded", "full") != "full":
        return False
    ranking = answer.get("ranking") or [{}]
    first = ranking[0].get("effect") in there or len(there) > 1
    return answer.get("verdict") == "named" and first and there <= set(answer["model"]["effects"])


def left(trajectories: dict[str, np.ndarray], noise: dict[str, float]) -> dict[str, float]:
    """Rms of measured minus model over the noise, for each channel that the trajectories hold."""
    out = {}
    for channel in CHANNELS:
        model = trajectories.get(f"{channel}_after")
        if model is not None and np.isfinite(model).any():
            rest = (trajectories[f"{channel}_measured"] - model)[np.isfinite(model)]
            out[channel] = float(np.sqrt(np.mean(rest**2))) / noise[channel]
    return out


def main() -> None:
    """Print the table and the shares."""
    ap = argparse.ArgumentParser(
        prog="python -m proof.least",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    ap.add_argument("--open", type=Path, required=True, help="folder of the logs")
    ap.add_argument("--sealed", type=Path, required=True, help="folder of the truths")
    ap.add_argument(
        "--answers", type=Path, required=True, help="answers and trajectories, CASE.json, CASE.parquet"
    )
    ap.add_argument("--window", type=float, default=WINDOW, help="length of a free run, s (default 0.25)")
    ap.add_argument("--draws", type=int, default=20)
    a = ap.parse_args()
    print(f"{'case':8}{'worst / noise':>14}{'true machine / noise, speed':>29}{'worst / least':>15}")
    by_noise, by_least = [], []
    for path in sorted(a.sealed.glob("*/truth.json")):
        case = path.parent.name
        truth = json.loads(path.read_text(encoding="utf-8"))
        answer = json.loads((a.answers / f"{case}.json").read_text(encoding="utf-8"))
        if not rightly_named(truth, answer):
            continue
        noise = truth["runs"]["validation"]["noise_rms"]
        rest = left(columns(a.answers / f"{case}.parquet"), noise)
        by_noise.append(max(rest.values()))
        least = np.ones(1)
        if "omega_e" in rest and truth["load"] != "locked":
            log = columns(a.open / case / "validation.parquet")
            least = least_speed(truth, log, a.draws, a.window) / noise["omega_e"]
            rest["omega_e"] /= float(least.mean())
        by_least.append(max(rest.values()))
        shown = f"{least.mean():.3f} ± {least.std():.3f}"
        print(f"{case:8}{by_noise[-1]:14.3f}{shown:>29}{by_least[-1]:15.3f}")
    for name, found in (("the noise", by_noise), ("the least", by_least)):
        within = sum(x <= HELD_OUT for x in found)
        print(f"within {HELD_OUT} of {name}: {within} of {len(found)}, median {np.median(found):.3f}")


if __name__ == "__main__":
    main()

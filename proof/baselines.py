"""What simpler methods make of the same cases: stepwise regression, sparse regression, a Gaussian process.

All three get what the tool gets, and start from the plain machine fitted to the recording (`reference`).
They regress on its residuals, base parameters and unknown loads free beside the columns of `library`, to
first order:

stepwise   effects are added, then dropped, one at a time while the Bayesian information criterion of white
           noise falls (G. Schwarz, Ann. Statist. 6 (1978) 461)
sparse     PySINDy's sequentially thresholded least squares (S. L. Brunton et al., PNAS 113 (2016) 3932) on
           the same columns, whose equations are thereby in integral form; an effect is named that keeps a
           column
gaussian   Gaussian processes of voltage and of torque over currents, speed and electrical angle, by random
           Fourier features (A. Rahimi, B. Recht, NIPS 2007), whose sizes the last quarter of the recording
           chooses; they name nothing

An unknown load that steps is a level per window.  The validation run re-estimates what the contract allows:
initial values, load levels, and the turn of the angle.
"""

from __future__ import annotations

import json
import time
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .case import write_text
from .heldout import CHANNELS, columns
from .library import Piece, Signals, library, respond, signals
from .plan import name_of
from .reference import WINDOW, Fit, currents, fit_plain

METHODS = ("stepwise", "sparse", "gaussian")
MOST = 10
# a column is dropped by the sparse regression if all it moves is below this share of the noise
THRESHOLD = 0.1
FEATURES, LENGTH = 40, 1.0
# variances of the process over that of the noise that are tried; zero is no process
SIZES = (0.0, *np.logspace(-9.0, 3.0, 13))
TRAINED = 0.75
MARGIN = 1e-9


@dataclass(frozen=True)
class Columns:
    """Whitened residual y (rows,), columns x (rows, k) of base parameters and of what every run has anew, and
    the scale of each channel; `anew` is the number of the latter, which come last."""

    y: np.ndarray
    x: np.ndarray
    anew: int
    scale: dict[str, float]


@dataclass(frozen=True)
class Run:
    """A log with its sample time and what is known of its load."""

    log: dict[str, np.ndarray]
    t_s: float
    load: dict[str, Any]


def read(path: Path, machine: dict[str, Any]) -> Run:
    """A log; an unknown load that steps is given a level per window."""
    log = columns(path)
    t_s = float(np.median(np.diff(log["t"])))
    kind = machine["load"]["kind"]
    size, n = round(WINDOW / t_s), len(log["t"])
    breaks = tuple(range(size, n - size // 2, size)) if kind == "unknown_piecewise" else ()
    return Run(log, t_s, {"load": kind, "load_value": machine["load"].get("value", 0.0), "breaks": breaks})


def spread(x: np.ndarray) -> float:
    """Size of the white noise of a residual (n,), by its changes; never zero."""
    return max(float(np.std(np.diff(x)) / np.sqrt(2.0)), 1e-12)


def stack(parts: dict[str, np.ndarray], scale: dict[str, float]) -> np.ndarray:
    """Channels one after another over their scales."""
    return np.concatenate([parts[k] / scale[k] for k in CHANNELS if k in scale])


def parameter_columns(run: Run, fit: Fit, s: Signals, moving: bool) -> list[dict[str, np.ndarray]]:
    """Change of measured minus modelled with the logarithm of each base parameter."""
    out, n, step = [], len(s.w), 1e-4
    first = np.array([s.i[0].real, s.i[0].imag])
    here = currents(fit.base, run.log, s.t_s, first)
    for name in ("r_s", "l_d", "l_q", "psi_m"):
        there = currents({**fit.base, name: fit.base[name] * (1.0 + step)}, run.log, s.t_s, first)
        moved = (there - here) / step
        out.append({"i_d": moved[:, 0], "i_q": moved[:, 1], "omega_e": np.zeros(n)})
    if moving:
        known = run.log["tau_m"] if run.load["load"] == "measured" else run.load["load_value"]
        # the inertia by what the torque should have done: a measured acceleration would explain its own noise
        for tau in (s.tau - known, s.w / s.n_p):
            out.append(respond(s, Piece(tau=-tau), WINDOW))
        # the torque that the flux and the saliency make
        for tau in (s.i.imag, s.i.real * s.i.imag):
            out.append(respond(s, Piece(tau=tau), WINDOW))
    return out


def anew_columns(run: Run, s: Signals) -> list[dict[str, np.ndarray]]:
    """What initial currents and load levels add."""
    out, n = [], len(s.w)
    for start in (1.0, 1j):
        x = np.zeros(n, complex)
        x[0] = start / s.t_s * s.base["l_d" if start == 1.0 else "l_q"]
        out.append(respond(s, Piece(v=x), WINDOW))
    if run.load["load"].startswith("unknown"):
        for a, b in zip((0, *run.load["breaks"]), (*run.load["breaks"], n), strict=True):
            out.append(
                respond(s, Piece(tau=-np.where((np.arange(n) >= a) & (np.arange(n) < b), 1.0, 0.0)), WINDOW)
            )
    return out


def prepared(run: Run, fit: Fit, s: Signals, scale: dict[str, float] | None = None) -> Columns:
    """Residual and columns of a run whose plain machine is `fit`."""
    scale = scale or {k: spread(v) for k, v in fit.residual.items()}
    anew = anew_columns(run, s)
    held = [*parameter_columns(run, fit, s, "omega_e" in scale), *anew]
    return Columns(stack(fit.residual, scale), np.stack([stack(c, scale) for c in held], 1), len(anew), scale)


def solve(gram: np.ndarray, chosen: Sequence[int]) -> tuple[np.ndarray, float]:
    """Sizes of the chosen columns and the sum of squares left; gram is that of all columns, y last."""
    at = list(chosen)
    a = gram[np.ix_(at, at)]
    size = np.sqrt(np.maximum(np.diag(a), 1e-300))
    found = np.linalg.lstsq(a / np.outer(size, size), gram[at, -1] / size, rcond=MARGIN)[0] / size
    return found, float(gram[-1, -1] - found @ gram[at, -1])


def stepwise(
    gram: np.ndarray, always: list[int], groups: dict[tuple[str, int], list[int]], n: int
) -> list[Any]:
    """Keys of the groups that BIC chooses: added, then dropped, one at a time."""

    def bic(keys: list[tuple[str, int]]) -> float:
        at = always + [c for key in keys for c in groups[key]]
        return n * np.log(max(solve(gram, at)[1], 1e-300) / n) + len(at) * np.log(n)

    chosen: list[tuple[str, int]] = []
    best = bic(chosen)
    while len(chosen) < MOST:
        rivals = [k for k in groups if k[0] not in {c[0] for c in chosen}]
        now, key = min((bic([*chosen, k]), k) for k in rivals)
        if now >= best:
            break
        best, chosen = now, [*chosen, key]
    while chosen:
        now, key = min((bic([c for c in chosen if c != k]), k) for k in chosen)
        if now >= best:
            break
        best, chosen = now, [c for c in chosen if c != key]
    return chosen


def sparse(x: np.ndarray, y: np.ndarray, always: np.ndarray) -> np.ndarray:
    """Columns (k,) of x that PySINDy's thresholding keeps, those of `always` taken out of both before.

    Raises ImportError where PySINDy is not installed.
    """
    from pysindy.optimizers import STLSQ

    basis = np.linalg.qr(always)[0]
    rest, target = x - basis @ (basis.T @ x), y - basis @ (basis.T @ y)
    size = np.sqrt(np.mean(rest**2, axis=0))
    sound = size > MARGIN * max(float(size.max()), 1e-300)
    kept = np.zeros(x.shape[1], bool)
    solver = STLSQ(threshold=THRESHOLD, alpha=1e-6, max_iter=20)
    solver.fit(rest[:, sound] / size[sound], target[:, None])
    kept[sound] = np.abs(solver.coef_[0]) >= THRESHOLD
    return kept


def features(s: Signals, scale: np.ndarray) -> list[list[Piece]]:
    """Random Fourier features of squared-exponential processes, as voltages on both axes and as torque.

    scale (3,): standard deviations of i_d, i_q (A) and the speed (rad/s) in the recording.
    """
    rng = np.random.default_rng(17)
    z = [s.i.real / scale[0], s.i.imag / scale[1], s.w / scale[2], np.cos(s.theta_e), np.sin(s.theta_e)]
    k, phase = rng.standard_normal((FEATURES, 5)) / LENGTH, rng.uniform(0.0, 2.0 * np.pi, FEATURES)
    waves = np.sqrt(2.0 / FEATURES) * np.cos(k @ np.stack(z) + phase[:, None])
    return [[Piece(v=turn * x) for turn in (1.0 + 0j, 1j) for x in waves], [Piece(tau=x) for x in waves]]


def process(x: np.ndarray, y: np.ndarray, always: np.ndarray, trained: np.ndarray) -> np.ndarray:
    """Sizes (k,) of the features, their common variance the one that foresees the rows that are not trained
    on."""

    def without(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # what base parameters and loads explain on these rows says nothing about the process
        basis = np.linalg.qr(always[rows][:, np.any(always[rows] != 0.0, axis=0)])[0]
        return tuple(a[rows] - basis @ (basis.T @ a[rows]) for a in (x, y))

    def sizes(rest: np.ndarray, target: np.ndarray) -> Callable[[float], np.ndarray]:
        scale = np.sqrt(np.mean(rest**2, axis=0)) + MARGIN
        values, vectors = np.linalg.eigh((rest / scale).T @ (rest / scale))
        along = vectors.T @ ((rest / scale).T @ target)
        return lambda v: vectors @ (along * v / (1.0 + v * np.maximum(values, 0.0))) / scale

    found, (rest, target) = sizes(*without(trained)), without(~trained)
    best = min(SIZES, key=lambda v: float(np.sum((target - rest @ found(v)) ** 2)))
    return sizes(*without(np.ones(len(y), bool)))(best)


def baseline(folder: Path) -> dict[str, dict[str, Any]]:
    """method -> names, rms per channel left on the validation run, seconds; from a case's open folder.

    A method whose package is not installed is left out.
    """
    machine = tomllib.loads((folder / "machine.toml").read_text(encoding="utf-8"))
    first, other = (read(folder / f"{k}.parquet", machine) for k in ("recording", "validation"))
    began = time.process_time()
    start = {k: float(v) for k, v in machine["machine"].items()}
    fit = fit_plain(start, first.log, first.t_s, **first.load)
    held = fit_plain(fit.base, other.log, other.t_s, **other.load, refit=False)
    s, after = signals(first.log, first.t_s, fit.base), signals(other.log, other.t_s, fit.base)
    mine = prepared(first, fit, s)
    theirs = prepared(other, held, after, mine.scale)
    named = library(s)
    keys = [(name, n) for name, variants in named.items() for n in range(len(variants))]
    x, groups = [], {}
    for name, n in keys:
        groups[name, n] = [mine.x.shape[1] + len(x) + c for c in range(len(named[name][n]))]
        x += [stack(respond(s, piece, WINDOW), mine.scale) for piece in named[name][n]]
    known = np.stack(x, 1)
    every = np.concatenate([mine.x, known, mine.y[:, None]], axis=1)
    gram, always = every.T @ every, list(range(mine.x.shape[1]))
    shared = time.process_time() - began
    out: dict[str, dict[str, Any]] = {}

    def tell(method: str, names: list[str], rms: dict[str, float], since: float) -> None:
        out[method] = {"names": names, "rms": rms, "seconds": shared + time.process_time() - since}

    def kept(method: str, chosen: list[tuple[str, int]], since: float) -> None:
        at = always + [c for key in chosen for c in groups[key]]
        sizes = solve(gram, at)[0]
        tell(method, [name for name, _ in chosen], foreseen(after, theirs, chosen, sizes), since)

    since = time.process_time()
    kept("stepwise", stepwise(gram, always, groups, len(mine.y)), since)
    since = time.process_time()
    try:
        single = [c - len(always) for name, n in keys if n == 0 for c in groups[name, n]]
        keep = {single[c] + len(always) for c in np.flatnonzero(sparse(known[:, single], mine.y, mine.x))}
    except ImportError:
        keep = None
    if keep is not None:
        kept("sparse", [(name, n) for name, n in keys if n == 0 and keep & set(groups[name, n])], since)
    since = time.process_time()
    scale = np.array([np.std(s.i.real), np.std(s.i.imag), np.std(s.w)]) + MARGIN
    own, foreign = smooth(s, scale, mine), smooth(after, scale, theirs)
    added, seen = np.zeros_like(theirs.y), mine.y.copy()
    # of the currents, then of the speed: rows of the first two channels, and what is left
    rows = np.arange(len(mine.y)) < 2 * len(s.w)
    trained = np.arange(len(mine.y)) % len(s.w) < TRAINED * len(s.w)
    for here, x, beyond in zip((rows, ~rows), own, foreign, strict=True):
        if here.any():
            found = process(x[here], mine.y[here], mine.x[here], trained[here])
            seen[here] -= x[here] @ found
            added += np.where(np.arange(len(added)) < 2 * len(after.w), here[0], not here[0]) * (
                beyond @ found
            )
    tell("gaussian", [], left(theirs, added, np.linalg.lstsq(mine.x, seen, rcond=MARGIN)[0]), since)
    return out


def smooth(s: Signals, scale: np.ndarray, of: Columns) -> list[np.ndarray]:
    """Columns (rows, k) of the features of voltage, and of torque."""
    return [np.stack([stack(respond(s, p, WINDOW), of.scale) for p in x], 1) for x in features(s, scale)]


def left(theirs: Columns, added: np.ndarray, base: np.ndarray) -> dict[str, float]:
    """Rms per channel on the validation run less what is added and what base parameters change, with initial
    values and load levels anew."""
    count = theirs.x.shape[1] - theirs.anew
    rest = theirs.y - added - theirs.x[:, :count] @ base[:count]
    anew = theirs.x[:, count:]
    rest = rest - anew @ np.linalg.lstsq(anew, rest, rcond=MARGIN)[0]
    parts = np.split(rest, len(theirs.scale))
    return {
        k: float(np.sqrt(np.mean(p**2))) * theirs.scale[k] for k, p in zip(theirs.scale, parts, strict=True)
    }


def foreseen(
    s: Signals, theirs: Columns, chosen: list[tuple[str, int]], sizes: np.ndarray
) -> dict[str, float]:
    """Rms per channel that a set leaves on the validation run, at the turn of the angle that leaves least."""
    count = theirs.x.shape[1]
    best: dict[str, float] = {}
    turning = any(name in ("load_torque_pulsation", "encoder_eccentricity") for name, _ in chosen)
    for turn in range(int(s.n_p) if turning else 1):
        moved = Signals(
            s.v, s.i, s.theta_e, s.theta_m + 2.0 * np.pi * turn / s.n_p, s.w, s.tau, s.t_s, s.base
        )
        named = library(moved)
        x = [stack(respond(moved, p, WINDOW), theirs.scale) for name, n in chosen for p in named[name][n]]
        # the last base columns are those of the recording's own start and load
        added = np.stack(x, 1) @ sizes[-len(x) :] if x else np.zeros_like(theirs.y)
        found = left(theirs, added, sizes[:count])
        if not best or sum((v / theirs.scale[k]) ** 2 for k, v in found.items()) < sum(
            (v / theirs.scale[k]) ** 2 for k, v in best.items()
        ):
            best = found
    return best


def path(number: int, out: Path) -> Path:
    """Where a case's baselines are kept."""
    return out / "baselines" / f"{name_of(number)}.json"


def run(number: int, out: Path) -> None:
    """Let every method judge a case, where that has not been done."""
    kept = path(number, out)
    if not kept.exists():
        kept.parent.mkdir(parents=True, exist_ok=True)
        write_text(kept, json.dumps(baseline(out / "open" / name_of(number)), indent=1) + "\n")

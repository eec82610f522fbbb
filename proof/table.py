"""Writes what the score amounts to: table.md, score.json, seed, calibration.png and calibration.svg."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

from matplotlib.figure import Figure

from .case import atomically, write_text
from .families import families
from .rivals import compared, lines_of
from .score import Judged
from .summary import SEVERITIES, Rate, Value, breakdown, brier, calibration, headline, severity_of

ROOT = Path(__file__).resolve().parent.parent
BLUE, GREY, PAPER_GREY = "#0b5c92", "#555555", "#d0d4d8"


def commit() -> str:
    """The commit that is checked out, "… with changes" where files differ; empty outside a repository."""
    done = subprocess.run(
        ["git", "describe", "--always", "--abbrev=12", "--dirty= with changes", "--exclude=*"],
        cwd=ROOT,
        check=False,
        capture_output=True,
        text=True,
    )
    return done.stdout.strip() if done.returncode == 0 else ""


def markdown(
    rows: Sequence[Judged], facts: dict[str, object], rivals: Sequence[dict[str, Judged]] = ()
) -> str:
    """The whole table."""
    full = [r for r in rows if r.log == "full"]
    bench = [r for r in rows if r.log != "full" and r.family != "limits"]
    limited = len(rows) - len(full) - len(bench)
    clean = sum(r.kind == "clean" for r in full)
    where = f"commit {facts['commit']}, "
    head = (
        f"{len(rows)} cases of {facts['cases']} planned, seed {facts['seed']}, {facts['split']} machines and "
        f"forms, pmsm-rs {facts['version']}, "
        f"{where if facts['commit'] else ''}installed code {facts['code']}. "
        f"Full logs: {len(full)} cases, {clean} of them clean; bench-like logs: {len(bench)}; "
        f"limited logs: {limited}."
    )
    lines = [
        head,
        *by_family(rows),
        *lines_of(rows, rivals),
        "",
        "## By kind of log",
        "",
        "| | full logs | bench-like logs |",
        "|---|---|---|",
    ]
    left, right = headline(full), headline(bench)
    lines += [f"| {name} | {left[name]} | {right[name]} |" for name in left]
    lines += ["", "A number in brackets behind a value says how many cases it is taken over.", ""]
    lines += ["![Stated probability against the share that was right](calibration.png)", ""]
    lines.append(
        f"Probability of every effect of a ranking against how often it is there, all families; Brier score "
        f"of the first name {brier(rows)}."
    )
    effects = [r for r in full if r.kind in ("single", "pair", "poor", "unknown", "clean")]
    kinds = {
        "clean": "nothing",
        "unknown": "outside the catalogue",
        "pair": "two effects",
        "poor": "poor manoeuvre",
    }
    groups = (
        (
            "By what was put in, singles to clean cases, full logs",
            effects,
            lambda r: kinds.get(r.kind, r.effect),
            tuple(kinds.values()),
        ),
        (
            "By severity (residual over noise), single effects, full logs",
            [r for r in full if r.kind == "single"],
            severity_of,
            tuple(name for _, _, name in SEVERITIES),
        ),
        ("By manoeuvre, full logs", full, lambda r: r.manoeuvre, ()),
        ("By what is known of the load, full logs", full, lambda r: r.load, ()),
        ("By machine, full logs", full, lambda r: r.machine, ()),
        ("By simulator, full logs", full, lambda r: r.simulator, ("plant",)),
        ("By kind of bench-like log", bench, lambda r: r.log, ()),
        ("By what was put in, bench-like logs", bench, lambda r: kinds.get(r.kind, r.effect), ("nothing",)),
    )
    for title, chosen, of, order in groups:
        found = breakdown(chosen, of, order)
        if not found:
            continue
        lines += [
            "",
            f"## {title}",
            "",
            "| | right | wrong with p > 0.5 | false alarms |",
            "|---|---|---|---|",
        ]
        lines += [f"| {k.replace('_', ' ')} | {a} | {b} | {c} |" for k, a, b, c in found]
    wrong = [r for r in rows if not r.right]
    lines += ["", "### Every case that is not right", ""]
    if wrong:
        lines += [
            "| case | put in | severity | log | manoeuvre | load | verdict | first | p |",
            "|" + 9 * "---|",
        ]
        lines += [
            f"| {r.case} | {r.effect.replace('_', ' ')} | {r.severity:.2f} | {r.log.replace('_', ' ')} "
            f"| {r.manoeuvre} | {r.load.replace('_', ' ')} | {r.verdict.replace('_', ' ')} "
            f"| {(r.first or '–').replace('_', ' ')} | {r.probability:.2f} |"
            for r in wrong
        ]
    else:
        lines.append("There is none.")
    return "\n".join(lines) + "\n"


def by_family(rows: Sequence[Judged]) -> list[str]:
    """Lines of the table of families."""
    found = families(rows)
    lines = ["", "| | " + " | ".join(found) + " |", "|" + (1 + len(found)) * "---|"]
    lines += [
        f"| {name} | " + " | ".join(str(of[name]) for of in found.values()) + " |" for name in found["all"]
    ]
    return lines


def picture(rows: Sequence[Judged]) -> Figure:
    """Reliability diagram: above, stated probability against the share that was right, with counts; below,
    how often each probability was stated."""
    bins = calibration(rows)
    figure = Figure(figsize=(5.2, 5.6), layout="constrained", facecolor="white")
    top, low = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    top.plot([0, 1], [0, 1], color=PAPER_GREY, linewidth=1.5, zorder=1)
    top.annotate("as stated", (0.28, 0.31), color=GREY, rotation=45, rotation_mode="anchor", fontsize=9)
    for b in bins:
        # one standard deviation of a binomial share with the stated probability
        spread = (b.stated * (1.0 - b.stated) / b.count) ** 0.5
        top.plot(
            [b.stated] * 2, [max(b.stated - spread, 0.0), min(b.stated + spread, 1.0)], color=PAPER_GREY, lw=5
        )
    top.plot([b.stated for b in bins], [b.observed for b in bins], "o", color=BLUE, markersize=7, zorder=3)
    for b in bins:
        below = b.observed > 0.5
        top.annotate(
            f"{b.count}",
            (b.stated, b.observed),
            xytext=(0, -6 if below else 6),
            textcoords="offset points",
            ha="center",
            va="top" if below else "bottom",
            fontsize=9,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
        )
    top.set(xlim=(-0.02, 1.02), ylim=(-0.04, 1.06), ylabel="share that was there")
    score = brier(rows)
    top.set_title(
        f"{sum(b.count for b in bins)} effects; Brier score of the first names {score.value:.4f}"
        if score.of
        else "No names were given",
        fontsize=10,
        loc="left",
    )
    low.bar([b.low for b in bins], [b.count for b in bins], width=0.095, align="edge", color=BLUE)
    low.set(xlabel="probability stated", ylabel="effects", yscale="log")
    for axes in (top, low):
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def write_results(
    rows: Sequence[Judged],
    out: Path,
    *,
    cases: int,
    seed: int,
    code: str,
    split: str = "scoring",
    rivals: Sequence[dict[str, Judged]] = (),
) -> str:
    """Write all results into `out` and return a summary for the terminal.

    rivals: for each case what became of the baselines (`rivals.judge_rivals`).
    """
    facts: dict[str, object] = {
        "cases": cases,
        "seed": seed,
        "version": version("pmsm-rs"),
        "commit": commit(),
        "code": code,
        "split": split,
    }

    def plain(x: Rate | Value) -> dict[str, float | int | None]:
        return {"count": x.count, "of": x.of} if isinstance(x, Rate) else {"value": x.value, "of": x.of}

    full = [r for r in rows if r.log == "full"]
    bench = [r for r in rows if r.log != "full" and r.family != "limits"]
    left, right = headline(full), headline(bench)
    score = {
        **facts,
        "families": {f: {k: plain(v) for k, v in of.items()} for f, of in families(rows).items()},
        "full": {k: plain(v) for k, v in left.items()},
        "bench": {k: plain(v) for k, v in right.items()},
        "calibration": [asdict(b) for b in calibration(rows)],
        "brier": plain(brier(rows)),
        "baselines": compared(rows, rivals) if any(rivals) else {},
        "rows": [asdict(r) for r in rows],
    }
    write_text(out / "table.md", markdown(rows, facts, rivals))
    write_text(out / "seed", f"{seed}\n")
    write_text(out / "score.json", json.dumps(score, indent=1) + "\n")
    figure = picture(rows)
    for kind in ("png", "svg"):
        # a date or a version of the plotter would make equal pictures differ
        nothing = {"Software": None} if kind == "png" else {"Date": None, "Creator": None}
        atomically(
            out / f"calibration.{kind}",
            lambda name, kind=kind, nothing=nothing: figure.savefig(
                name, format=kind, dpi=130, metadata=nothing
            ),
        )
    wide = max(map(len, left))
    lines = [f"{'':{wide}}  {'full logs':>22}  {'bench-like':>22}"]
    lines += [f"{k:{wide}}  {v!s:>22}  {right[k]!s:>22}" for k, v in left.items()]
    for name, of in families(rows).items():
        lines += ["", name, *(f"  {k:{wide}}  {v!s:>22}" for k, v in of.items() if str(v) != "–")]
    return "\n".join([*lines, "", f"Table: {out / 'table.md'}", f"Calibration: {out / 'calibration.png'}"])

"""All of it by one call."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable
from pathlib import Path

from .. import atomic
from .._core import UsageError
from ..errors import did_you_mean, refuse
from ..progress import Progress
from . import FIGURES, figures, runs, setup, tables

_LIMITS = (0.1, 0.2)
"""Further velocity limits whose success is counted."""


def reproduce(
    which: str | Iterable[str],
    folder: str | os.PathLike[str],
    progress: Progress | None = None,
) -> tuple[tables.Outcome, list[Path]]:
    """Simulates and identifies the paper's runs and writes figures (PNG and SVG) and tables (CSV and
    Markdown) to `folder`; returns the outcome and the files.

    `which` is "all" or any of "fig5", "fig6", "fig7", "fig8". Raises UsageError for another name or a folder
    that cannot be written to.
    """
    asked = [which] if isinstance(which, str) else list(which)
    wanted = set(FIGURES) if "all" in asked else set(asked)
    odd = next((name for name in asked if name not in (*FIGURES, "all")), None)
    if odd is not None:
        raise refuse(UsageError, f"there is no figure '{odd}'", fix=did_you_mean(odd, (*FIGURES, "all")))
    target = _folder(folder)
    begin = time.perf_counter()
    data = runs.run()
    search = fast = swarm = None
    many: tuple[runs.Seeds, ...] = ()
    drawn = {}
    if "fig5" in wanted:
        search = runs.search(data)
        drawn["fig5"] = figures.fig5(search)
        limits = (setup.SWARM.velocity_limit, *_LIMITS)
        many = tuple(
            runs.seeds(data, limit, _part(progress, number, len(limits)))
            for number, limit in enumerate(limits)
        )
    if wanted - {"fig5"}:
        swarm, fast = runs.follow(data, "pso"), runs.follow(data, "lm")
        if "fig6" in wanted:
            drawn["fig6"] = figures.fig6(data, swarm)
        if "fig7" in wanted:
            drawn["fig7"] = figures.fig7(data, swarm)
        if "fig8" in wanted:
            drawn["fig8"] = figures.fig8(swarm)
    files = [path for name, figure in drawn.items() for path in figures.write(figure, target, name)]
    outcome = tables.Outcome(search, swarm, fast, many, time.perf_counter() - begin)
    texts = {"paper.md": tables.markdown(outcome, list(drawn))}
    if swarm is not None and fast is not None:
        texts |= {"windows_swarm.csv": tables.windows_csv(swarm), "windows_lm.csv": tables.windows_csv(fast)}
    for name, text in texts.items():
        atomic.write_text(target / name, text)
        files.append(target / name)
    return outcome, files


def _part(progress: Progress | None, number: int, count: int) -> Progress | None:
    """Progress of part `number`, from 0, of `count` equal parts, as progress of the whole."""
    if progress is None:
        return None
    return lambda stage, fraction: progress(stage, (number + fraction) / count)


def _folder(folder: str | os.PathLike[str]) -> Path:
    target = Path(folder)
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise refuse(
            UsageError,
            f"this folder cannot be made ({error.strerror})",
            file=str(target),
            fix="name a folder that may be written to",
        ) from error
    return target

"""Makes and answers the cases of a set in several processes."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Mapping
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor, as_completed
from multiprocessing import active_children, get_context
from pathlib import Path
from types import FrameType
from typing import Any

from . import answers, baselines, generate
from .plan import Planned, name_of


def work(number: int, planned: Planned, seed: int, split: str, out: Path, code: str, rivals: bool) -> str:
    """Make a case and let the tool and the baselines answer it, where that has not been done; a line that
    says so, empty if nothing was to do."""
    said: list[str] = []
    if not generate.is_made(number, out):
        began = time.process_time()
        truth = generate.generate(number, seed, planned, out, split)
        said.append(f"made in {time.process_time() - began:.0f} s ({truth['kind']})")
    if code and not answers.is_answered(number, out, code):
        cost = answers.answer(number, out, code)
        said.append(f"answered in {cost.seconds:.0f} s" + (f", exit {cost.exit}" if cost.exit != 0 else ""))
    if rivals:
        try:
            baselines.run(number, out)
        except (RuntimeError, ValueError) as error:
            said.append(f"no baselines: {error}")
    return f"{name_of(number)} {', '.join(said)}" if said else ""


# set when this worker has been asked to end: the executor hands it what it had queued all the same
ending = False


def stop(_number: int, _frame: FrameType | None) -> None:
    """End at once: what is being written is not in place yet."""
    global ending
    ending = True
    raise KeyboardInterrupt


def ready() -> None:
    """Let a worker end when the parent says so, which hears Ctrl-C for all."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, stop)


def unless_ending(do: Callable[..., str], arguments: tuple[Any, ...]) -> str:
    """What `do` says; nothing where this worker is to end."""
    return "" if ending else do(*arguments)


def run(
    planned: list[Planned], seed: int, split: str, out: Path, code: str, jobs: int, rivals: bool
) -> list[str]:
    """Make and answer the planned cases; returns a sentence for each that could not be made."""
    tasks = {name_of(n): (n, p, seed, split, out, code, rivals) for n, p in enumerate(planned)}
    return spread(work, tasks, jobs)


def spread(do: Callable[..., str], tasks: Mapping[str, tuple[Any, ...]], jobs: int) -> list[str]:
    """Call `do` with the arguments of each task, in so many processes, and print what it says; returns a
    sentence for each that could not be made."""
    failed = []
    # spawned, so that a worker starts without the parent's threads
    with ProcessPoolExecutor(jobs, get_context("spawn"), ready) as pool:
        futures = {pool.submit(unless_ending, do, arguments): name for name, arguments in tasks.items()}
        try:
            for done, future in enumerate(as_completed(futures), 1):
                try:
                    line = future.result()
                except BrokenExecutor:
                    raise
                except (RuntimeError, ValueError, ImportError) as error:
                    line = f"{futures[future]} not made: {error}"
                    failed.append(line)
                if line:
                    print(f"{done:4d} of {len(tasks)}  {line}", flush=True)
        except KeyboardInterrupt:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in active_children():
                process.terminate()
            raise
    return failed

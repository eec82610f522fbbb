"""The process of a command: its standard streams, its signals and its end. Imports next to nothing, as Ctrl-C
may come while all else is imported.
"""

from __future__ import annotations

import io
import os
import sys
import warnings
from contextlib import suppress
from typing import Any, NoReturn

INTERRUPTED = 130
INTERRUPTED_SENTENCE = "interrupted before there was a result; run it again"


class _Closed(io.TextIOBase):
    """Standard output that is not open."""

    def write(self, _text: str) -> int:
        """Raises OSError."""
        raise OSError(9, "it is closed")


def prepare(own: bool) -> None:
    """Makes the standard streams fit for any text; in a process of its `own`, takes SIGTERM for Ctrl-C."""
    if own:
        _fill_descriptors()
        _take_signals()
        if not sys.warnoptions:
            # What overflows is checked where it matters; NumPy names lines of code that no user has seen.
            warnings.simplefilter("ignore", RuntimeWarning)
    if sys.stdout is None:
        sys.stdout = _Closed()
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, open as long as the process
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # A name of a file may hold bytes that are no characters.
            stream.reconfigure(errors="backslashreplace")


def _fill_descriptors() -> None:
    """Opens nothing in place of standard streams that are closed, lest a file gets the number of one."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            # The lowest number that is free is this one.
            os.open(os.devnull, os.O_RDWR)


def _take_signals() -> None:
    import signal
    import threading

    def unraisable(told: Any) -> None:
        # Where Python cannot raise, such as while it clears an object away, Ctrl-C would be lost.
        if issubclass(told.exc_type, KeyboardInterrupt):
            interrupted(True, INTERRUPTED_SENTENCE)
        sys.__unraisablehook__(told)

    def stop(_signal: int, _frame: object) -> None:
        raise KeyboardInterrupt

    if threading.current_thread() is threading.main_thread():
        sys.unraisablehook = unraisable
        signal.signal(signal.SIGTERM, stop)


def write_error(sentence: str, name: str = "pmsm-rs:") -> None:
    """Writes a sentence behind a `name` to standard error, if anybody reads it."""
    try:
        if sys.stderr.isatty():
            # Wipes the line of progress.
            sys.stderr.write("\r\x1b[K")
        sys.stderr.write(f"{name} {sentence}\n")
        sys.stderr.flush()
    except (OSError, ValueError):
        discard(sys.stderr)


def discard(stream: Any) -> None:
    """Lets what `stream` still holds go to nowhere; Python would complain of it at its end."""
    try:
        number = stream.fileno()
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, number)
        os.close(nowhere)
        stream.flush()
    except (OSError, ValueError):
        pass


def interrupted(own: bool, sentence: str) -> NoReturn:
    """Ends with one sentence and the code of Ctrl-C; a process of its `own` ends at once, whatever threads
    still compute.
    """
    if own:
        _deaf()
    write_error(sentence)
    end(own, INTERRUPTED)


def end(own: bool, code: int) -> NoReturn:
    """Ends with `code`. A process of its `own` hears no signal any more, and ends at once where it was
    interrupted.
    """
    if own:
        _deaf()
        if code == INTERRUPTED:
            import atexit

            with suppress(OSError, ValueError):
                sys.stdout.flush()
            # Decoders are ended there; threads would be waited for behind it.
            atexit._run_exitfuncs()
            os._exit(code)
    sys.exit(code)


def _deaf() -> None:
    import signal

    for name in (signal.SIGINT, signal.SIGTERM):
        try:
            signal.signal(name, signal.SIG_IGN)
        except ValueError:
            # Not in the main thread, which has the signals.
            return

"""Decodes one binary file in a process of its own; run by `isolated`, never imported.

A damaged file can make a decoder panic where it can only abort, or ask for any amount of memory. Here that
ends this process and not the user's. On standard output come messages, each a length (4 bytes, little
endian) and JSON; standard input carries a line for each time that members are wanted, until it is closed.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
from importlib import import_module
from time import process_time
from typing import Any, Final

_REQUESTS: Final = 20
"""Times the processor time of one answer that all of them may take."""


def say(message: dict[str, Any]) -> None:
    """Sends one message."""
    text = json.dumps(message).encode()
    os.write(ANSWERS, len(text).to_bytes(4, "little") + text)


def cap(kind: str, wanted: int, highest: int) -> None:
    """Caps a resource of this process, where the system can; the cap can be raised up to `highest` later."""
    try:
        import resource
    except ImportError:
        return
    number = getattr(resource, kind, None)
    if number is None:
        return
    _, hard = resource.getrlimit(number)
    most = highest if hard == resource.RLIM_INFINITY else min(highest, hard)
    # Some systems know a limit by name only, and refuse to set it.
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(number, (min(wanted, most), most))


def send(columns: list[list[Any]]) -> None:
    """Sends the length of every column, then their values as float64 in that order."""
    say({"rows": [sum(len(part) for part in column) for column in columns]})
    for column in columns:
        for part in column:
            left = memoryview(part).cast("B")
            while left:
                left = left[os.write(ANSWERS, left) :]


def main() -> None:
    """Answers one file: its members, then the values of those wanted, as often as some are."""
    task = json.loads(sys.argv[1])
    sys.path[:] = task["path"]
    # A damaged file can ask for any amount of memory, or send a reader round in circles.
    described, unpacked = task["memory"]
    cap("RLIMIT_CPU", task["seconds"], _REQUESTS * task["seconds"])
    cap("RLIMIT_AS", described, unpacked)
    refused: type[BaseException] = KeyboardInterrupt
    try:
        reader = import_module(f"pmsm_rs.io.formats.decoders.{task['decoder']}")
        member = import_module("pmsm_rs.io.formats.member")
        selection = import_module("pmsm_rs.io.formats.selection").Selection
        refused = member.Refused
        table = reader.Table(task["file"], task["max_bytes"], **task["given"])
        import_module("pmsm_rs.io.formats.gate").few_enough(len(table.members))
        say({"members": [vars(entry) for entry in table.members]})
        for line in sys.stdin:
            asked = json.loads(line)
            wanted = [
                member.Wanted(index, column, selection(*part), gaps) for index, column, gaps, *part in asked
            ]
            cap("RLIMIT_CPU", int(process_time()) + task["seconds"], _REQUESTS * task["seconds"])
            cap("RLIMIT_AS", unpacked, unpacked)
            try:
                send(table.read(wanted))
            except refused as error:
                say({"refused": vars(error)})
    except refused as error:
        say({"refused": vars(error)})
    except MemoryError:
        say({"damaged": "it asks for more memory than is allowed"})
    except BaseException as error:
        # A panic of a native library is no Exception; whatever it was, the file is at fault.
        lines = str(error).strip().splitlines()
        say({"damaged": lines[0][:120] if lines else type(error).__name__})


if __name__ == "__main__":
    # Libraries that print would garble the answers, so those go through a pipe of their own.
    ANSWERS = os.dup(1)
    os.dup2(2, 1)
    main()

"""Decodes one binary file in a process of its own; run by `isolated`, never imported.

A damaged file can make a decoder panic where it can only abort, or ask for any amount of memory. Here that
ends this process and not the user's. On standard output come messages, each a length (4 bytes, little
endian) and JSON; standard input carries one line with the columns wanted.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
from importlib import import_module
from typing import Any


def say(message: dict[str, Any]) -> None:
    """Sends one message."""
    text = json.dumps(message).encode()
    os.write(ANSWERS, len(text).to_bytes(4, "little") + text)


def limit(memory: int, seconds: int) -> None:
    """Caps the address space and the processor time of this process, where the system can."""
    try:
        import resource
    except ImportError:
        return
    # A damaged file can ask for any amount of memory, or send a reader round in circles.
    for kind, wanted in ((resource.RLIMIT_AS, memory), (resource.RLIMIT_CPU, seconds)):
        _, hard = resource.getrlimit(kind)
        allowed = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
        # Some systems know a limit by name only, and refuse to set it.
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(kind, (allowed, hard))


def send(parts: dict[str, list[Any]]) -> None:
    """Sends the length of every column, then their values as float64 in that order."""
    say({"rows": {name: sum(len(part) for part in column) for name, column in parts.items()}})
    for column in parts.values():
        for part in column:
            left = memoryview(part).cast("B")
            while left:
                left = left[os.write(ANSWERS, left) :]


def main() -> None:
    """Answers one file: its columns, then the values of those wanted."""
    task = json.loads(sys.argv[1])
    sys.path[:] = task["path"]
    limit(task["memory"], task["seconds"])
    refused: type[BaseException] = KeyboardInterrupt
    try:
        reader = import_module(f"pmsm_rs.formats.decoders.{task['decoder']}")
        refused = import_module("pmsm_rs.formats.decoders").Refused
        table = reader.Table(task["file"], task["max_bytes"])
        say({"columns": table.columns})
        wanted = json.loads(sys.stdin.readline() or "[]")
        if wanted:
            send(table.read(wanted))
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

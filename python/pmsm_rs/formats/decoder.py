"""Decodes a Parquet or Arrow file in a process of its own; run by `isolated`, never imported.

A damaged file can make the decoder panic where Rust can only abort, or ask for any amount of memory. Here
that ends this process and not the user's. On standard output come messages, each a length (4 bytes, little
endian) and JSON; standard input carries one line with the columns wanted.
"""

from __future__ import annotations

import json
import sys
from typing import Any

_BATCH_ROWS = 65_536
_NUMBER_BYTES = 8


def say(message: dict[str, Any]) -> None:
    """Sends one message."""
    text = json.dumps(message).encode()
    sys.stdout.buffer.write(len(text).to_bytes(4, "little") + text)
    sys.stdout.buffer.flush()


def limit(memory: int) -> None:
    """Caps the address space of this process, where the system can."""
    try:
        import resource
    except ImportError:
        return
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(
        resource.RLIMIT_AS, (memory if hard == resource.RLIM_INFINITY else min(memory, hard), hard)
    )


def open_reader(file: str, kind: str) -> Any:
    """The file as a stream of record batches."""
    import arro3.io

    if kind == "parquet":
        return arro3.io.read_parquet(file, batch_size=_BATCH_ROWS)
    return (arro3.io.read_ipc if kind == "file" else arro3.io.read_ipc_stream)(file)


def plain(kind: Any) -> bool:
    """Whether a column of this Arrow type holds real numbers."""
    types = type(kind)
    return bool(types.is_floating(kind) or types.is_integer(kind) or types.is_boolean(kind))


def send(file: str, kind: str, wanted: list[str], max_bytes: int) -> None:
    """Sends the columns wanted as float64, or the place of the first missing value."""
    import numpy as np

    parts: dict[str, list[Any]] = {name: [] for name in wanted}
    rows = 0
    for batch in open_reader(file, kind):
        for name in wanted:
            column = batch.column(name)
            if column.null_count:
                gap = next(row for row, value in enumerate(iter(column)) if value.as_py() is None)
                say({"missing": name, "row": rows + gap})
                return
            parts[name].append(np.ascontiguousarray(column.to_numpy(), dtype="<f8"))
        rows += batch.num_rows
        if rows * _NUMBER_BYTES * len(wanted) > max_bytes:
            say({"too_large": True})
            return
    say({"rows": rows})
    for name in wanted:
        for part in parts[name]:
            sys.stdout.buffer.write(part.data)
    sys.stdout.buffer.flush()


def main() -> None:
    """Answers one file: its schema, then the columns wanted."""
    task = json.loads(sys.argv[1])
    sys.path[:] = task["path"]
    limit(task["memory"])
    try:
        schema = open_reader(task["file"], task["kind"]).schema
        fields = [schema.field(i) for i in range(len(schema.names))]
        say(
            {"names": [str(field.name) for field in fields], "plain": [plain(field.type) for field in fields]}
        )
        wanted = json.loads(sys.stdin.readline() or "[]")
        if wanted:
            send(task["file"], task["kind"], wanted, task["max_bytes"])
    except BaseException as error:
        # A panic of the Arrow library is no Exception; whatever it was, the file is at fault.
        lines = str(error).strip().splitlines()
        say({"damaged": lines[0][:120] if lines else type(error).__name__})


if __name__ == "__main__":
    main()

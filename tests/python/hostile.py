"""Small files that ask for far more than their size; none may end, fill or stall a reader."""

from __future__ import annotations

import io
import json
import struct
import warnings
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Final

NAMES: Final = ("t", "v_d", "v_q", "i_d", "i_q", "omega_e")
MACHINE: Final = b"""[machine]
n_p = 4
r_s = 0.17
l_d = 0.0019
l_q = 0.0019
psi_m = 0.192
[load]
kind = "unknown_constant"
"""


def _csv(header: str, middle: str = "", rows: int = 100) -> bytes:
    lines = [f"{1e-4 * k:.4f},1,2,3.{k % 7},4,100" for k in range(rows)]
    return "\n".join(
        [header, *lines[: rows // 2], *([middle] if middle else []), *lines[rows // 2 :], ""]
    ).encode()


def _table(names: list[str], rows: int = 20) -> bytes:
    ones = ",".join(["1"] * (len(names) - 1))
    return "\n".join([",".join(names), *(f"{1e-4 * k:.4f},{ones}" for k in range(rows)), ""]).encode()


def _wide(columns: int, rows: int) -> bytes:
    more = [f"x{k}" for k in range(columns - len(NAMES))]
    row = ",".join(["1"] * len(more))
    lines = [f"{1e-4 * k:.4f},1,2,3.{k % 7},4,100,{row}" for k in range(rows)]
    return "\n".join([",".join([*NAMES, *more]), *lines, ""]).encode()


def _with_states(columns: int, rows: int, *, one_a_row: bool) -> bytes:
    """A wide table with text among its numbers: every 100th column, or another column in each row."""
    lines = _wide(columns, rows).decode().split("\n")
    for k in range(1, rows + 1):
        fields = lines[k].split(",")
        for at in [columns - k] if one_a_row else range(len(NAMES), columns, 100):
            fields[at] = "on"
        # The layout is found by rows of numbers.
        lines[k] = ",".join(fields) if k > 1 or not one_a_row else lines[k]
    return "\n".join(lines).encode()


def sound() -> bytes:
    """A recording that asks for nothing odd."""
    return _csv(",".join(NAMES))


def _npz(*members: tuple[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", method) as archive, warnings.catch_warnings():
        # A name may come twice.
        warnings.simplefilter("ignore", UserWarning)
        for name, content in members:
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), content, method)
    return out.getvalue()


def _npy(header: str, version: int = 1, length: int | None = None) -> bytes:
    text = header.encode()
    size = len(text) if length is None else length
    return b"\x93NUMPY" + bytes([version, 0]) + struct.pack("<H" if version == 1 else "<I", size) + text


def _shape(rows: str, kind: str = "<f8") -> str:
    return f"{{'descr': '{kind}', 'fortran_order': False, 'shape': ({rows},), }}".ljust(117) + "\n"


def _element(kind: int, content: bytes) -> bytes:
    return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)


def _variable(name: bytes, rows: int, values: bytes, flags: int = 6) -> bytes:
    return _element(
        14,
        _element(6, struct.pack("<II", flags, 0))
        + _element(5, struct.pack("<ii", rows, 1))
        + _element(1, name)
        + _element(9, values),
    )


def _mat(*elements: bytes) -> bytes:
    return b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b"".join(elements)


def _packed(element: bytes) -> bytes:
    content = zlib.compress(element, 9)
    return struct.pack("<II", 15, len(content)) + content


def _parquet(footer: bytes) -> bytes:
    return b"PAR1" + footer + struct.pack("<I", len(footer)) + b"PAR1"


def _varint(number: int) -> bytes:
    out = b""
    while number >= 0x80:
        out += bytes([number & 0x7F | 0x80])
        number >>= 7
    return out + bytes([number])


def _footer(rest: bytes) -> bytes:
    """version = 1, then `rest`."""
    return b"\x15\x02" + rest


def _keys(count: int) -> str:
    return ",".join(f'"k{k}":0' for k in range(count))


RECORDINGS: Final[dict[str, tuple[str, Callable[[], bytes]]]] = {
    "a header of 5 000 columns": ("csv", lambda: _wide(5000, 20)),
    "a header of 60 000 columns": ("csv", lambda: _wide(60_000, 4)),
    "20 000 columns of one quantity": (
        "csv",
        lambda: _table([*NAMES, *(f"axis{k}.i_d" for k in range(20_000))]),
    ),
    "20 000 columns in doubt": (
        "csv",
        lambda: _table([*NAMES[:5], *(f"axis{k}.speed" for k in range(20_000))]),
    ),
    "5 000 columns of text": (
        "csv",
        lambda: _table([*NAMES, *(f"x{k}" for k in range(5000))]).replace(b",1,1,1", b",on,on,on"),
    ),
    "60 000 columns, some of text": ("csv", lambda: _with_states(60_000, 4, one_a_row=False)),
    "20 000 columns, text in another one in each row": (
        "csv",
        lambda: _with_states(20_000, 80, one_a_row=True),
    ),
    "blanks in a field": ("csv", lambda: _csv(",".join(NAMES), "0.005,1" + " " * 200_000 + "x,2,3,4,100")),
    "blanks before a percent sign": ("csv", lambda: _csv(",".join(NAMES), " " * 200_000 + "%")),
    "blanks and no percent sign": ("csv", lambda: _csv(",".join(NAMES), " " * 200_000 + "x % 1")),
    "brackets in a header": ("csv", lambda: _csv(",".join(["t" + "[" * 100_000, *NAMES[1:]]))),
    "brackets and blanks in a header": (
        "csv",
        lambda: _csv(",".join(["t [s" + " [" * 50_000 + "]", *NAMES[1:]])),
    ),
    "a name of a megabyte": ("csv", lambda: _csv(",".join([*NAMES[:-1], "x" * 1_000_000]))),
    "a name of many words": ("csv", lambda: _csv(",".join([*NAMES[:-1], "in " * 300_000 + "V"]))),
    "a number of a megabyte": ("csv", lambda: _csv(",".join(NAMES), "0.005,1,2,3,4," + "1" * 1_000_000)),
    "digits and blanks": ("csv", lambda: _csv(",".join(NAMES), "0.005,1,2,3,4," + "1 " * 500_000)),
    "signs and blanks": ("csv", lambda: _csv(" ".join(NAMES).replace(",", " "), "+ " * 500_000)),
    "a quote that does not close": (
        "csv",
        lambda: _csv(",".join(NAMES), '0.005,1,2,3,4,"') + b"1,2\n" * 250_000,
    ),
    "quotes": ("csv", lambda: _csv(",".join(NAMES), '"' * 1_000_001)),
    "commas": ("csv", lambda: _csv(",".join(NAMES), "," * 1_000_000)),
    "commas in the first line": ("csv", lambda: b"," * 1_000_000 + b"\n" + _csv(",".join(NAMES))),
    "blank lines": ("csv", lambda: _csv(",".join(NAMES), "\n" * 1_000_000)),
    "comments": ("csv", lambda: _csv(",".join(NAMES), "#\n" * 500_000)),
    "carriage returns": ("csv", lambda: _csv(",".join(NAMES), "\r" * 1_000_000)),
    "dates": ("csv", lambda: _csv(",".join(["time", *NAMES[1:]]), "1-" * 500_000)),
    "colons": ("csv", lambda: _csv(",".join(["time", *NAMES[1:]]), "1:" * 500_000 + ",1,2,3,4,100")),
    "UTF-16 that is none": ("csv", lambda: b"\xff\xfe" + b"\x00\xd8" * 500_000),
    "200 000 keys, the last doubled": (
        "json",
        lambda: ("{" + _keys(200_000) + ',"k199999":1,"t":[0,1]}').encode(),
    ),
    "200 000 lists, the last doubled": (
        "json",
        lambda: ("{" + _keys(200_000).replace(":0", ":[0]") + ',"k199999":[1]}').encode(),
    ),
    "records of 50 000 names": (
        "json",
        lambda: ("[{" + _keys(50_000) + "},{" + _keys(50_000) + "}]").encode(),
    ),
    "lists without end": ("json", lambda: b'{"t":' + b"[" * 500_000),
    "objects without end": ("json", lambda: b'{"t":' * 200_000),
    "lists within lists": ("json", lambda: b'{"t":' + b"[" * 400 + b"1" + b"]" * 400 + b"}"),
    "a whole number of a megabyte": ("json", lambda: b'{"t":[' + b"1" * 1_000_000 + b"]}"),
    "a number beyond all floats": (
        "json",
        lambda: b'{"t":[0,1],"i_d":[1' + b"0" * 400 + b',1],"omega_e":[1e999,1]}',
    ),
    "half a character in a name": ("json", lambda: b'{"t":[0,1],"\\ud800":[0,1],"i_d":[0,1]}'),
    "a name that steers the terminal": (
        "json",
        lambda: json.dumps(
            {"t": [0.0, 1.0], "\x1b]0;pwned\x07\x1b[2J": [0.0, 1.0], "i_d": [0.0, 1.0]}
        ).encode(),
    ),
    "a header of 4 GB": ("npz", lambda: _npz(("t", _npy(_shape("60"), 2, 0xFFFFFFF0) + bytes(480)))),
    "a header of brackets": ("npz", lambda: _npz(("t", _npy("(" * 9000 + "\n")))),
    "an array of a gigabyte of zeros": (
        "npz",
        lambda: _npz(("t", _npy(_shape(str(1 << 27))) + bytes(1 << 24))),
    ),
    "an array of 10^100 rows": ("npz", lambda: _npz(("t", _npy(_shape("1" + "0" * 100))))),
    "an array of -1 rows": ("npz", lambda: _npz(("t", _npy(_shape("-1"))))),
    "20 000 arrays": ("npz", lambda: _npz(*((f"x{k}", _npy(_shape("0"))) for k in range(20_000)))),
    "an array of one name twice": (
        "npz",
        lambda: _npz(*((name, _npy(_shape("60")) + bytes(480)) for name in ("t", "i_d", "i_d"))),
    ),
    "an array packed by bzip2": (
        "npz",
        lambda: _npz(("t", _npy(_shape(str(1 << 23))) + bytes(1 << 26)), method=zipfile.ZIP_BZIP2),
    ),
    "a variable of one name twice": (
        "mat",
        lambda: _mat(*(_variable(name, 60, bytes(480)) for name in (b"t", b"i_d", b"i_d"))),
    ),
    "a variable of 2^31 rows": ("mat", lambda: _mat(_variable(b"t", (1 << 31) - 1, bytes(480)))),
    "a variable of zeros": ("mat", lambda: _mat(_packed(_variable(b"t", 1 << 23, bytes(1 << 26))))),
    "a variable of one letter": ("mat", lambda: _mat(*[_element(14, b"")] * 100_000)),
    "20 000 variables": (
        "mat",
        lambda: _mat(*(_packed(_variable(b"x%d" % k, 0, b"")) for k in range(20_000))),
    ),
    "a name of letters beyond ASCII": ("mat", lambda: _mat(_variable(b"\xff\x1b[2J", 60, bytes(480)))),
    "a footer that nests": ("parquet", lambda: _parquet(_footer(b"\x1c" * 5000))),
    "a footer of lists that nest": ("parquet", lambda: _parquet(_footer(b"\x19" + b"\x19" * 5000))),
    "a footer of 60 million structures": (
        "parquet",
        lambda: _parquet(_footer(b"\x19\xfc" + _varint(60_000_000) + bytes(60_000_000))),
    ),
    "a footer of 7 million structures": (
        "parquet",
        lambda: _parquet(
            _footer(b"\x19\xfc" + _varint(7_000_000) + bytes(7_000_000) + b"\x16\x02\x19\x0c\x00")
        ),
    ),
    "a footer of 7 million truth values": (
        "parquet",
        lambda: _parquet(
            _footer(b"\x19\xf1" + _varint(7_000_000) + b"\1" * 7_000_000 + b"\x16\x02\x19\x0c\x00")
        ),
    ),
}
"""Per kind the suffix of the recording and its content."""

MACHINES: Final[dict[str, Callable[[], bytes]]] = {
    "a whole number of 190 digits": lambda: MACHINE.replace(b"0.17", b"1" + b"0" * 190),
    "a whole number of 100 000 digits": lambda: MACHINE.replace(b"0.17", b"1" + b"0" * 100_000),
    "the largest whole number": lambda: MACHINE.replace(b"n_p = 4", b"n_p = 9223372036854775807"),
    "keys that nest": lambda: MACHINE + b"[x]\n" + b"a." * 400_000 + b"a = 1\n",
    "tables that nest": lambda: b"[" + b"a." * 400_000 + b"a]\n" + MACHINE,
    "lists that nest": lambda: MACHINE + b"x = " + b"[" * 100_000 + b"\n",
    "inline tables that nest": lambda: MACHINE + b"[x]\nx = " + b"{a=" * 100_000 + b"\n",
    "50 000 columns": lambda: MACHINE + b"[columns]\n" + b"".join(b'i_%d = "a"\n' % k for k in range(50_000)),
    "a table of a megabyte": lambda: MACHINE + b"[" + b"machin" * 100_000 + b"]\n",
    "a unit of a megabyte": lambda: (
        MACHINE + b'[columns]\ni_d = { from = "i_d", unit = "' + b"m" * 900_000 + b'" }\n'
    ),
    "a name of a megabyte": lambda: MACHINE + b'[columns]\ni_d = "' + b"[:,1" * 200_000 + b'"\n',
    "a part of many blanks": lambda: MACHINE + b'[columns]\ni_d = "x[' + b" " * 500_000 + b':"\n',
    "names that steer the terminal": lambda: MACHINE + b'[columns]\n"\\u001b[2J" = "x"\n',
    "a string that does not close": lambda: MACHINE + b'x = """' + b'\\"' * 400_000,
    "many tables of one list": lambda: MACHINE + b"[[x]]\n" * 150_000,
}
"""Machine files that ask for more than their size."""

STREAMS: Final[dict[str, Callable[[], bytes]]] = {
    "a header of 100 000 names": lambda: (
        ",".join([*NAMES, *(f"x{k}" for k in range(100_000))]).encode() + b"\n" + b"1," * 100_005 + b"1\n"
    ),
    "a header of 100 000 like names": lambda: b"t," + b",".join(b"i_d%d" % k for k in range(100_000)) + b"\n",
    "a name of 140 000 characters": lambda: b't,"' + b"x" * 140_000 + b'",i_d\n0,1,2\n',
    "a plain name of 140 000 characters": lambda: b"t," + b"x" * 140_000 + b",i_d\n0,1,2\n",
    "an object of 60 000 names": lambda: ("{" + _keys(60_000) + "}\n").encode() * 2,
    "an object that nests": lambda: b'{"t":' * 100_000 + b"\n",
    "a whole number of 100 000 digits": lambda: b'{"t":' + b"1" * 100_000 + b"}\n",
    "a line without end": lambda: b"t,i_d" + b"1" * 20_000_000,
    "NUL bytes": lambda: bytes(5_000_000),
    "line feeds": lambda: b"\n" * 3_000_000,
    "half a character": lambda: b'{"t":0,"\\ud800":1}\n{"t":0,"\\ud800":1}\n',
    "quotes": lambda: b"t,i_d,v_d\n" + b'0,"' + b'""' * 200_000 + b"\n",
    "a header that steers the terminal": lambda: b"t,\x1b[2J,i_d\n0,x\x1b[2J,1\n",
}
"""What comes on the standard input of `track -`."""


def write(folder: Path, name: str, suffix: str, content: bytes) -> Path:
    """Writes a file of a name that says its kind."""
    path = folder / f"{name.replace(' ', '_').replace(',', '').replace('^', '')}.{suffix}"
    path.write_bytes(content)
    return path

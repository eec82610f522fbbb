"""Small files that declare, repeat or nest far more than they hold are answered in little memory and time."""

from __future__ import annotations

import io
import json
import os
import struct
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pmsm_rs as pm
import pyarrow as pa
import pyarrow.parquet
import pytest
import scipy.io
from bad_files import write_feather, write_mdf, write_tdms
from conftest import MACHINE, PACKAGE, csv_text, plausible

MEMORY = 3 << 30
# Bytes that reading may take beyond what Python and the libraries take: a small multiple of the files.
RESIDENT = 700 << 20
# s of processor time, for a file; a reader that goes over a line again and again takes minutes.
SECONDS = 10.0
READ_ALL = """
import json, resource, sys
resource.setrlimit(resource.RLIMIT_AS, ({memory}, {memory}))
sys.path.insert(0, {package!r})
import pmsm_rs as pm
def used():
    both = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    seconds = sum(one.ru_utime + one.ru_stime for one in both)
    # The peak in `resource` begins with that of the process that started this one.
    status = open("/proc/self/status").read()
    own = int(status.split("VmHWM:")[1].split()[0])
    return seconds, max(own, both[1].ru_maxrss) << 10
for path in json.load(sys.stdin):
    before, _ = used()
    try:
        answer = ["read", repr(pm.load(path, pm.Machine(n_p=3)))]
    except pm.PmsmError as error:
        answer = [type(error).__name__, str(error)]
    except BaseException as error:
        answer = ["escaped", f"{{type(error).__name__}}: {{error}}"]
    seconds, resident = used()
    print(json.dumps([path, *answer, seconds - before, resident]), flush=True)
"""
ROWS = 60


def lines() -> list[str]:
    return csv_text(plausible(ROWS)).splitlines()


def widened(columns: int) -> bytes:
    """A text with this many further columns and few rows."""
    head, *rows = lines()
    names = ",".join(f"x{k}" for k in range(columns))
    return "\n".join([f"{head},{names}", *(row + ",1" * columns for row in rows[:20])]).encode()


def within(line: str) -> bytes:
    """A text with one further line."""
    table = lines()
    return "\n".join([*table[:30], line, *table[30:]]).encode()


def headed(name: str) -> bytes:
    """A text with one further column of that name."""
    head, *rows = lines()
    return "\n".join([f"{head},{name}", *(row + ",1" for row in rows)]).encode()


def npz(changed: dict[str, bytes]) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, values in plausible(ROWS).items():
            member = io.BytesIO()
            np.lib.format.write_array(member, values)
            archive.writestr(f"{name}.npy", changed.get(name, member.getvalue()))
    return out.getvalue()


def declared(rows: bytes) -> bytes:
    """An array that declares this shape."""
    member = io.BytesIO()
    np.lib.format.write_array(member, np.zeros(ROWS))
    return member.getvalue().replace(b"(60,), }" + b" " * (len(rows) - 5), rows + b", }")


def varint(value: int) -> bytes:
    out = b""
    while value >= 0x80:
        out, value = out + bytes([value & 0x7F | 0x80]), value >> 7
    return out + bytes([value])


def footer(body: bytes) -> bytes:
    """A Parquet file that is nothing but a footer."""
    return b"PAR1" + bytes(4) + body + struct.pack("<I", len(body)) + b"PAR1"


def repeated(items: int, item: bytes) -> bytes:
    """A list of structures in the compact protocol of Thrift."""
    return b"\xfc" + varint(items) + item * items


def mat(**changed: np.ndarray) -> bytes:
    out = io.BytesIO()
    scipy.io.savemat(out, {**plausible(ROWS), **changed}, do_compression=True, oned_as="column")
    return out.getvalue()


def lists(more: str) -> bytes:
    return (json.dumps({k: x.tolist() for k, x in plausible(ROWS).items()})[:-1] + f", {more}}}").encode()


def files() -> Iterator[tuple[str, bytes, str]]:
    """File name, bytes, and words of the refusal, or "read" where the wanted columns are sound."""
    yield "wide_5000.csv", widened(5000), "read"
    yield "wide_60000.csv", widened(60_000), "read"
    yield "spaces.csv", within("0.5,1,2,3" + " " * 200_000 + "x,4,5,6"), "no number"
    yield "blanks.txt", within("1" + " \t" * 100_000 + "2 3").replace(b",", b" "), ""
    yield "empty_lines.csv", within("\n" * 200_000 + "1%"), "fields"
    yield "brackets.csv", headed("x" + "[" * 100_000), "read"
    yield "brackets_and_spaces.csv", headed("x" + "[ " * 50_000 + "]x"), "read"
    yield "header_of_spaces.csv", headed("a" + " " * 200_000 + "b"), "read"
    yield "header_of_in.csv", headed("in " * 70_000), "read"
    yield "digits.csv", within("1" * 200_000 + "x,1,2,3,4,5,6"), "no number"
    yield "quotes.csv", within('"' + "1" * 200_000 + '",1,2,3,4,5,6'), ""
    scope = "X,CH1,Start,Increment\nSequence,V,0," + " " * 200_000 + "x\n0,1\n1,2\n"
    yield "counted.csv", scope.encode(), ""
    keys = ", ".join(f'"k{k}": [1]' for k in range(100_000))
    yield "keys.json", lists(f'{keys}, "k99999": [2]'), "read"
    yield "scalars.json", lists(keys.replace("[1]", "1") + ', "k99999": 2'), "read"
    group = "g" * 200_000
    inner = ", ".join(f'"k{k}": [1]' for k in range(10_000))
    yield "long_group.json", lists(f'"{group}": {{{inner}}}'), "200000 characters"
    yield "deep.json", lists('"x": ' + "[" * 900 + "]" * 900), "read"
    yield "digits.json", lists('"i_0": ' + "9" * 100_000), ""
    huge = b"\x93NUMPY\x02\x00" + struct.pack("<I", 4_000_000_000) + b" " * (64 << 20)
    yield "header.npz", npz({"i_q": huge}), "declares 4000000000 bytes"
    yield "shape.npz", npz({"i_q": declared(b"(200000000000,)")}), "max_bytes"
    yield "zeros.mat", mat(spare=np.zeros(20_000_000)), "read"
    yield "zeros_wanted.mat", mat(i_q=np.zeros(400_000_000, "i1")), "max_bytes"
    plain = io.BytesIO()
    scipy.io.savemat(plain, dict(plausible(ROWS)), oned_as="column")
    sizes = struct.pack("<IIii", 5, 8, ROWS, 1)
    lie = plain.getvalue().replace(sizes, struct.pack("<IIii", 5, 8, 2**31 - 1, 1))
    yield "sizes.mat", lie, "max_bytes"
    version, groups = b"\x15\x02", b"\x16\x02\x19\x0c\0"
    yield "empty_structures.parquet", footer(version + b"\x19" + repeated(3_000_000, b"\0") + groups), ""
    one = b"\x19\x1c\x3c\x66\x02\0\0\0"
    yield "row_groups.parquet", footer(version + b"\x26\x02\x19" + repeated(300_000, one) + b"\0"), ""
    yield "empty_groups.parquet", footer(version + b"\x26\x02\x19" + repeated(3_000_000, b"\0") + b"\0"), ""
    yield "nested_lists.parquet", footer(version + b"\x19" + b"\x19" * 5000), "nested too deeply"
    yield "long_footer.parquet", footer(bytes(60 << 20)), "footer"
    out = io.BytesIO()
    pyarrow.parquet.write_table(pa.table(plausible(ROWS)), out)
    more = out.getvalue().replace(b"\x16\x78", b"\x16\xfe\xff\xff\xff\xff\x1f")
    end = more[:-8] + struct.pack("<I", struct.unpack("<I", more[-8:-4])[0] + len(more) - len(out.getvalue()))
    yield "rows.parquet", end + b"PAR1", "max_bytes"


def written(folder: Path) -> Iterator[tuple[Path, str]]:
    """Files of the formats that need a library to write them."""
    path = folder / "declared.h5"
    with h5py.File(path, "w") as file:
        for name, values in plausible(ROWS).items():
            if name != "i_q":
                file[name] = values
        file.create_dataset("i_q", shape=(10**12,), dtype="f8", chunks=(1 << 20,))
    yield path, "max_bytes"
    rows = ROWS.to_bytes(8, "little")
    for path, write in (
        (folder / "r.tdms", write_tdms),
        (folder / "r.mf4", write_mdf),
        (folder / "r.feather", write_feather),
    ):
        write(path, dict(plausible(ROWS)))
        path.write_bytes(path.read_bytes().replace(rows, (1 << 40).to_bytes(8, "little")))
        yield path, ""


def test_nothing_takes_more_than_its_size_warrants(tmp_path: Path) -> None:
    if not Path("/proc/self/status").exists():
        pytest.skip("this system does not tell the peak memory of a process")
    expected = {}
    for name, data, says in files():
        (tmp_path / name).write_bytes(data)
        expected[str(tmp_path / name)] = says
    expected |= {str(path): says for path, says in written(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", READ_ALL.format(memory=MEMORY, package=str(PACKAGE.parent))],
        input=json.dumps(list(expected)),
        capture_output=True,
        text=True,
        check=False,
    )
    answers = [json.loads(line) for line in done.stdout.splitlines()]
    assert done.returncode == 0, f"Python ended behind {answers[-1:]}: {done.stderr[-400:]}"
    assert len(answers) == len(expected)
    wrong = []
    for path, kind, text, seconds, resident in answers:
        says = expected[path]
        right = kind == "read" if says == "read" else kind == "DataError" and says in text
        if not right or seconds > SECONDS or resident > RESIDENT or (kind != "read" and len(text) > 2000):
            wrong.append((Path(path).name, kind, text[:200], seconds, resident))
    assert not wrong


def test_an_array_that_is_large_only_by_its_strides() -> None:
    endless = np.broadcast_to(np.float64(1.0), (10**12,))
    with pytest.raises(pm.DataError, match="max_bytes"):
        pm.load({**plausible(ROWS), "i_q": endless})


def test_a_stream_without_end_is_refused_when_it_has_more_than_allowed() -> None:
    table = pa.table(plausible(1000))

    def batches() -> Iterator[pa.RecordBatch]:
        for _ in range(10**6):
            yield from table.to_batches()

    stream = pa.RecordBatchReader.from_batches(table.schema, batches())
    with pytest.raises(pm.DataError, match="max_bytes"):
        pm.load(stream, max_bytes=10_000_000)


@pytest.mark.parametrize(
    "header",
    [
        "t,i_d," + ",".join(f"x{k}" for k in range(100_000)),
        "t,i_d," + "x" * 140_000,
        't,i_d,"' + "x" * 140_000 + '"',
    ],
    ids=["many names", "a long name", "a long name in quotes"],
)
def test_a_stream_with_an_odd_header_is_answered_soon(header: str, tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text(MACHINE)
    path = f"import sys; sys.path.insert(0, {str(PACKAGE.parent)!r})"
    run = f"{path}; from pmsm_rs.cli import main; main(sys.argv[1:])"
    done = subprocess.run(
        [sys.executable, "-c", run, "track", "-", "--machine", str(tmp_path / "m.toml")],
        input=f"{header}\n0,1,2\n".encode(),
        capture_output=True,
        check=False,
        timeout=60,
    )
    assert done.returncode in (3, 4), done.stderr
    assert done.stderr.count(b"\n") <= 1
    assert len(done.stderr) < 4000


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_pipes_and_devices_are_no_files(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    (tmp_path / "m.toml").write_text(MACHINE)
    (tmp_path / "r.csv").write_text(csv_text(plausible()))
    beside = tmp_path / "beside.toml"
    for odd in (pipe, Path("/dev/zero")):
        beside.write_text(f'{MACHINE}[columns]\nv_dc = {{ from = "x", file = "{odd}" }}\n')
        for data, machine in (
            (odd, tmp_path / "m.toml"),
            (tmp_path / "r.csv", odd),
            (tmp_path / "r.csv", beside),
        ):
            with pytest.raises(pm.UsageError, match="a pipe or a device"):
                pm.load(data, machine)
        with pytest.raises(pm.UsageError, match="a pipe or a device"):
            pm.diagnose_many([tmp_path / "r.csv"], tmp_path / "m.toml", ledger=odd)

"""None of some two hundred bad files is accepted or ends Python, with 3 GB of memory for everything."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pmsm_rs as pm
import pytest
from bad_files import TABLES, WRITERS, Bad, bad_files, sound
from conftest import PACKAGE

MEMORY = 3 << 30
READ_ALL = """
import json, resource, sys
resource.setrlimit(resource.RLIMIT_AS, ({memory}, {memory}))
sys.path.insert(0, {package!r})
import pmsm_rs as pm
for path in json.load(sys.stdin):
    print(json.dumps(path), flush=True)
    try:
        answer = ["accepted", repr(pm.load(path, pm.Machine(n_p=3)))]
    except pm.PmsmError as error:
        answer = [type(error).__name__, str(error)]
    except BaseException as error:
        answer = ["escaped", f"{{type(error).__name__}}: {{error}}"]
    print(json.dumps(answer), flush=True)
"""


@pytest.fixture(scope="module")
def refusals(tmp_path_factory: pytest.TempPathFactory) -> dict[Bad, tuple[str, str]]:
    """Every bad file with what a process of its own, capped in memory, says to it."""
    pytest.importorskip("resource", reason="this system cannot cap the memory of a process")
    files = list(bad_files(tmp_path_factory.mktemp("bad")))
    done = subprocess.run(
        [sys.executable, "-c", READ_ALL.format(memory=MEMORY, package=str(PACKAGE.parent))],
        input=json.dumps([str(bad.file) for bad in files]),
        # numpy's algebra takes address space for every processor, however many there are
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert done.returncode == 0, f"Python ended at {lines[-1]}: {done.stderr[-400:]}"
    said = {path: (kind, text) for path, (kind, text) in zip(lines[::2], lines[1::2], strict=True)}
    return {bad: said[str(bad.file)] for bad in files}


def test_there_are_enough_of_them(refusals: dict[Bad, tuple[str, str]]) -> None:
    assert len(refusals) >= 100
    assert len(Counter(bad.kind for bad in refusals)) >= 25
    assert {bad.file.suffix.removeprefix(".") for bad in refusals} >= set(TABLES)


def test_none_is_accepted_and_none_escapes(refusals: dict[Bad, tuple[str, str]]) -> None:
    wrong = [(bad.kind, bad.file.name, said) for bad, said in refusals.items() if said[0] != "DataError"]
    assert not wrong


def test_every_refusal_names_file_and_fix(refusals: dict[Bad, tuple[str, str]]) -> None:
    wrong = []
    for bad, (_, text) in refusals.items():
        told = text.startswith(str(bad.file)) and "; " in text and "\n" not in text
        if not told or any(word.lower() not in text.lower() for word in bad.words):
            wrong.append((bad.kind, bad.words, text))
    assert not wrong


@pytest.mark.parametrize("suffix", WRITERS)
def test_what_the_bad_files_were_made_from_is_sound(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"sound.{suffix}"
    WRITERS[suffix](path, sound())
    recording = pm.load(path, pm.Machine(n_p=3))
    for name, values in sound().items():
        np.testing.assert_allclose(recording.column(name), values, rtol=1e-12, atol=1e-12)

"""`pmsm-rs doctor`: what an installation is made of, and what is wrong with it."""

from __future__ import annotations

import getpass
import json
import platform
import re
import tomllib
from collections.abc import Callable
from dataclasses import replace
from importlib import metadata
from typing import Any

import pmsm_rs as pm
import pytest
from conftest import ROOT, Ran
from pmsm_rs import _core
from pmsm_rs.support import doctor

Run = Callable[..., Ran]
WIDTHS = {"portable": 1, "sse2": 2, "avx2": 4, "avx512": 8}


@pytest.fixture(autouse=True)
def runtime(monkeypatch: pytest.MonkeyPatch) -> Any:
    """What the core runs on is the same for these tests on every processor; gives what the core says."""
    real = getattr(_core, "runtime", None)
    monkeypatch.setattr(_core, "runtime", lambda: ("avx2", 4, 2), raising=False)
    return real


@pytest.fixture
def found(runtime: Any) -> doctor.Installation:
    return doctor.examine()


def test_the_core_says_what_it_runs_on(runtime: Any) -> None:
    if runtime is None:
        pytest.skip("the compiled core is older than the Python files")
    instructions, width, threads = runtime()
    assert WIDTHS[instructions] == width
    assert threads >= 1
    if platform.machine().lower() in {"x86_64", "amd64"}:
        assert instructions != "portable"


def test_a_sound_installation(found: doctor.Installation) -> None:
    assert found.is_sound, found
    assert found.version == pm.__version__
    assert found.python.startswith(platform.python_version())
    assert {library.name: library.version for library in found.libraries} == {
        name: metadata.version(name) for name in doctor.REQUIRED
    }
    text = str(found)
    assert text.startswith("The installation is sound.")
    for words in (found.version, "AVX2 with FMA, 4 numbers at a time", "threads", "Parquet", "NI TDMS"):
        assert words in text


def test_a_core_of_another_build_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(_core, "runtime")
    found = doctor.examine()
    assert not found.is_sound
    assert "the compiled core is older than the Python files; build the package again" in str(found)


def test_it_names_nobody_and_no_folder(found: doctor.Installation) -> None:
    text = found.to_json()
    assert str(ROOT) not in text
    assert platform.node() not in text
    assert not re.search(rf"\b{re.escape(getpass.getuser())}\b", text)


def test_it_looks_at_what_the_package_declares() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    needed = {re.split(r"[<>=\[]", line)[0] for line in project["dependencies"]}
    assert {*doctor.REQUIRED} == needed
    extras = project["optional-dependencies"]
    for name, (library, _, extra) in doctor.OPTIONAL.items():
        assert any(line.startswith(library) for line in extras[extra]), name


def test_a_missing_library_is_told_with_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    real = doctor.find_spec
    monkeypatch.setattr(doctor, "find_spec", lambda name: None if name == "nptdms" else real(name))
    found = doctor.examine()
    assert found.is_sound, "a format that needs an extra is no fault"
    (tdms,) = (entry for entry in found.formats if entry.name == "NI TDMS")
    assert not tdms.is_read
    assert tdms.fix == "pip install 'pmsm-rs[tdms]'"
    assert "no: npTDMS is not installed; pip install 'pmsm-rs[tdms]'" in str(found)


def test_a_broken_library_is_told_by_its_error(monkeypatch: pytest.MonkeyPatch, run: Run) -> None:
    real = doctor.import_module

    def broken(name: str) -> object:
        if name in {"h5py", "matplotlib"}:
            raise ImportError("libhdf5.so.310: cannot open shared object file\nmore")
        return real(name)

    monkeypatch.setattr(doctor, "import_module", broken)
    ran = run("doctor")
    assert ran.code == 1, "matplotlib is needed"
    assert ran.out.startswith("Something is wrong with the installation.")
    assert "fails with ImportError: libhdf5.so.310: cannot open shared object file;" in ran.out


def test_what_cannot_be_read_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pmsm_rs.support.demo._FOLDER", ROOT / "absent")
    found = doctor.examine()
    assert not found.is_sound
    assert "reading the demo recording fails with UsageError" in str(found)


def test_plain_text_and_json(run: Run, found: doctor.Installation) -> None:
    plain, data = run("doctor"), run("doctor", "--json", "-")
    assert (plain.code, data.code) == (0, 0)
    assert plain.out == f"{found}\n"
    answer = json.loads(data.out)
    assert answer["schema"] == "pmsm-rs.doctor/1"
    assert answer["sound"] is True
    assert {entry["name"] for entry in answer["formats"]} >= {"CSV", "HDF5", "ASAM MDF"}


def test_a_processor_without_vectors_is_said_so(found: doctor.Installation) -> None:
    text = str(replace(found, instructions="portable", width=1))
    assert "no vector instructions, one number at a time" in text

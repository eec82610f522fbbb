"""What an installation is made of, and what is wrong with it."""

from __future__ import annotations

import os
import platform
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib import import_module, metadata
from importlib.util import find_spec
from typing import Final

from .. import _core
from ..results.estimates import json_text

SCHEMA: Final = "pmsm-rs.doctor/1"

REQUIRED: Final = {
    "numpy": "numpy",
    "click": "click",
    "pydantic": "pydantic",
    "arro3-core": "arro3.core",
    "arro3-io": "arro3.io",
    "matplotlib": "matplotlib",
    "jinja2": "jinja2",
}
"""Distributions that the package needs, and the modules that they bring."""

OPTIONAL: Final = {
    "HDF5": ("h5py", "h5py", "hdf5"),
    "MATLAB v7.3": ("h5py", "h5py", "hdf5"),
    "NI TDMS": ("npTDMS", "nptdms", "tdms"),
    "ASAM MDF": ("asammdf", "asammdf", "mdf"),
}
"""Formats that need a library of their own: its distribution, its module, and the extra that brings it."""

_BUILT_IN: Final = ("CSV", "Parquet", "Feather", "MATLAB .mat", "NumPy .npz", "JSON")
_INSTRUCTIONS: Final = {
    "avx512": "AVX-512",
    "avx2": "AVX2 with FMA",
    "sse2": "SSE2",
    "portable": "no vector instructions",
}


@dataclass(frozen=True)
class Library:
    """A library: its version, None where it is not installed, and what is wrong with it, None if nothing."""

    name: str
    version: str | None
    problem: str | None


@dataclass(frozen=True)
class Format:
    """A file format: whether it is read, by which library, and how to install that where it is missing."""

    name: str
    is_read: bool
    library: str | None = None
    version: str | None = None
    problem: str | None = None
    fix: str | None = None


@dataclass(frozen=True)
class Check:
    """Something that was tried: what it is, and the problem with its way out, None if there is none."""

    name: str
    problem: str | None = None
    fix: str | None = None


@dataclass(frozen=True)
class Installation:
    """What an installation is made of. `instructions` are those that the core uses, `width` the numbers that
    one of them takes, `threads` those of a computation that is not told otherwise. Names no user, host or
    folder.
    """

    version: str
    python: str
    system: str
    instructions: str
    width: int
    threads: int
    libraries: tuple[Library, ...]
    formats: tuple[Format, ...]
    checks: tuple[Check, ...]

    @property
    def is_sound(self) -> bool:
        """Whether all that the package needs works; formats that need an extra do not count."""
        return all(
            problem is None
            for problem in [
                *(library.problem for library in self.libraries),
                *(check.problem for check in self.checks),
            ]
        )

    def to_json(self) -> str:
        """All of it as JSON text."""
        return json_text({"schema": SCHEMA, "sound": self.is_sound, **asdict(self)})

    def __str__(self) -> str:
        lines = [
            "The installation is sound." if self.is_sound else "Something is wrong with the installation.",
            "",
            "Versions",
            f"  {'pmsm-rs':<12}  {self.version}",
            f"  {'Python':<12}  {self.python}",
            f"  {'system':<12}  {self.system}",
        ]
        for library in self.libraries:
            problem = "" if library.problem is None else f", {library.problem}"
            lines.append(f"  {library.name:<12}  {library.version or 'not installed'}{problem}")
        carried = _INSTRUCTIONS.get(self.instructions, self.instructions)
        a_time = "one number" if self.width == 1 else f"{self.width} numbers"
        lines += [
            "",
            "Computing",
            f"  {'instructions':<12}  {carried}, {a_time} at a time",
            f"  {'threads':<12}  {self.threads}",
            "",
            "Formats",
        ]
        for entry in self.formats:
            by = f", by {entry.library} {entry.version}" if entry.version else ""
            state = f"yes{by}" if entry.is_read else f"no: {entry.problem}; {entry.fix}"
            lines.append(f"  {entry.name:<12}  {state}")
        lines += ["", "Tried"]
        for check in self.checks:
            state = "works" if check.problem is None else f"{check.problem}; {check.fix}"
            lines.append(f"  {check.name} {state}")
        return "\n".join(lines)


def examine() -> Installation:
    """What this installation is made of; libraries are imported and the demo recording is read to see whether
    they work.
    """
    # Who builds in place may have a compiled core that is older than the Python files.
    runtime = getattr(_core, "runtime", None)
    instructions, width, threads = ("unknown", 1, 1) if runtime is None else runtime()
    core = Check("the compiled core")
    if runtime is None:
        core = Check(core.name, "is older than the Python files", "build the package again: pip install .")
    return Installation(
        _core.__version__,
        f"{platform.python_version()} ({platform.python_implementation()})",
        f"{platform.system()} {platform.release()}, {platform.machine()}",
        instructions,
        width,
        threads,
        tuple(_library(name, module) for name, module in REQUIRED.items()),
        (
            *(Format(name, is_read=True) for name in _BUILT_IN),
            *(_format(name, *by) for name, by in OPTIONAL.items()),
        ),
        (
            core,
            _tried("reading the demo recording", _read_demo, "install the package again"),
            _tried("writing temporary files", _write_temporary, "name a folder with room by TMPDIR"),
        ),
    )


def _library(name: str, module: str) -> Library:
    """A library by the names of its distribution and its module."""
    try:
        version = metadata.version(name)
    except metadata.PackageNotFoundError:
        version = None
    if find_spec(module.split(".")[0]) is None:
        return Library(name, None, f"install it with: pip install {name}")
    return Library(name, version, _fault(lambda: import_module(module)))


def _format(name: str, library: str, module: str, extra: str) -> Format:
    found = _library(library, module)
    fix = f"pip install 'pmsm-rs[{extra}]'"
    if found.version is None:
        return Format(name, False, library, None, f"{library} is not installed", fix)
    if found.problem is not None:
        return Format(name, False, library, found.version, f"{library} {found.problem}", fix)
    return Format(name, True, library, found.version)


def _tried(name: str, act: Callable[[], object], fix: str) -> Check:
    fault = _fault(act)
    return Check(name) if fault is None else Check(name, fault, fix)


def _fault(act: Callable[[], object]) -> str | None:
    """What goes wrong in `act`, in a few words, None where nothing does."""
    try:
        with warnings.catch_warnings():
            # What a library warns of on import is no business of this package.
            warnings.simplefilter("ignore")
            act()
    except Exception as error:
        lines = str(error).strip().splitlines()
        return f"fails with {type(error).__name__}{f': {lines[0]}' if lines else ''}"
    return None


def _read_demo() -> None:
    from ..io.loader import load
    from .demo import recording_files

    recording, _, machine = recording_files()
    load(recording, machine)


def _write_temporary() -> None:
    with tempfile.TemporaryFile() as file:
        file.write(b"\0" * (1 << 16))
        file.flush()
        os.fsync(file.fileno())

"""A small plausible recording, a machine file, the command line as a function, what is tested and drawn."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

# Several workers share the processors. Threads of numpy's algebra would wait for each other in loops, which
# takes several times the time of one thread.
os.environ["OPENBLAS_NUM_THREADS"] = os.environ.get("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pmsm_rs
import pyarrow.parquet
import pytest
from hypothesis import HealthCheck, settings
from numpy.typing import NDArray
from pmsm_rs.cli import main
from pmsm_rs.support.demo import recording_files

# Hypothesis draws the same cases in every run; `make soak` names the other profile and a seed. The time of a
# case has no limit, as it depends on what else the machine does.
COMMON = settings(
    deadline=None, database=None, print_blob=False, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile("fixed", COMMON, derandomize=True)
settings.register_profile("soak", COMMON, max_examples=1000)
settings.load_profile("fixed")

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = Path(pmsm_rs.__file__).resolve().parent

# Each worker of pytest-xdist keeps the compiled functions of the proof for itself: two that save different
# versions of a function at the same moment give them one name.
if (worker := os.environ.get("PYTEST_XDIST_WORKER")) is not None:
    os.environ.setdefault("NUMBA_CACHE_DIR", str(ROOT / ".pytest_cache" / "numba" / worker))

Columns = dict[str, NDArray[np.float64]]

MACHINE = """
[machine]
r_s = 0.9
l_d = 0.0096
l_q = 0.0213
psi_m = 0.193
n_p = 3
j = 0.0126
b = 0.0017

[load]
kind = "unknown_constant"
"""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--installed", action="store_true", help="refuse to test the source tree instead of the wheel"
    )


# Files whose tests take longest. They come first: else one processor waits for the other at the end.
LONGEST = (
    "test_recordings.py",
    "test_plant.py",
    "test_bad_files.py",
    "test_unmodelled.py",
    "test_hold.py",
    "test_docstrings.py",
    "test_gate.py",
    "test_mistakes.py",
    "test_damage.py",
    "test_bench_logs.py",
    "test_formulas.py",
    "test_core.py",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    place = {name: k for k, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.path.name, len(LONGEST)))


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("--installed") and PACKAGE.is_relative_to(ROOT / "python"):
        raise pytest.UsageError(
            f"pmsm_rs is imported from the source tree, {PACKAGE}; install the wheel instead (make test)"
        )
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        # A shell starts background jobs with Ctrl-C ignored; the tests of Ctrl-C need it to work.
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if not hasattr(config, "workerinput"):
        # Writes the list of fonts before the workers start. Each would write it, and matplotlib says so on
        # standard error where that takes long; tests demand that nothing is said there.
        import_module("matplotlib.font_manager")


def pytest_report_header() -> str:
    return f"pmsm_rs {pmsm_rs.__version__} from {PACKAGE}"


def plausible(n: int = 400) -> Columns:
    """A turning motor with voltages, currents, angle and speed; not a solution of any model."""
    t = np.arange(n) * 1e-3
    omega = 60.0 + 20.0 * np.sin(6.0 * t)
    return {
        "t": t,
        "v_d": 1.0 + np.cos(9.0 * t),
        "v_q": 12.0 + np.sin(5.0 * t),
        "i_d": np.sin(8.0 * t) - 1.0,
        "i_q": 2.0 + np.cos(7.0 * t),
        "theta_e": np.remainder(60.0 * t + 20.0 / 6.0 * (1.0 - np.cos(6.0 * t)), 2.0 * np.pi),
        "omega_e": omega,
    }


@pytest.fixture
def columns() -> Columns:
    return plausible()


@pytest.fixture
def machine_file(tmp_path: Path) -> Path:
    path = tmp_path / "machine.toml"
    path.write_text(MACHINE)
    return path


@pytest.fixture(scope="session")
def short_demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str, str]:
    """The first 0.4 s of the demo recording and of its validation run, and their machine file."""
    folder = tmp_path_factory.mktemp("short")
    *runs, machine = recording_files()
    names = [str(folder / Path(run).name) for run in runs]
    for name, run in zip(names, runs, strict=True):
        pyarrow.parquet.write_table(pyarrow.parquet.read_table(run).slice(0, 4000), name)
    return names[0], names[1], machine


def csv_text(columns: Columns, header: dict[str, str] | None = None, separator: str = ",") -> str:
    """Columns as CSV text with full precision; `header` renames columns."""
    names = [(header or {}).get(name, name) for name in columns]
    rows = [
        separator.join(repr(float(value)) for value in row) for row in zip(*columns.values(), strict=True)
    ]
    return "\n".join([separator.join(names), *rows]) + "\n"


class Ran(NamedTuple):
    code: int
    out: str
    err: str


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Callable[..., Ran]:
    """Runs `pmsm-rs` with the given arguments."""

    def call(*arguments: object) -> Ran:
        with pytest.raises(SystemExit) as stop:
            main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        assert isinstance(stop.value.code, int)
        return Ran(stop.value.code, captured.out, captured.err)

    return call

"""The Rust core: arrays in, results out."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Self, final

import numpy as np
from numpy.typing import NDArray

__version__: str

class PmsmError(Exception):
    """Whatever this package refuses or fails at."""

    @property
    def code(self) -> str | None: ...

class DataError(PmsmError):
    """A recording that cannot be used; attributes row, column, problem and fix where they apply."""

class MachineError(PmsmError):
    """A nameplate or machine file that makes no sense."""

class UsageError(PmsmError):
    """A call that asks for something that does not exist."""

class NotIdentifiableError(PmsmError):
    """The recording does not determine what is asked for."""

    problem: str
    fix: str

class InternalError(PmsmError):
    """A fault of this package, not of the data."""

@final
class Machine:
    """Nameplate of a motor and its drive in SI units; what is unknown is None."""

    def __new__(
        cls,
        *,
        n_p: int,
        r_s: float | None = None,
        l_d: float | None = None,
        l_q: float | None = None,
        psi_m: float | None = None,
        j: float | None = None,
        b: float | None = None,
        v_dc: float | None = None,
        i_rated: float | None = None,
        f_sample: float | None = None,
    ) -> Self: ...
    @property
    def n_p(self) -> int: ...
    @property
    def r_s(self) -> float | None: ...
    @property
    def l_d(self) -> float | None: ...
    @property
    def l_q(self) -> float | None: ...
    @property
    def psi_m(self) -> float | None: ...
    @property
    def j(self) -> float | None: ...
    @property
    def b(self) -> float | None: ...
    @property
    def v_dc(self) -> float | None: ...
    @property
    def i_rated(self) -> float | None: ...
    @property
    def f_sample(self) -> float | None: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...
    def __getnewargs_ex__(self) -> tuple[tuple[()], dict[str, Any]]: ...

class Recording:
    """Checked columns of one run, each of shape (samples,), SI units."""

    def __new__(
        cls,
        columns: Mapping[str, NDArray[np.float64]],
        *,
        load: str | None = None,
        load_value: float | None = None,
        angle_error: float | None = None,
    ) -> Self: ...
    def __len__(self) -> int: ...
    @property
    def names(self) -> list[str]: ...
    def column(self, name: str) -> NDArray[np.float64]: ...
    @property
    def duration(self) -> float: ...
    @property
    def kind(self) -> str: ...
    @property
    def load(self) -> str: ...
    @property
    def load_value(self) -> float | None: ...
    @property
    def angle_error(self) -> float | None: ...

@final
class Fitness:
    def __new__(
        cls, recording: Recording, machine: Machine, fit: Sequence[str], *, threads: int | None = None
    ) -> Self: ...
    def __call__(self, points: NDArray[np.float64]) -> NDArray[np.float64]: ...

def identify(
    recording: Recording,
    machine: Machine,
    *,
    fit: Mapping[str, tuple[float, float] | None],
    method: str,
    swarm: str,
    seed: int,
    uncertainties: bool,
    threads: int | None,
    progress: Callable[[str, float], None] | None,
) -> str: ...
def predict(
    recording: Recording,
    machine: Machine,
    specification: str,
    *,
    one_step: bool,
    threads: int | None,
    progress: Callable[[str, float], None] | None,
) -> dict[str, NDArray[np.float64]]: ...
def respond(
    specification: str,
    t: NDArray[np.float64],
    v_d: NDArray[np.float64],
    v_q: NDArray[np.float64],
    tau_load: NDArray[np.float64],
    *,
    begin: Sequence[float],
    heating: Sequence[float],
    steps: int | None,
) -> tuple[dict[str, NDArray[np.float64]], int]: ...
def equations(specification: str, *, heating: Sequence[float]) -> str: ...
def diagnose(
    recordings: Sequence[Recording],
    machine: Machine,
    validation: Recording | None,
    *,
    options: str,
    seed: int,
    threads: int | None,
    progress: Callable[[str, float], None] | None,
) -> tuple[str, dict[str, dict[str, NDArray[np.float64]]]]: ...
def diagnosis_options() -> str: ...
def refusal(problem: str, fix: str, *, seed: int) -> str: ...

@final
class Tracker:
    """Follows parameters through a stream of samples, window by window."""

    def __new__(
        cls,
        machine: Machine,
        *,
        fit: Mapping[str, tuple[float, float] | None],
        window: float,
        method: str,
        swarm: str,
        search: float,
        seed: int,
        load: str | None,
        load_value: float | None,
    ) -> Self: ...
    def update(self, columns: dict[str, NDArray[np.float64]], *, threads: int | None) -> list[str]: ...
    def follow(self, recording: Recording, first: int, end: int, *, threads: int | None) -> list[str]: ...
    def finish(self, *, threads: int | None) -> list[str]: ...
    def state(self) -> str: ...
    @staticmethod
    def restore(state: str) -> Tracker: ...
    @property
    def machine(self) -> Machine: ...
    @property
    def window(self) -> float: ...
    @property
    def fit(self) -> list[str]: ...

def effect_of_text(definition: str) -> str: ...
def effects() -> str: ...
def runtime() -> tuple[str, int, int]: ...
def simulate(
    machine: Machine,
    nameplate: Machine,
    settings: str,
    *,
    seed: int,
    progress: Callable[[str, float], None] | None,
) -> tuple[Recording, str, dict[str, NDArray[np.float64]]]: ...
def identify_system(
    errors: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    names: Sequence[str],
    bounds: Sequence[tuple[float, float]],
    *,
    outputs: int,
    samples: int,
    start: Sequence[float] | None,
    method: str,
    swarm: str,
    seed: int,
    progress: Callable[[str, float], None] | None,
) -> str: ...

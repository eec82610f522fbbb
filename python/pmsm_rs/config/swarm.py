"""Settings of the particle swarm, and the methods of a search for parameters."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

from .._core import UsageError
from ..errors import did_you_mean, expect, refuse
from .settings import Settings, assignments

METHODS = ("pso", "lm", "pso+lm")


@dataclass(frozen=True)
class Swarm(Settings):
    """Settings of the particle swarm, eq. (5) of Liu, Liu & Cartes (2008), and of its variants.

    Parameters
    ----------
    particles : int, default 30
        Number of particles.
    iterations : int, default 100
        Number of generations.
    inertia : float, default 0.72
        Weight of a particle's own velocity, a pure number.
    cognitive : float, default 1.49
        Weight of the way back to its own best.
    social : float, default 1.49
        Weight of the way to the best it hears of.
    velocity_limit : float, default 0.2
        Largest move, as a share of each parameter's range.
    inertia_schedule : str, default "constant"
        How the inertia goes to `inertia_last`: "constant", "linear" over the iterations, "random" anywhere
        between, or "adaptive" by the share of particles that last got better.
    inertia_last : float or None, default None
        Its last value, with a schedule that is not constant.
    update : str, default "inertia"
        "inertia" (the paper), "constriction" (Clerc & Kennedy 2002) or "fully_informed" (Mendes, Kennedy &
        Neves 2004). The last two need cognitive + social > 4 and have no inertia.
    neighbourhood : str, default "all"
        To whom a particle listens: "all", "ring" or "von_neumann".

    Raises
    ------
    UsageError
        For a name that does not exist.

    Examples
    --------
    >>> import pmsm_rs as pm
    >>> pm.Swarm(particles=10, iterations=30, inertia=0.8, cognitive=2.0, social=2.0).particles
    10
    """

    particles: int = 30
    iterations: int = 100
    inertia: float = 0.72
    cognitive: float = 1.49
    social: float = 1.49
    velocity_limit: float = 0.2
    inertia_schedule: str = "constant"
    inertia_last: float | None = None
    update: str = "inertia"
    neighbourhood: str = "all"

    def __post_init__(self) -> None:
        """Checks the names; the core checks the numbers."""
        for field, known in _SWARM_NAMES.items():
            value = getattr(self, field)
            if value not in known:
                raise refuse(
                    UsageError, f"{field} '{value}' is not known", fix=did_you_mean(str(value), known)
                )
        if (self.inertia_schedule == "constant") != (self.inertia_last is None):
            raise refuse(
                UsageError,
                f"inertia_last is {self.inertia_last} with inertia_schedule '{self.inertia_schedule}'",
                fix="give it with a schedule that is not constant, and only then",
            )

    @cached_property
    def settings(self) -> str:
        """As the core reads it: JSON text."""
        schedule: Any = self.inertia_schedule
        if self.inertia_last is not None:
            schedule = {schedule: {"last": self.inertia_last}}
        plain = ("particles", "iterations", "inertia", "cognitive", "social", "velocity_limit")
        return json.dumps(
            {name: getattr(self, name) for name in (*plain, "update", "neighbourhood")}
            | {"schedule": schedule}
        )

    @classmethod
    def parse(cls, text: str) -> Swarm:
        """Reads settings as on the command line.

        Parameters
        ----------
        text : str
            `name=value,name=value`.

        Returns
        -------
        Swarm
            With the default of what is not named.

        Raises
        ------
        UsageError
            Naming what is wrong.
        """
        kinds = {field.name: field.type for field in fields(cls)}
        given: dict[str, Any] = {}
        for part, name, mark, value in assignments(text):
            if name not in kinds:
                raise refuse(UsageError, f"a swarm has no '{name}'", fix=did_you_mean(name, kinds))
            kind = str(kinds[name])
            try:
                given[name] = value if kind == "str" else (int(value) if kind == "int" else float(value))
            except ValueError:
                mark = ""
            if not mark:
                raise refuse(UsageError, f"'{part}' says no {kind} of the swarm", fix=f"write {name}=...")
        return cls(**given)


_SWARM_NAMES = {
    "inertia_schedule": ("constant", "linear", "random", "adaptive"),
    "update": ("inertia", "constriction", "fully_informed"),
    "neighbourhood": ("all", "ring", "von_neumann"),
}


ORDINARY = Swarm()


def expect_method(method: object) -> None:
    """Raises UsageError unless `method` is one of METHODS."""
    if method not in METHODS:
        raise refuse(UsageError, f"there is no method '{method}'", fix=did_you_mean(str(method), METHODS))


def swarm_settings(swarm: object) -> str:
    """The settings of a swarm as the core reads them. Raises UsageError for what is no Swarm."""
    expect(Swarm, swarm=swarm)
    assert isinstance(swarm, Swarm)
    return swarm.settings

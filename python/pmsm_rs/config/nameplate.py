"""The text of a machine file from what is known of a machine."""

from __future__ import annotations

from .._core import Machine
from ..quantities.parameters import BASE

PARAMETERS = ("n_p", *BASE)
RATINGS = ("v_dc", "i_rated", "f_sample")


def machine_text(machine: Machine, load: str | None, load_value: float | None) -> str:
    """A machine file with the nameplate in SI units and what is known of the load; unknown values are left
    out.
    """
    tables = {
        "machine": {name: getattr(machine, name) for name in PARAMETERS},
        "drive": {name: getattr(machine, name) for name in RATINGS},
        "load": {"kind": None if load is None else f'"{load}"', "value": load_value},
    }
    return "\n".join(
        f"[{table}]\n" + "".join(f"{name} = {value}\n" for name, value in given.items() if value is not None)
        for table, given in tables.items()
    )

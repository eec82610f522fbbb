"""The parameters of the dq-model and their units, as answers write them."""

from __future__ import annotations

from typing import Final

BASE: Final = {
    "r_s": "ohm",
    "l_d": "H",
    "l_q": "H",
    "psi_m": "V s",
    "j": "kg m^2",
    "b": "N m s",
}
"""Units of the base parameters, in the order in which they are listed."""

"""What may be calibrated on, and what scores: kinds of machine and foreign forms are dealt to one side each.

Thresholds, priors and tables of false alarms come from the calibration side alone.  The scoring side has
machines and forms of its own, so that nothing that scores has been seen by what is scored.
"""

from __future__ import annotations

from .foreign import FORMS
from .machines import MACHINES

CALIBRATION_MACHINES = ("hub48", "pump2k", "spindle", "lift")
CALIBRATION_FORMS = (
    "x_friction_hump",
    "x_dahl_presliding",
    "x_angle_friction",
    "x_gear_mesh",
    "x_loose_terminal",
    "x_flux_hysteresis",
    "x_sensor_bow",
)
SPLITS = ("scoring", "calibration", "all")


def side(names: tuple[str, ...], calibration: tuple[str, ...], split: str) -> tuple[str, ...]:
    """Those of the names that belong to a split.  Raises ValueError for an unknown split."""
    if split not in SPLITS:
        raise ValueError(f"no split {split!r}; there are {', '.join(SPLITS)}")
    if split == "all":
        return names
    return tuple(k for k in names if (k in calibration) == (split == "calibration"))


def machines(split: str) -> tuple[str, ...]:
    """Names of the kinds of machine of a split."""
    return side(tuple(MACHINES), CALIBRATION_MACHINES, split)


def forms(split: str) -> tuple[str, ...]:
    """Names of the foreign forms of a split."""
    return side(tuple(FORMS), CALIBRATION_FORMS, split)

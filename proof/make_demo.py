"""Makes the recording that ships with the package: a 2 kW servo whose inverter loses voltage in its dead
time.

python -m proof.make_demo            # from the root of the repository
"""

from __future__ import annotations

import json
import shutil
import tempfile
from pathlib import Path

from .case import make_case, write_text
from .machines import SERVO

FOLDER = Path(__file__).resolve().parent.parent / "python" / "pmsm_rs" / "demo_data"
EFFECT = "dead_time"
# what a drive's own compensation leaves of 540 V · 1 µs · 10 kHz = 5.4 V
PARAMETERS = {"v_err": 0.96}
SEED = 6
LARGEST = 450_000


def main() -> None:
    """Write the demo's four files.  Raises ValueError if a recording outgrows what the package should
    carry."""
    with tempfile.TemporaryDirectory() as work:
        opened, sealed = Path(work, "open"), Path(work, "sealed")
        truth = make_case(
            opened,
            SERVO,
            {EFFECT: PARAMETERS},
            "rich",
            "unknown_constant",
            SEED,
            truth_folder=sealed,
            duration=2.0,
        )
        FOLDER.mkdir(parents=True, exist_ok=True)
        for name in ("recording.parquet", "validation.parquet", "machine.toml"):
            size = (opened / name).stat().st_size
            if size > LARGEST:
                raise ValueError(f"{name} has {size} bytes; at most {LARGEST} are wanted")
            shutil.copy(opened / name, FOLDER / f".{name}")
            (FOLDER / f".{name}").replace(FOLDER / name)
    found = {
        "effect": EFFECT,
        "parameters": {"v_err": truth["parameters"][EFFECT]["v_err"]},
        "base_true": truth["base_true"],
        "how": (
            "Simulated by proof/plant.py, which shares no equations or code with the package: line flux "
            "linkages from a co-energy, three inverter legs that lose voltage against their current, "
            "adaptive integration, closed-loop control, and sensor noise and quantisation like a bench's."
        ),
    }
    write_text(FOLDER / "sealed.json", json.dumps(found, indent=2) + "\n")
    for name, run in truth["runs"].items():
        print(f"{name}: plain machine leaves {run['plain_refit']} times the noise after a re-fit")


if __name__ == "__main__":
    main()

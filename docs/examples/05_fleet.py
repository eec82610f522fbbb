"""
Many recordings
===============

Each is diagnosed by itself; one that is refused does not stop the others, and a ledger remembers what is
done.
"""

import tempfile
from pathlib import Path

import numpy as np
import pmsm_rs as pm

folder = Path(tempfile.mkdtemp())
machine = pm.Machine(n_p=4, j=0.0126, b=0.0017)
files = []
for k in range(4):
    t = np.arange(1000) * 1e-3
    noise = 0.05 * np.random.default_rng(k).standard_normal(1000)
    omega = 40.0 + 30.0 * np.sin(5.0 * t) + noise
    tau = 0.0126 * np.gradient(omega, t) + 0.0017 * omega
    np.savez(folder / f"run{k}.npz", t=t, omega_m=omega, **({"tau_e": tau} if k != 1 else {}))
    files.append(folder / f"run{k}.npz")

# %%
answers = pm.diagnose_many(files, machine, ledger=folder / "fleet.ndjson")
for name, result in zip(answers.names, answers, strict=True):
    print(Path(name).name, result.verdict if isinstance(result, pm.Diagnosis) else result.kind)

# %%
# The recording without a torque has a failure in its place.
for failure in answers.failures:
    print(failure.kind, "-", failure.message.replace(str(folder), "."))

# %%
# Run again, everything comes from the ledger.
again = pm.diagnose_many(files, machine, ledger=folder / "fleet.ndjson")
print(again.resumed, "of", len(again), "from the ledger")

"""
Names and units of a log
========================

What can be guessed safely is guessed; what cannot is an error that says how to settle it.
"""

import tempfile
from pathlib import Path

import numpy as np
import pmsm_rs as pm

folder = Path(tempfile.mkdtemp())
t = np.arange(200) * 1e-3
log = np.column_stack([1e3 * t, 1.0 + 0 * t, 12.0 + 0 * t, 0 * t, 2.0 + np.sin(9.0 * t), 1200.0 + 0 * t])
header = "Time [ms],Ud,Uq,Id,Iq,Speed"
np.savetxt(folder / "run.csv", log, delimiter=",", header=header, comments="")

# %%
# A speed without a unit may be electrical or mechanical:
try:
    pm.load(folder / "run.csv")
except pm.DataError as error:
    print(str(error).replace(str(folder), "."))

# %%
# The machine file settles it.
(folder / "machine.toml").write_text("""
[machine]
n_p = 4

[columns]
omega_m = { from = "Speed", unit = "rpm" }
""")
run = pm.load(folder / "run.csv", machine=folder / "machine.toml")
print(run)
print(run.column("omega_m")[:3], "rad/s")

# %%
# Arrays need no file.
print(pm.Recording(t=t, i_d=0 * t, i_q=2.0 + np.sin(9.0 * t), n=1200.0 + 0 * t))

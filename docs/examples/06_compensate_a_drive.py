"""
Compensate a drive
==================

From a recording to the C header of a drive: the friction that was found, as feed-forward of the torque. The
header is compiled, and the motor runs with and without it.
"""

import ctypes
import shutil
import subprocess
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pmsm_rs as pm

speeds = {"t": [0.0, 0.1, 0.35, 0.6], "value": [0.0, 60.0, -60.0, 80.0]}
bench = dict(duration=0.8, drive={"f_sample": 4e3}, effects={"coulomb_friction": {"tau_c": 0.4}})
log = dict(reference={"omega_m": speeds}, sensors={"noise_i": 0.02, "noise_omega_e": 0.1})
first, second = (pm.simulate(**bench, **log, seed=seed) for seed in (1, 2))
answer = pm.diagnose(first.recording, first.machine, validation=second.recording)
answer.model.to_frame()

# %%
# The header holds no allocation and computes in single precision.
folder = Path(tempfile.mkdtemp())
answer.export("c-header", folder / "motor.h")
print("\n".join((folder / "motor.h").read_text().splitlines()[:6]))

# %%
# A C compiler makes a library of its function ``motor_friction(omega_m, torque)``.
source = '#include "motor.h"\nfloat friction(float w, float tau) { return motor_friction(w, tau); }\n'
(folder / "motor.c").write_text(source)
compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
library = folder / "motor.so"
subprocess.run([compiler, "-O2", "-shared", "-fPIC", folder / "motor.c", "-o", library, "-lm"], check=True)
friction = ctypes.CDLL(str(library)).friction
friction.argtypes, friction.restype = [ctypes.c_float, ctypes.c_float], ctypes.c_float

# %%
# A slow swing through standstill, where friction hurts most. The feed-forward becomes a reference of i_q.
t = np.arange(0.0, 0.8, 1e-3)
slow = 4.0 * np.sin(2.0 * np.pi * 2.5 * t)
base = answer.model.machine
torque = np.array([friction(w, 0.0) for w in slow])
i_q = {"t": t.tolist(), "value": (torque / (1.5 * base.n_p * base.psi_m)).tolist()}
reference = {"omega_m": {"t": t.tolist(), "value": slow.tolist()}}
alone = pm.simulate(**bench, reference=reference)
helped = pm.simulate(**bench, reference=reference | {"i_q": i_q})

fig, ax = plt.subplots(layout="constrained")
for run, name in ((alone, "speed controller alone"), (helped, "with the header's friction")):
    at = run.recording.column("t")
    off = np.interp(at, t, slow) - run.truth.traces["omega_m"]
    ax.plot(at, off, label=f"{name}: {np.sqrt(np.mean(off**2)):.3f} rad/s rms")
ax.set(xlabel="t in s", ylabel="error of the speed in rad/s")
ax.legend()

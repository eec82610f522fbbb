"""
An FMU in a simulation
======================

The model that was found as a functional mock-up unit, run by FMPy (``pip install fmpy``) as any tool for
co-simulation runs it. ``fmu`` is a unit of FMI 2.0, ``fmu3`` one of FMI 3.0.
"""

import tempfile
from pathlib import Path

import fmpy
import matplotlib.pyplot as plt
import numpy as np
import pmsm_rs as pm

speeds = {"t": [0.0, 0.1, 0.35, 0.6], "value": [0.0, 60.0, -60.0, 80.0]}
run, other = (
    pm.simulate(
        duration=0.8,
        seed=seed,
        drive={"f_sample": 4e3},
        reference={"omega_m": speeds},
        sensors={"noise_i": 0.02, "noise_omega_e": 0.1},
        effects={"coulomb_friction": {"tau_c": 0.4}},
    )
    for seed in (1, 2)
)
answer = pm.diagnose(run.recording, run.machine, validation=other.recording)
unit = Path(tempfile.mkdtemp()) / "motor.fmu"
answer.export("fmu", unit)
fmpy.dump(str(unit))

# %%
# Voltages of the second run drive it, step by step of the sample period.
t, v_d, v_q = (other.recording.column(name) for name in ("t", "v_d", "v_q"))
period = t[1] - t[0]
inputs = np.rec.fromarrays([t, v_d, v_q, 0.0 * t], names="time,v_d,v_q,tau_load")
shown = fmpy.simulate_fmu(
    str(unit),
    stop_time=t[-1],
    output_interval=period,
    fmi_type="CoSimulation",
    input=inputs,
    output=["i_q", "omega_m"],
)

# %%
# The same in the package, and what was measured.
same = answer.model.respond(t, v_d, v_q)
fig, ax = plt.subplots(layout="constrained")
ax.plot(t, other.recording.column("omega_e") / run.machine.n_p, label="measured", lw=3, alpha=0.4)
ax.plot(t, same["omega_m"], label="package")
ax.plot(shown["time"], shown["omega_m"], "--", label="FMU")
ax.set(xlabel="t in s", ylabel="speed in rad/s")
ax.legend()

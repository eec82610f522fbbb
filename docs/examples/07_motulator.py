"""
Put it into motulator
=====================

The model that was found, as machine and mechanics of the drive simulator motulator (``pip install
"motulator<0.6"``): saturation and friction go along.
"""

import importlib.util
import tempfile
from pathlib import Path

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

# %%
# What motulator cannot express would be listed here.
file = Path(tempfile.mkdtemp()) / "motor.py"
print(answer.export("motulator", file) or "it expresses all of this model")
spec = importlib.util.spec_from_file_location("motor", file)
motor = importlib.util.module_from_spec(spec)
spec.loader.exec_module(motor)

# %%
# A drive of motulator with this motor, under its own vector control.
import motulator.drive.control.sm as control  # noqa: E402
from motulator.drive import model  # noqa: E402

par = motor.PARAMETERS
drive = model.Drive(
    model.VoltageSourceConverter(u_dc=540.0), motor.machine(), motor.mechanics(lambda t: (t > 0.2) * 0.5)
)
limits = control.CurrentReferenceCfg(par, max_i_s=10.0, nom_w_m=par.n_p * 100.0)
ctrl = control.CurrentVectorControl(par, limits, J=motor.J, sensorless=False)
ctrl.ref.w_m = lambda t: par.n_p * 40.0 * min(t / 0.1, 1.0)
simulation = model.Simulation(drive, ctrl)
simulation.simulate(t_stop=0.4)

# %%
# The torque in steady state is the load and the friction that the diagnosis found.
seen = simulation.mdl.machine.data
print(f"friction at 40 rad/s: {float(motor.friction(40.0)) * 40.0:.3f} N m")
print(f"motor torque at the end: {np.mean(seen.tau_M[-200:]):.3f} N m")

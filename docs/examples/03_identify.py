"""
Identify parameters
===================

Which parameters does the dq-model need to come closest to a recording? Not what is missing in it: on the
recording of the demo, the dead time of the inverter is taken for resistance.
"""

import pmsm_rs as pm
from pmsm_rs import plot
from pmsm_rs.config.machine_file import read_machine
from pmsm_rs.support.demo import recording_files

run_file, _, machine_file = recording_files()
machine = read_machine(machine_file)
run = pm.load(run_file, machine)

# %%
# By the particle swarm alone, within bounds.
fit = pm.identify(
    run,
    machine.machine,
    fit={"r_s": (0.2, 4.0), "psi_m": (0.05, 0.5)},
    method="pso",
    swarm=pm.Swarm(particles=10, iterations=30),
    seed=1,
)
fit

# %%
# The best cost of each generation.
ax = plot.history(fit)
ax.grid(alpha=0.3)

# %%
# All parameters, with least squares behind the swarm. As the residual is no noise, there is no honest
# uncertainty, and the answer says so.
print(pm.identify(run, machine.machine, method="pso+lm", seed=1))

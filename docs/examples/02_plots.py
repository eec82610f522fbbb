"""
Plots to restyle
================

Every plot draws on the matplotlib axes that it is given and returns them.
"""

import matplotlib.pyplot as plt
import pmsm_rs as pm
from pmsm_rs import plot
from pmsm_rs.config.machine_file import read_machine
from pmsm_rs.support.demo import recording_files

run_file, other_file, machine_file = recording_files()
machine = read_machine(machine_file)
run, other = pm.load(run_file, machine), pm.load(other_file, machine)
answer = pm.diagnose(run, machine.machine, validation=other)

# %%
# The residual of the model without the effect, over time and over the operating point.
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.4), layout="constrained")
plot.residual_over_time(answer, "i_q", ax=left)
plot.residual_over(answer, "i_q", "op_i_q", ax=right)
left.set_title("over time")
right.set_title("over the torque current")
right.legend(frameon=False)

# %%
# Where in speed and torque it sits, and at which orders of the rotor angle.
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.4), layout="constrained")
plot.residual_map(answer, "i_q", ax=left)
plot.order_spectrum(answer, "i_q", ax=right)

# %%
# The stretch where the model is furthest off.
ax = plot.trajectory(answer, "i_q")
ax.legend(["measured", "dq-model", "with dead time"], frameon=False)

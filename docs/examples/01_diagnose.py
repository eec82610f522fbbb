"""
Diagnose a recording
====================

From file to finding. The recording is that of ``pmsm-rs demo``: a motor in an independent simulation whose
inverter loses voltage in its dead time.
"""

import pmsm_rs as pm
from pmsm_rs.support.demo import recording_files

run_file, other_file, machine_file = recording_files()
run = pm.load(run_file, machine=machine_file)
other = pm.load(other_file, machine=machine_file)
print(run)

# %%
# The nameplate is off by 5 to 20 %. A second run of the same machine checks the prediction.
machine = pm.Machine(n_p=4, r_s=1.24, l_d=8.2e-3, l_q=7.1e-3, psi_m=0.159, j=4.4e-3)
answer = pm.diagnose(run, machine, validation=other)
answer

# %%
# The same as text, as the command line prints it.
print(answer)

# %%
# Everything is a plain value.
first = answer.ranking[0]
v_err = first.parameters["v_err"]
print(answer.verdict, first.effect, f"{first.probability:.2f}")
print(f"v_err = {v_err.value:.3f} ± {v_err.stderr:.3f} {v_err.unit}")

# %%
# ``answer.report("report.html")`` writes the report; without a name it is shown in the notebook.
answer.report()

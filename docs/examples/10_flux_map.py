"""
A measured flux map
===================

Real data: flux linkages of a 5.6 kW reluctance machine with magnets, measured by Aalto University and
published with motulator (MIT). The currents of the grid are taken as operating points at 400 rpm.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pmsm_rs as pm
from pmsm_rs import plot

here = Path("../data")
measured = np.load(here / "baldor_400rpm_map.npz")
current, flux = (measured[name][::2, ::2].ravel() for name in ("i_s_dq", "psi_s_dq"))
fig, ax = plt.subplots(layout="constrained")
ax.scatter(current.imag, flux.imag, c=current.real, s=14)
ax.set(xlabel="i_q in A", ylabel="flux linkage of the q axis in V s")

# %%
# Without resistance the voltage is v = j ω ψ.
omega = 400.0 * 2.0 * np.pi / 60.0 * 2
points = pm.Recording(
    t=1.0 * np.arange(len(current)),
    omega_e=np.full(len(current), omega),
    i_d=current.real,
    i_q=current.imag,
    v_d=-omega * flux.imag,
    v_q=omega * flux.real,
)
answer = pm.diagnose(points, pm.Machine(n_p=2))
answer

# %%
# The residual of constant inductances over i_q, and that of the model with saturation.
plot.residual_over(answer, "v_d", "op_i_q")

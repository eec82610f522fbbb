"""
A formula for a strange brake
=============================

An eddy-current brake is in no catalogue. The diagnosis says so, and looks for a formula of the torque that
remains: a hypothesis to argue about, no cause.
"""

import matplotlib.pyplot as plt
import numpy as np
import pmsm_rs as pm
from pmsm_rs import plot

J, STEP = 2e-3, 2e-3


def brake(omega: float) -> float:
    """The torque of the brake, N m, over the speed in rad/s: it falls again above 13 rad/s."""
    return 0.02 * omega / (1.0 + (omega / 13.0) ** 2)


def log(seed: int) -> pm.Recording:
    """A motor that swings under the brake: torque, angle, and speed with noise."""
    rng = np.random.default_rng(seed)
    t = STEP * np.arange(3000)
    waves = zip((0.31, 0.83, 1.7), (45.0, 25.0, 12.0), rng.uniform(0.0, 2.0 * np.pi, 3), strict=True)
    aim = sum(size * np.sin(2.0 * np.pi * f * (t + 0.05) + phase) for f, size, phase in waves)
    omega, theta, tau = np.zeros(3000), np.zeros(3000), np.zeros(3000)
    w, angle = float(aim[0]), 0.0
    for k in range(3000):
        omega[k], theta[k], tau[k] = w, angle, 0.25 * (aim[k] - w)
        for _ in range(10):
            middle = w + STEP / 20.0 * (tau[k] - brake(w)) / J
            w, angle = w + STEP / 10.0 * (tau[k] - brake(middle)) / J, angle + STEP / 10.0 * middle
    # The torque holds from row to row; the log has its mean about each row.
    tau[1:] = 0.5 * (tau[1:] + tau[:-1])
    return pm.Recording(
        t=t, tau_e=tau, omega_m=omega + 0.02 * rng.standard_normal(3000), theta_m=theta, load="none"
    )


answer = pm.diagnose(log(1), pm.Machine(n_p=2, j=1.1 * J, b=0.0), validation=log(2))
print(answer.verdict)
for entry in answer.formulas or ():
    values = ", ".join(f"{name} = {x['value']:.3g} {x['unit']}" for name, x in entry["parameters"].items())
    error = entry["times_noise"]["validation"]
    print(f"{error['after']:.2f} of {error['before']:.1f} times the noise  {entry['formula']}   {values}")

# %%
# The torque over the speed: what was put in, and the map that the diagnosis found without a name.
unnamed = answer.unmodelled
ax = plot.unmodelled(unnamed.terms[0]) if unnamed and unnamed.terms else plt.gca()
speed = np.linspace(-80.0, 80.0, 400)
ax.plot(speed, brake(speed), "k:", label="put in")
ax.legend()

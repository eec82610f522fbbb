"""
An inductance test of a drive
=============================

Real data: the drive moteus turns a motor freely at seven levels of i_d and logs the q-axis voltage (mjbots,
Apache-2.0). The usual line through the points takes the inductance as constant. It is not.
"""

import tempfile
from pathlib import Path

import pmsm_rs as pm
from pmsm_rs import plot

here = Path("../data")
described = Path(tempfile.mkdtemp()) / "mj5208.toml"
described.write_text("""
[machine]
n_p = 7

[columns]
t = { period = 1.0 }
i_d = { from = "i_d", unit = "A" }
i_q = { value = 0.5, unit = "A" }    # a motor that turns freely draws a little
v_q = { from = "y", unit = "V" }
""")
print(pm.inspect(here / "ld_mj5208.json", described))

# %%
answer = pm.diagnose(here / "ld_mj5208.json", described)
answer

# %%
# The residual over i_d, before and after.
plot.residual_over(answer, "v_q", "op_i_d")

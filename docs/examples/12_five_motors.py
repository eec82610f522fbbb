"""
Five motors at once
===================

Real data: the same inductance test on five motors (mjbots, Apache-2.0). One call diagnoses all, and one
that cannot be used would not stop the others.
"""

import tempfile
from pathlib import Path

import pmsm_rs as pm

here = Path("../data")
described = Path(tempfile.mkdtemp()) / "motor.toml"
described.write_text("""
[machine]
n_p = 7

[columns]
t = { period = 1.0 }
i_d = { from = "i_d", unit = "A" }
i_q = { value = 0.5, unit = "A" }
v_q = { from = "y", unit = "V" }
""")
answers = pm.diagnose_many(sorted(here.glob("ld_*.json")), described)
print(str(answers).replace(f"{here}/", ""))

# %%
# The flux linkage of each magnet, with its standard error where the test shows one.
for name, answer in answers.answers.items():
    psi_m = answer.base["psi_m"]
    spread = f"({psi_m.why_none})" if psi_m.stderr is None else f"± {psi_m.stderr:.2g} {psi_m.unit}"
    print(f"{Path(name).stem:<18} psi_m = {psi_m.value:.4g} {spread}")

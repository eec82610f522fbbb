"""The model as a functional mock-up unit for co-simulation (modelica.org/fmi), whatever the version of FMI.

Inputs are the voltages d, q in the rotor's frame and the load torque. Parameters are the state in which it
begins. Outputs are the currents, the torque and the motion. Within each communication step the inputs hold,
and the equations advance by Runge-Kutta steps. The unit holds its C source, and a library for this computer
where there is a C compiler.
"""

from __future__ import annotations

import io
import platform
import shutil
import subprocess
import tempfile
import uuid
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import quoteattr

from .._core import UsageError
from ..errors import refuse
from .c_source import ADVANCE, equations, number
from .common import commented, header

if TYPE_CHECKING:
    from ..model import Model


@dataclass(frozen=True)
class Variable:
    """A variable of the unit; the C source counts its references in the same order."""

    reference: int
    name: str
    unit: str
    said: str
    causality: str

    def attributes(self) -> str:
        """What both versions of a description say of the variable itself."""
        rest = {
            "input": 'variability="continuous"',
            "parameter": 'variability="fixed" initial="exact"',
            "output": 'variability="continuous" initial="calculated"',
        }
        return (
            f'name="{self.name}" valueReference="{self.reference}" description={quoteattr(self.said)} '
            f'causality="{self.causality}" {rest[self.causality]}'
        )

    def value(self) -> str:
        """What both say of its value."""
        return f'unit="{self.unit}"' + ("" if self.causality == "output" else ' start="0"')


_BY_CAUSALITY = {
    "input": (
        ("v_d", "V", "voltage d in the rotor's frame"),
        ("v_q", "V", "voltage q in the rotor's frame"),
        ("tau_load", "N.m", "load torque against positive rotation"),
    ),
    "parameter": (
        ("i_d_start", "A", "current d at the beginning"),
        ("i_q_start", "A", "current q at the beginning"),
        ("omega_m_start", "rad/s", "mechanical speed at the beginning"),
        ("theta_m_start", "rad", "mechanical angle at the beginning"),
    ),
    "output": (
        ("i_d", "A", "current d"),
        ("i_q", "A", "current q"),
        ("tau_e", "N.m", "motor torque"),
        ("omega_e", "rad/s", "electrical speed"),
        ("theta_e", "rad", "electrical angle"),
        ("i_d_shown", "A", "current d as the sensors show it"),
        ("i_q_shown", "A", "current q as the sensors show it"),
        ("theta_e_shown", "rad", "electrical angle as the sensor shows it"),
        ("omega_m", "rad/s", "mechanical speed"),
        ("theta_m", "rad", "mechanical angle"),
    ),
}
VARIABLES = tuple(
    Variable(reference, *about, causality)
    for reference, (causality, about) in enumerate(
        (causality, about) for causality, group in _BY_CAUSALITY.items() for about in group
    )
)
OUTPUTS = tuple(x for x in VARIABLES if x.causality == "output")


@dataclass(frozen=True)
class About:
    """What a description says of a unit: the name of its model, its token, the machine, its step in s."""

    name: str
    token: str
    said: str
    step: float


@dataclass(frozen=True)
class Version:
    """A version of FMI.

    `template` is the file of its functions in C, and `files` gives what describes a unit, by its place in it.
    `platform` names the folder of libraries for a system, linux or darwin, on this computer.
    """

    template: str
    files: Callable[[About], dict[str, str]]
    platform: Callable[[str], str]


_COMPILERS = ("cc", "gcc", "clang")
_SECONDS = 300
_NO_COMPILER = (
    "There is no C compiler here: the unit holds its source only. `fmpy compile FILE` adds the library."
)


def content(
    model: Model, version: Version, name: str, *, temperature: float = 20.0
) -> tuple[bytes, list[str]]:
    """The unit as the bytes of its file, and what is missing in it. `name` is that of the model in it.

    Raises UsageError where the compiler fails.
    """
    told = model.equations(temperature=temperature, temperature_magnet=temperature)
    source = _source(model, told, version)
    token = f"{{{uuid.uuid5(uuid.NAMESPACE_URL, source)}}}"
    source = source.replace("@TOKEN@", token)
    about = About(name, token, " ".join(header(model))[:500], told["period"])
    files = {place: text.encode() for place, text in version.files(about).items()}
    files[f"sources/{name}.c"] = source.encode()
    left_out = []
    compiled = _compiled(source, name, version)
    if compiled is None:
        left_out.append(_NO_COMPILER)
    else:
        files[compiled[0]] = compiled[1]
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, data in files.items():
            entry = zipfile.ZipInfo(path, date_time=(1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, data)
    return buffer.getvalue(), left_out


def units(*others: str) -> str:
    """The units of the variables and others, as both versions of a description define them."""
    names = sorted({*(x.unit for x in VARIABLES), *others})
    listed = "\n".join(f'    <Unit name="{name}"/>' for name in names)
    return f"  <UnitDefinitions>\n{listed}\n  </UnitDefinitions>\n"


def _source(model: Model, told: Mapping[str, Any], version: Version) -> str:
    folder = Path(__file__).parents[1] / "templates"
    functions, motor = (
        (folder / file).read_text(encoding="utf-8") for file in (version.template, "motor_unit.c.template")
    )
    said = commented(header(model), " *")
    return (
        functions.replace("@MOTOR@", motor)
        .replace("@HEADER@", said.replace("*/", "* /"))
        .replace("@STATES@", str(len(told["states"])))
        .replace("@N_P@", number(float(told["n_p"])))
        .replace("@STEP@", number(told["period"] / told["steps"]))
        .replace("@EQUATIONS@", equations(told) + ADVANCE)
    )


def _compiled(source: str, name: str, version: Version) -> tuple[str, bytes] | None:
    """The place in the unit and the content of the library for this computer; none without a compiler.

    Raises UsageError where the compiler fails.
    """
    compiler = next(filter(None, map(shutil.which, _COMPILERS)), None)
    system = {"Linux": ("linux", ".so"), "Darwin": ("darwin", ".dylib")}.get(platform.system())
    if compiler is None or system is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        written, library = Path(folder, f"{name}.c"), Path(folder, f"{name}{system[1]}")
        written.write_text(source, encoding="utf-8")
        # Contracted products would change the last bits.
        command = [
            compiler,
            "-O2",
            "-ffp-contract=off",
            "-shared",
            "-fPIC",
            "-o",
            str(library),
            str(written),
            "-lm",
        ]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=_SECONDS, check=False)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise refuse(
                UsageError, f"the C compiler {compiler} did not answer ({error})", fix="try it by hand"
            ) from error
        if done.returncode != 0:
            raise refuse(
                UsageError,
                f"the C compiler {compiler} refused the model: {done.stderr.strip()[:300]}",
                fix="try another compiler first in PATH",
            )
        return f"binaries/{version.platform(system[0])}/{name}{system[1]}", library.read_bytes()

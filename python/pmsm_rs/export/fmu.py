"""The model as a functional mock-up unit for co-simulation, FMI 2.0 (modelica.org/fmi).

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
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import escape, quoteattr

from .._core import UsageError
from ..errors import refuse
from .c_source import ADVANCE, equations, number
from .common import commented, header

if TYPE_CHECKING:
    from ..model import Model

_INPUTS = (
    ("v_d", "V", "voltage d in the rotor's frame"),
    ("v_q", "V", "voltage q in the rotor's frame"),
    ("tau_load", "N.m", "load torque against positive rotation"),
)
_BEGIN = (
    ("i_d_start", "A", "current d at the beginning"),
    ("i_q_start", "A", "current q at the beginning"),
    ("omega_m_start", "rad/s", "mechanical speed at the beginning"),
    ("theta_m_start", "rad", "mechanical angle at the beginning"),
)
_OUTPUTS = (
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
)
_COMPILERS = ("cc", "gcc", "clang")
_SECONDS = 300
_NO_COMPILER = (
    "There is no C compiler here: the unit holds its source only. `fmpy compile FILE` adds the library."
)


def content(model: Model, name: str, *, temperature: float = 20.0) -> tuple[bytes, list[str]]:
    """The unit as the bytes of its file, and what is missing in it. `name` is that of the model in it."""
    told = model.equations(temperature=temperature, temperature_magnet=temperature)
    source = _source(model, told)
    guid = f"{{{uuid.uuid5(uuid.NAMESPACE_URL, source)}}}"
    source = source.replace("@GUID@", guid)
    files = {
        "modelDescription.xml": _description(model, told, name, guid).encode(),
        f"sources/{name}.c": source.encode(),
    }
    left_out = []
    compiled = _compiled(source, name)
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


def _description(model: Model, told: Mapping[str, Any], name: str, guid: str) -> str:
    variables: list[str] = []
    units = sorted({unit for _, unit, _ in (*_INPUTS, *_BEGIN, *_OUTPUTS)})
    for causality, group in (("input", _INPUTS), ("parameter", _BEGIN), ("output", _OUTPUTS)):
        for label, unit, said in group:
            variability = "fixed" if causality == "parameter" else "continuous"
            start = "" if causality == "output" else ' start="0"'
            initial = ' initial="exact"' if causality == "parameter" else ""
            initial = ' initial="calculated"' if causality == "output" else initial
            variables.append(
                f'    <ScalarVariable name="{label}" valueReference="{len(variables)}" '
                f'description={quoteattr(said)} causality="{causality}" variability="{variability}"{initial}>'
                f'<Real unit="{unit}"{start}/></ScalarVariable>'
            )
    first = len(_INPUTS) + len(_BEGIN) + 1
    numbers = range(first, first + len(_OUTPUTS))
    unknowns = "".join(f'<Unknown index="{k}"/>' for k in numbers)
    listed = "\n".join(f'    <Unit name="{unit}"/>' for unit in units)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{guid}" '
        f"description={quoteattr(' '.join(header(model))[:500])} "
        'generationTool="pmsm-rs" variableNamingConvention="flat" numberOfEventIndicators="0">\n'
        f'  <CoSimulation modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true" '
        'canGetAndSetFMUstate="true" canSerializeFMUstate="true">\n'
        f'    <SourceFiles><File name="{escape(name)}.c"/></SourceFiles>\n  </CoSimulation>\n'
        f"  <UnitDefinitions>\n{listed}\n  </UnitDefinitions>\n"
        f'  <DefaultExperiment startTime="0" stepSize="{told["period"]!r}"/>\n'
        "  <ModelVariables>\n" + "\n".join(variables) + "\n  </ModelVariables>\n"
        f"  <ModelStructure>\n    <Outputs>{unknowns}</Outputs>\n"
        f"    <InitialUnknowns>{unknowns}</InitialUnknowns>\n  </ModelStructure>\n"
        "</fmiModelDescription>\n"
    )


def _source(model: Model, told: Mapping[str, Any]) -> str:
    template = (Path(__file__).parents[1] / "templates" / "fmi2.c.template").read_text(encoding="utf-8")
    said = commented(header(model), " *")
    return (
        template.replace("@HEADER@", said.replace("*/", "* /"))
        .replace("@STATES@", str(len(told["states"])))
        .replace("@N_P@", number(float(told["n_p"])))
        .replace("@STEP@", number(told["period"] / told["steps"]))
        .replace("@EQUATIONS@", equations(told) + ADVANCE)
    )


def _compiled(source: str, name: str) -> tuple[str, bytes] | None:
    """The place in the unit and the content of the library for this computer; none without a compiler.

    Raises UsageError where the compiler fails.
    """
    compiler = next(filter(None, map(shutil.which, _COMPILERS)), None)
    system = {"Linux": ("linux", ".so"), "Darwin": ("darwin", ".dylib")}.get(platform.system())
    if compiler is None or system is None:
        return None
    bits = "64" if platform.architecture()[0] == "64bit" else "32"
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
        return f"binaries/{system[0]}{bits}/{name}{system[1]}", library.read_bytes()

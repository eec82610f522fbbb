"""Functional mock-up units of FMI 3.0: their model and build descriptions, and their names of platforms."""

from __future__ import annotations

import platform
from xml.sax.saxutils import quoteattr

from .fmu import OUTPUTS, VARIABLES, About, Version, units

_XML = '<?xml version="1.0" encoding="UTF-8"?>\n'
# The standard names these processors otherwise than operating systems do.
_PROCESSORS = {"amd64": "x86_64", "arm64": "aarch64", "i386": "x86", "i686": "x86"}


def _files(about: About) -> dict[str, str]:
    return {"modelDescription.xml": _description(about), "sources/buildDescription.xml": _build(about)}


def _description(about: About) -> str:
    variables = "\n".join(f"    <Float64 {x.attributes()} {x.value()}/>" for x in VARIABLES)
    time = (
        f'    <Float64 name="time" valueReference="{len(VARIABLES)}" description="time" '
        'causality="independent" variability="continuous" unit="s"/>'
    )
    structure = "\n".join(
        f'    <{element} valueReference="{x.reference}"/>'
        for element in ("Output", "InitialUnknown")
        for x in OUTPUTS
    )
    return (
        f'{_XML}<fmiModelDescription fmiVersion="3.0" modelName="{about.name}" '
        f'instantiationToken="{about.token}" description={quoteattr(about.said)} '
        'generationTool="pmsm-rs" variableNamingConvention="flat">\n'
        f'  <CoSimulation modelIdentifier="{about.name}" canHandleVariableCommunicationStepSize="true" '
        'canGetAndSetFMUState="true" canSerializeFMUState="true"/>\n'
        f"{units('s')}"
        '  <LogCategories>\n    <Category name="logStatusError"/>\n  </LogCategories>\n'
        f'  <DefaultExperiment startTime="0" stepSize="{about.step!r}"/>\n'
        f"  <ModelVariables>\n{variables}\n{time}\n  </ModelVariables>\n"
        f"  <ModelStructure>\n{structure}\n  </ModelStructure>\n"
        "</fmiModelDescription>\n"
    )


def _build(about: About) -> str:
    return (
        f'{_XML}<fmiBuildDescription fmiVersion="3.0">\n'
        f'  <BuildConfiguration modelIdentifier="{about.name}">\n'
        f'    <SourceFileSet language="C99">\n      <SourceFile name="{about.name}.c"/>\n'
        "    </SourceFileSet>\n  </BuildConfiguration>\n</fmiBuildDescription>\n"
    )


def _platform(system: str) -> str:
    processor = platform.machine().lower()
    return f"{_PROCESSORS.get(processor, processor)}-{system}"


FMI3 = Version("fmi3.c.template", _files, _platform)

"""Functional mock-up units of FMI 2.0: their model description, and their names of platforms."""

from __future__ import annotations

import platform
from xml.sax.saxutils import escape, quoteattr

from .fmu import OUTPUTS, VARIABLES, About, Version, units


def _files(about: About) -> dict[str, str]:
    return {"modelDescription.xml": _description(about)}


def _description(about: About) -> str:
    variables = "\n".join(
        f"    <ScalarVariable {x.attributes()}><Real {x.value()}/></ScalarVariable>" for x in VARIABLES
    )
    # FMI 2.0 counts the variables of a description from 1.
    unknowns = "".join(f'<Unknown index="{x.reference + 1}"/>' for x in OUTPUTS)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<fmiModelDescription fmiVersion="2.0" modelName="{about.name}" guid="{about.token}" '
        f"description={quoteattr(about.said)} "
        'generationTool="pmsm-rs" variableNamingConvention="flat" numberOfEventIndicators="0">\n'
        f'  <CoSimulation modelIdentifier="{about.name}" canHandleVariableCommunicationStepSize="true" '
        'canGetAndSetFMUstate="true" canSerializeFMUstate="true">\n'
        f'    <SourceFiles><File name="{escape(about.name)}.c"/></SourceFiles>\n  </CoSimulation>\n'
        f"{units()}"
        f'  <DefaultExperiment startTime="0" stepSize="{about.step!r}"/>\n'
        f"  <ModelVariables>\n{variables}\n  </ModelVariables>\n"
        f"  <ModelStructure>\n    <Outputs>{unknowns}</Outputs>\n"
        f"    <InitialUnknowns>{unknowns}</InitialUnknowns>\n  </ModelStructure>\n"
        "</fmiModelDescription>\n"
    )


def _platform(system: str) -> str:
    return system + ("64" if platform.architecture()[0] == "64bit" else "32")


FMI2 = Version("fmi2.c.template", _files, _platform)

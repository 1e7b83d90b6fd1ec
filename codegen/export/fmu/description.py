"""modelDescription.xml of FMI 2.0 and 3.0, and buildDescription.xml.

Sources: Functional Mock-up Interface for Model Exchange and Co-Simulation 2.0.4, sections 2.2 and 4.3; Functional Mock-up
Interface Specification 3.0, sections 2.4, 2.5 and 4.4.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from codegen.configuration.signals import STATUSES
from codegen.export.fmu.variables import BUFFER_BYTES, MIME_TYPE, Variable, Version, text
from codegen.units import in_order

STATUS_TYPE = "Status"
STOP_TIME = 10.0
"""Duration of the default experiment, in s."""

_TYPES: dict[Version, Mapping[str, str]] = {
    "2": {"real": "Real", "integer": "Integer", "boolean": "Boolean", "status": "Enumeration"},
    "3": {
        "real": "Float64",
        "integer": "Int32",
        "boolean": "Boolean",
        "status": "Enumeration",
        "binary": "Binary",
        "clock": "Clock",
    },
}
_CAUSALITY = {"time": "independent", "input": "input", "output": "output", "fixed": "parameter", "tunable": "parameter"}

Attributes = dict[str, str]


@dataclass(frozen=True)
class Description:
    """Content of a model description.

    Attributes:
        identifier: C identifier of the model, and file name of the binary.
        communication_step: step proposed to the simulator, in s; a whole multiple of internal_step.
        token: ties the description to its sources.
        sources: .c files, for FMI 2.0.
        has_bus: whether there is a bus: events, and communication steps of any size.
        is_single: whether a process can have one instance only.
    """

    version: Version
    identifier: str
    name: str
    about: str
    build_id: str
    tool: str
    token: str
    internal_step: float
    communication_step: float
    variables: Sequence[Variable]
    sources: Sequence[str]
    has_bus: bool = False
    is_single: bool = False


def model_description(given: Description) -> bytes:
    """Return the content of modelDescription.xml."""
    third = given.version == "3"
    attributes = {
        "fmiVersion": "3.0" if third else "2.0",
        "modelName": given.name,
        "instantiationToken" if third else "guid": given.token,
        "description": given.about,
        "version": given.build_id,
        "generationTool": given.tool,
        "variableNamingConvention": "structured",
    }
    root = ET.Element("fmiModelDescription", attributes)
    _co_simulation(root, given)
    _units(root, given.variables)
    if any(each.kind == "status" for each in given.variables):
        _status_type(root, third)
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", {"name": "logStatusError", "description": "why a function returned an error"})
    step = repr(given.communication_step)
    ET.SubElement(root, "DefaultExperiment", {"startTime": "0.0", "stopTime": repr(STOP_TIME), "stepSize": step})
    variables = ET.SubElement(root, "ModelVariables")
    for reference, variable in enumerate(given.variables):
        (_variable_3 if third else _variable_2)(variables, variable, str(reference))
    _set_clocks(variables, given.variables)
    _structure(root, given)
    return text(root)


def _co_simulation(root: ET.Element, given: Description) -> None:
    common = {"modelIdentifier": given.identifier, "canHandleVariableCommunicationStepSize": _boolean(given.has_bus)}
    if given.version == "3":
        states = {"canGetAndSetFMUState": "true", "canSerializeFMUState": "true"}
        if given.has_bus:
            states["hasEventMode"] = "true"
        if given.is_single:
            states["canBeInstantiatedOnlyOncePerProcess"] = "true"
        # Lets a simulator determine which communication steps are whole multiples.
        ET.SubElement(root, "CoSimulation", {**common, **states, "fixedInternalStepSize": repr(given.internal_step)})
        return
    element = ET.SubElement(root, "CoSimulation", {**common, "canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true"})
    files = ET.SubElement(element, "SourceFiles")
    for name in given.sources:
        ET.SubElement(files, "File", {"name": name})


def _boolean(value: bool) -> str:
    return "true" if value else "false"


def _units(root: ET.Element, variables: Sequence[Variable]) -> None:
    definitions = ET.SubElement(root, "UnitDefinitions")
    for unit in in_order(each.unit for each in variables if each.unit):
        element = ET.SubElement(definitions, "Unit", {"name": unit.fmi_name})
        ET.SubElement(element, "BaseUnit", {base: str(exponent) for base, exponent in unit.exponents.items()})
        if unit.shown is not None:
            ET.SubElement(element, "DisplayUnit", {"name": unit.shown[0], "factor": repr(unit.shown[1])})


def _status_type(root: ET.Element, third: bool) -> None:
    definitions = ET.SubElement(root, "TypeDefinitions")
    about = {"name": STATUS_TYPE, "description": "what a sample of the controller did"}
    if third:
        holder = ET.SubElement(definitions, "EnumerationType", about)
    else:
        holder = ET.SubElement(ET.SubElement(definitions, "SimpleType", about), "Enumeration")
    for value, (name, meaning) in enumerate(STATUSES.items()):
        ET.SubElement(holder, "Item", {"name": name, "value": str(value), "description": meaning})


def _common(variable: Variable, reference: str) -> Attributes:
    found = {"name": variable.name, "valueReference": reference}
    if variable.description:
        found["description"] = variable.description
    found["causality"] = _CAUSALITY[variable.role]
    own = variable.role in ("fixed", "tunable")
    found["variability"] = variable.role if own else "continuous" if variable.continuous else "discrete"
    return found


def _of_type(variable: Variable) -> Attributes:
    """Return the attributes of the type: declared type, unit, range and start."""
    found: Attributes = {}
    if variable.kind == "status":
        found["declaredType"] = STATUS_TYPE
    if variable.unit:
        found["unit"] = variable.unit.fmi_name
        if variable.unit.shown is not None:
            found["displayUnit"] = variable.unit.shown[0]
    if variable.low is not None and variable.high is not None:
        found["min"], found["max"] = _number(variable, variable.low), _number(variable, variable.high)
    if variable.start is not None:
        found["start"] = _number(variable, variable.start)
    return found


def _number(variable: Variable, value: float) -> str:
    if variable.kind == "boolean":
        return _boolean(bool(value))
    return repr(value) if variable.kind == "real" else str(int(value))


def _variable_2(parent: ET.Element, variable: Variable, reference: str) -> None:
    attributes = _common(variable, reference)
    if variable.role in ("fixed", "tunable"):
        attributes["initial"] = "exact"
    if variable.role == "output":
        attributes["initial"] = "calculated"
    scalar = ET.SubElement(parent, "ScalarVariable", attributes)
    ET.SubElement(scalar, _TYPES["2"][variable.kind], _of_type(variable))


def _set_clocks(parent: ET.Element, variables: Sequence[Variable]) -> None:
    """Write the value references of the clocks of clocked variables."""
    number = {each.name: str(reference) for reference, each in enumerate(variables)}
    for element, variable in zip(parent, variables, strict=True):
        if variable.clock:
            element.set("clocks", number[variable.clock])


def _variable_3(parent: ET.Element, variable: Variable, reference: str) -> None:
    attributes = _common(variable, reference)
    if variable.kind == "clock":
        timing = {"intervalVariability": "triggered"}
        if variable.interval is not None:
            times = {"intervalDecimal": repr(variable.interval), "shiftDecimal": repr(variable.shift)}
            timing = {"intervalVariability": "constant", **times}
        ET.SubElement(parent, "Clock", {**attributes, **timing})
        return
    if variable.kind == "binary":
        size = {"maxSize": str(BUFFER_BYTES), "mimeType": MIME_TYPE}
        initial = {"initial": "calculated" if variable.role == "output" else "exact"}
        element = ET.SubElement(parent, "Binary", {**attributes, **initial, **size})
        if variable.role == "input":
            ET.SubElement(element, "Start", {"value": ""})
        return
    if variable.role == "output":
        attributes["initial"] = "calculated"
    ET.SubElement(parent, _TYPES["3"][variable.kind], {**attributes, **_of_type(variable)})


def _structure(root: ET.Element, given: Description) -> None:
    """Add the outputs and their direct dependencies. FMI 2.0 uses 1-based indices, FMI 3.0 value references."""
    third = given.version == "3"
    number = {each.name: str(k if third else k + 1) for k, each in enumerate(given.variables)}
    structure = ET.SubElement(root, "ModelStructure")
    outputs = structure if third else ET.SubElement(structure, "Outputs")
    initial = structure if third else ET.Element("InitialUnknowns")
    computed = [each for each in given.variables if each.role == "output"]
    for each in computed:
        depends = " ".join(sorted((number[name] for name in each.depends), key=int))
        key = "valueReference" if third else "index"
        ET.SubElement(outputs, "Output" if third else "Unknown", {key: number[each.name], "dependencies": depends})
    for each in computed:
        if each.clock:
            continue  # no value before its clock ticks
        key, tag = ("valueReference", "InitialUnknown") if third else ("index", "Unknown")
        ET.SubElement(initial, tag, {key: number[each.name]})
    if not third:
        structure.append(initial)


def build_description(identifier: str, sources: Sequence[str]) -> bytes:
    """Return the content of sources/buildDescription.xml of FMI 3.0."""
    root = ET.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    configuration = ET.SubElement(root, "BuildConfiguration", {"modelIdentifier": identifier})
    files = ET.SubElement(configuration, "SourceFileSet", {"language": "C99"})
    for name in sources:
        ET.SubElement(files, "SourceFile", {"name": name})
    ET.SubElement(configuration, "Library", {"name": "m", "external": "true", "description": "the C library's mathematics"})
    return text(root)

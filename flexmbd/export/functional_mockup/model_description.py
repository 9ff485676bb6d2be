"""modelDescription.xml: the variables of a unit, in the words of FMI 2.0 and FMI 3.0."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum, IntEnum
from xml.etree import ElementTree as ET
from xml.etree.ElementTree import Element, SubElement

from flexmbd.errors import ExportError


class Fmi(IntEnum):
    """The versions of the Functional Mock-up Interface that are written."""

    V2 = 2
    V3 = 3


class Causality(Enum):
    """What a variable is for its unit."""

    INPUT = "input"
    PARAMETER = "parameter"
    OUTPUT = "output"


@dataclass(frozen=True)
class Variable:
    """A real number of a unit.

    Attributes:
        name: unique in the unit.
        causality: input, parameter or output.
        unit: one of `UNITS`.
        description: one line.
        start: of inputs and parameters.
        direct: of outputs: whether the inputs at an instant change them at that instant.
    """

    name: str
    causality: Causality
    unit: str
    description: str
    start: float = 0.0
    direct: bool = True


@dataclass(frozen=True)
class Description:
    """A unit for co-simulation; variables are inputs, then parameters, then outputs.

    Attributes:
        name: of the model, any text.
        identifier: of the binary.
        token: by which an importer shows that binary and description belong together.
        text: one line on what it is.
        variables: their value references are their places, from 1; 0 is the time.
        step: communication step proposed (s).
        inner_step: step of the integrator inside (s), None where the unit is exact for any step.
    """

    name: str
    identifier: str
    token: str
    text: str
    variables: tuple[Variable, ...]
    step: float
    inner_step: float | None = None


#: Exponents of SI base units; the radian counts as one.
UNITS: dict[str, dict[str, int]] = {
    "1": {},
    "s": {"s": 1},
    "m": {"m": 1},
    "rad": {"rad": 1},
    "m/s": {"m": 1, "s": -1},
    "rad/s": {"rad": 1, "s": -1},
    "m/s2": {"m": 1, "s": -2},
    "rad/s2": {"rad": 1, "s": -2},
    "N": {"kg": 1, "m": 1, "s": -2},
    "N.m": {"kg": 1, "m": 2, "s": -2},
}

_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(\.[A-Za-z_][A-Za-z0-9_]*)*", re.ASCII)
#: Characters that no XML text holds, and those that a variable's name must not hold.
_FORBIDDEN = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029\ufffe\uffff\ud800-\udfff]")


def identifier_of(name: str) -> str:
    """A C identifier for a model's name: each character beside ASCII letters, digits and _ becomes _."""
    text = re.sub(r"[^A-Za-z0-9_]", "_", name, flags=re.ASCII)
    return f"_{text}" if not text or text[0].isdigit() else text


def check_names(names: Iterable[str], *, kind: str) -> None:
    """Refuse names that XML or FMI does not carry, and names that occur twice.

    Raises:
        ExportError: naming them.
    """
    seen: set[str] = set()
    for name in names:
        if not name or _FORBIDDEN.search(name):
            raise ExportError(f"{kind} {name!r} holds control characters or nothing; FMI cannot name it: rename it")
        if name in seen:
            raise ExportError(f"two of {kind}s are called {name!r}; FMI wants names that differ: rename one")
        seen.add(name)


def model_description(unit: Description, fmi: Fmi, *, sources: Sequence[str] = ()) -> bytes:
    """The file modelDescription.xml of a version; FMI 2 lists the C files there, which FMI 3 has a file of its own for.

    Raises:
        ExportError: a name that FMI does not carry, or one that occurs twice.
    """
    check_names([unit.name], kind="the model's name")
    check_names((one.name for one in unit.variables), kind="variable")
    root = _root(unit, fmi)
    can = "canGetAndSetFMUState" if fmi is Fmi.V3 else "canGetAndSetFMUstate"
    serialise = "canSerializeFMUState" if fmi is Fmi.V3 else "canSerializeFMUstate"
    kind = SubElement(root, "CoSimulation", modelIdentifier=unit.identifier)
    kind.set("canHandleVariableCommunicationStepSize", "true")
    kind.set(can, "true")
    kind.set(serialise, "true")
    if fmi is Fmi.V3 and unit.inner_step is not None:
        kind.set("fixedInternalStepSize", repr(float(unit.inner_step)))
    if fmi is Fmi.V2 and sources:
        listed = SubElement(kind, "SourceFiles")
        for name in sources:
            SubElement(listed, "File", name=name)
    definitions = SubElement(root, "UnitDefinitions")
    used = {"s", *(one.unit for one in unit.variables)}
    for name in (name for name in UNITS if name in used):
        exponents = {base: str(power) for base, power in UNITS[name].items()}
        if fmi is Fmi.V2:
            exponents.pop("rad", None) if len(exponents) > 1 else None
        SubElement(SubElement(definitions, "Unit", name=name), "BaseUnit", exponents)
    categories = SubElement(root, "LogCategories")
    SubElement(categories, "Category", name="logStatusError", description="what went wrong")
    experiment = SubElement(root, "DefaultExperiment", startTime="0.0", stopTime=repr(1000.0 * unit.step))
    experiment.set("stepSize", repr(float(unit.step)))
    variables = SubElement(root, "ModelVariables")
    structure = SubElement(root, "ModelStructure")
    (_fmi3_variables if fmi is Fmi.V3 else _fmi2_variables)(unit.variables, variables, structure)
    ET.indent(root)
    return ET.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


def _root(unit: Description, fmi: Fmi) -> Element:
    root = Element("fmiModelDescription", fmiVersion=f"{fmi.value}.0", modelName=unit.name)
    root.set("instantiationToken" if fmi is Fmi.V3 else "guid", unit.token)
    root.set("description", unit.text)
    root.set("generationTool", "flexmbd")
    plain = all(_PLAIN.fullmatch(one.name) for one in unit.variables)
    root.set("variableNamingConvention", "structured" if plain else "flat")
    if fmi is Fmi.V2:
        root.set("numberOfEventIndicators", "0")
    return root


def _attributes(one: Variable, reference: int) -> dict[str, str]:
    found = {"name": one.name, "valueReference": str(reference), "description": one.description}
    found["causality"] = one.causality.value
    found["variability"] = "fixed" if one.causality is Causality.PARAMETER else "continuous"
    return found


def _fmi3_variables(variables: Sequence[Variable], inside: Element, structure: Element) -> None:
    time = {"name": "time", "valueReference": "0", "causality": "independent", "variability": "continuous"}
    SubElement(inside, "Float64", time | {"unit": "s"})
    for reference, one in enumerate(variables, start=1):
        element = SubElement(inside, "Float64", _attributes(one, reference) | {"unit": one.unit})
        if one.causality is Causality.OUTPUT:
            element.set("initial", "calculated")
        else:
            element.set("start", repr(float(one.start)))
    for tag in ("Output", "InitialUnknown"):
        for reference, one in enumerate(variables, start=1):
            if one.causality is Causality.OUTPUT:
                unknown = SubElement(structure, tag, valueReference=str(reference))
                if tag == "Output" and not one.direct:
                    unknown.set("dependencies", "")


def _fmi2_variables(variables: Sequence[Variable], inside: Element, structure: Element) -> None:
    time = SubElement(inside, "ScalarVariable", name="time", valueReference="0", causality="independent")
    time.set("variability", "continuous")
    SubElement(time, "Real", unit="s")
    for reference, one in enumerate(variables, start=1):
        element = SubElement(inside, "ScalarVariable", _attributes(one, reference))
        real = SubElement(element, "Real", unit=one.unit)
        if one.causality is Causality.OUTPUT:
            element.set("initial", "calculated")
        else:
            real.set("start", repr(float(one.start)))
    for tag in ("Outputs", "InitialUnknowns"):
        group = SubElement(structure, tag)
        for place, one in enumerate(variables, start=2):  # places in the file, the time being the first
            if one.causality is Causality.OUTPUT:
                unknown = SubElement(group, "Unknown", index=str(place))
                if tag == "Outputs" and not one.direct:
                    unknown.set("dependencies", "")

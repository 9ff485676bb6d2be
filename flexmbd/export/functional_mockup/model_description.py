"""modelDescription.xml: the variables of a unit, in the words of FMI 2.0 and FMI 3.0."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
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
    """The causality of a variable of the unit."""

    INPUT = "input"
    PARAMETER = "parameter"
    OUTPUT = "output"
    LOCAL = "local"


@dataclass(frozen=True)
class Variable:
    """A real number of a unit.

    Attributes:
        name: unique in the unit.
        causality: input, parameter or output; local are continuous states and their derivatives.
        unit: one of `UNITS`.
        description: one line.
        start: of inputs and parameters.
        direct: of outputs: whether the inputs at an instant change them at that instant.
        derivative_of: of a state's derivative the state's name.
        nominal: of a state: a size that is usual, to which a solver's absolute tolerance is relative.
    """

    name: str
    causality: Causality
    unit: str
    description: str
    start: float = 0.0
    direct: bool = True
    derivative_of: str | None = None
    nominal: float | None = None


@dataclass(frozen=True)
class Description:
    """A unit for co-simulation, and for model exchange where it has continuous states.

    Variables are inputs, then parameters, outputs, states and their derivatives.

    Attributes:
        name: of the model, any text.
        identifier: of the binary.
        token: by which an importer shows that binary and description belong together.
        text: one line on what it is.
        variables: their value references are their places, from 1; 0 is the time.
        step: communication step proposed (s).
        inner_step: step of the integrator inside (s), None where the unit is exact for any step.
        differentiable: whether model exchange gives the derivatives of all outputs.
    """

    name: str
    identifier: str
    token: str
    text: str
    variables: tuple[Variable, ...]
    step: float
    inner_step: float | None = None
    differentiable: bool = True


#: Exponents of SI base units; the radian counts as one.
UNITS: dict[str, dict[str, int]] = {
    "1": {},
    "1/s": {"s": -1},
    "1/s2": {"s": -2},
    "s": {"s": 1},
    "m": {"m": 1},
    "rad": {"rad": 1},
    "m/s": {"m": 1, "s": -1},
    "rad/s": {"rad": 1, "s": -1},
    "m/s2": {"m": 1, "s": -2},
    "rad/s2": {"rad": 1, "s": -2},
    "N": {"kg": 1, "m": 1, "s": -2},
    "N.m": {"kg": 1, "m": 2, "s": -2},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "C": {"A": 1, "s": 1},
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
    exchange = any(one.derivative_of for one in unit.variables)
    for tag in ("ModelExchange", "CoSimulation") if exchange else ("CoSimulation",):
        kind = SubElement(root, tag, modelIdentifier=unit.identifier)
        kind.set(can, "true")
        kind.set(serialise, "true")
        if tag == "ModelExchange":
            kind.set(f"providesDirectionalDerivative{'s' * (fmi is Fmi.V3)}", str(unit.differentiable).lower())
            if fmi is Fmi.V2:
                kind.set("completedIntegratorStepNotNeeded", "true")
        else:
            kind.set("canHandleVariableCommunicationStepSize", "true")
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


def _unknowns(variables: Sequence[Variable]) -> dict[str, list[tuple[int, list[int] | None]]]:
    """What the model structure lists: place among the variables, from 0, and on which places it depends, if told."""
    derived = {one.derivative_of for one in variables} - {None}
    states = [k for k, one in enumerate(variables) if one.name in derived]
    outputs = [k for k, one in enumerate(variables) if one.causality is Causality.OUTPUT]
    rates = [k for k, one in enumerate(variables) if one.derivative_of is not None]
    return {
        "outputs": [(k, states if not variables[k].direct else None) for k in outputs],
        "derivatives": [(k, None) for k in rates],
        "initial": [(k, None) for k in (*outputs, *states, *rates)],
    }


def _list_unknowns(
    variables: Sequence[Variable], tags: Mapping[str, tuple[Element, str]], *, shift: int, key: str
) -> None:
    """Write the model structure; ``shift`` makes a place what the version calls a variable by, under ``key``."""
    for what, unknowns in _unknowns(variables).items():
        parent, tag = tags[what]
        for place, on in unknowns:
            unknown = SubElement(parent, tag, {key: str(place + shift)})
            if on is not None:
                unknown.set("dependencies", " ".join(str(k + shift) for k in on))


def _fmi3_variables(variables: Sequence[Variable], inside: Element, structure: Element) -> None:
    time = {"name": "time", "valueReference": "0", "causality": "independent", "variability": "continuous"}
    SubElement(inside, "Float64", time | {"unit": "s"})
    references = {one.name: str(reference) for reference, one in enumerate(variables, start=1)}
    for reference, one in enumerate(variables, start=1):
        element = SubElement(inside, "Float64", _attributes(one, reference) | {"unit": one.unit})
        if one.derivative_of is not None:
            element.set("derivative", references[one.derivative_of])
        if one.nominal is not None:
            element.set("nominal", repr(float(one.nominal)))
        if one.causality in (Causality.OUTPUT, Causality.LOCAL):
            element.set("initial", "calculated")
        else:
            element.set("start", repr(float(one.start)))
    tags = {"outputs": "Output", "derivatives": "ContinuousStateDerivative", "initial": "InitialUnknown"}
    here = {what: (structure, tag) for what, tag in tags.items()}
    _list_unknowns(variables, here, shift=1, key="valueReference")


def _fmi2_variables(variables: Sequence[Variable], inside: Element, structure: Element) -> None:
    time = SubElement(inside, "ScalarVariable", name="time", valueReference="0", causality="independent")
    time.set("variability", "continuous")
    SubElement(time, "Real", unit="s")
    places = {one.name: str(place) for place, one in enumerate(variables, start=2)}  # in the file, after the time
    for reference, one in enumerate(variables, start=1):
        element = SubElement(inside, "ScalarVariable", _attributes(one, reference))
        real = SubElement(element, "Real", unit=one.unit)
        if one.derivative_of is not None:
            real.set("derivative", places[one.derivative_of])
        if one.nominal is not None:
            real.set("nominal", repr(float(one.nominal)))
        if one.causality in (Causality.OUTPUT, Causality.LOCAL):
            element.set("initial", "calculated")
        else:
            real.set("start", repr(float(one.start)))
    tags = {"outputs": "Outputs", "derivatives": "Derivatives", "initial": "InitialUnknowns"}
    listed = _unknowns(variables)
    here = {what: (SubElement(structure, tag) if listed[what] else structure, "Unknown") for what, tag in tags.items()}
    _list_unknowns(variables, here, shift=2, key="index")

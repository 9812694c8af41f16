"""Declare a parameter once: type, default, unit, bounds and source.

A configuration section is a frozen dataclass whose fields are made by `parameter`. The YAML files, the ROS parameters
with their descriptors and the in-process loop are all derived from that one declaration.
"""

from __future__ import annotations

import difflib
import math
import types
import typing
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from functools import cache
from typing import Any, TypeVar

from bmd_rths_core.errors import InputError

Section = TypeVar("Section")

#: Smallest number that is not 0, in any unit of a parameter: products of smaller ones are no numbers any more.
SMALLEST = 1e-100

# Numbers of an array, and characters of a value, that a message shows
_MOST_SHOWN, _LONGEST = 60, 300

_METADATA_KEY = "bmd_rths.parameter"


@dataclass(frozen=True)
class ParameterSpec:
    """What is known about one parameter besides its name, type and default.

    Parameters
    ----------
    description : str
        What the parameter is, in one sentence.
    unit : str
        SI unit, "1" for a dimensionless number, "" for text and flags.
    source : str
        Equation, table or reference the default comes from; "" when it is a choice of this project.
    lower, upper : float, optional
        Allowed range of the number, or of every entry of an array.
    lower_open : bool
        The lower bound itself is not allowed.
    choices : tuple of str
        The allowed values of a text parameter; empty when any text is allowed.
    """

    description: str
    unit: str
    source: str
    lower: float | None
    upper: float | None
    lower_open: bool
    choices: tuple[str, ...]

    def allowed(self) -> str:
        """Return a text of the allowed values, for error messages and parameter descriptors."""
        if self.choices:
            return "one of " + ", ".join(self.choices)
        if not self.unit:
            return "text that is not empty"
        unit = f" {self.unit}" if self.unit not in ("", "1") else ""
        parts = []
        if self.lower is not None:
            parts.append(f"{'>' if self.lower_open else '>='} {self.lower:.10g}{unit}")
        if self.upper is not None:
            parts.append(f"<= {self.upper:.10g}{unit}")
        return " and ".join(parts) if parts else "any finite value" + (f" in {self.unit}" if unit else "")

    def _number_problem(self, value: float) -> bool:
        if not math.isfinite(value):
            return True
        if self.lower is not None and (value < self.lower or (self.lower_open and value == self.lower)):
            return True
        return self.upper is not None and value > self.upper

    def check(self, name: str, value: object) -> None:
        """Raise `InputError` unless `value` is allowed.

        Parameters
        ----------
        name : str
            Full name of the parameter, for the message.
        value : object
            A value that already has the declared type.

        Raises
        ------
        InputError
            The value is not finite, out of bounds or not one of the choices.
        """
        entries = value if isinstance(value, tuple) else (value,)
        for entry in entries:
            if isinstance(entry, float) and 0.0 < abs(entry) < SMALLEST:
                raise InputError(f"{name}: {_shown(value)} is not allowed; 0 or at least {SMALLEST:g} is required")
            if isinstance(entry, (int, float)) and not isinstance(entry, bool) and self._number_problem(entry):
                raise InputError(f"{name}: {_shown(value)} is not allowed; {self.allowed()} is required")
            if self.choices and entry not in self.choices:
                raise InputError(f"{name}: {_short(entry)} is not allowed; {self.allowed()} is required")


def parameter(
    default: Any,
    *,
    description: str,
    unit: str = "",
    source: str = "",
    lower: float | None = None,
    upper: float | None = None,
    lower_open: bool = False,
    choices: tuple[str, ...] = (),
) -> Any:
    """Declare one parameter of a configuration section (a dataclass field).

    Parameters
    ----------
    default : Any
        Value used when the user gives none.
    description, unit, source, lower, upper, lower_open, choices
        See `ParameterSpec`.

    Returns
    -------
    Any
        A `dataclasses.field` that carries the declaration.
    """
    spec = ParameterSpec(description, unit, source, lower, upper, lower_open, choices)
    return field(default=default, metadata={_METADATA_KEY: spec})


def specs(section: type) -> Mapping[str, ParameterSpec]:
    """Return the declaration of every parameter of a section.

    Parameters
    ----------
    section : type
        A configuration dataclass.

    Returns
    -------
    Mapping of str to ParameterSpec
        In the order of declaration.
    """
    return _specs(section)


@cache
def _specs(section: type) -> Mapping[str, ParameterSpec]:
    return types.MappingProxyType({f.name: f.metadata[_METADATA_KEY] for f in fields(section)})


def section_name(section: type) -> str:
    """Return the name of a section in YAML and in ROS parameter names.

    Parameters
    ----------
    section : type
        A configuration dataclass with a `SECTION` class attribute.

    Returns
    -------
    str
        For example ``"numerical_substructure"``.
    """
    return str(section.SECTION)  # type: ignore[attr-defined]


def check_parameters(config: Any) -> None:
    """Check every field of a section against its declaration; call it from ``__post_init__``.

    Parameters
    ----------
    config : Any
        An instance of a configuration dataclass.

    Raises
    ------
    InputError
        A value is not allowed.
    """
    name = section_name(type(config))
    for key, spec in specs(type(config)).items():
        spec.check(f"{name}.{key}", getattr(config, key))


def build_section(section: type[Section], values: Mapping[str, object]) -> Section:
    """Make a configuration section from a mapping, as read from YAML or from ROS parameters.

    Parameters
    ----------
    section : type
        The configuration dataclass.
    values : Mapping
        Parameter names and values. Integers are taken where numbers are declared; nothing else is converted.

    Returns
    -------
    Section
        The validated section.

    Raises
    ------
    InputError
        A key is unknown, or a value has the wrong type or is out of bounds.
    """
    name = section_name(section)
    declared = specs(section)
    for key in values:
        if key not in declared:
            raise InputError(f"{name}.{key}: unknown parameter{suggestion(key, declared)}; {_listed(declared)}")
    hints = _types(typing.cast(type, section))
    return section(**{key: _typed(f"{name}.{key}", value, hints[key], declared[key]) for key, value in values.items()})


@cache
def _types(section: type) -> dict[str, Any]:
    return typing.get_type_hints(section)


def suggestion(word: object, known: Iterable[str]) -> str:
    """Return the known word that a mistyped one is most like, as a question; empty when none is.

    Parameters
    ----------
    word : object
        What was given.
    known : iterable of str
        What is allowed.
    """
    similar = difflib.get_close_matches(str(word), list(known), n=1)
    return f", did you mean {similar[0]}?" if similar else ""


def _listed(known: Iterable[str]) -> str:
    return f"allowed here: {', '.join(known)}"


def _shown(value: object) -> str:
    if not isinstance(value, tuple):
        return f"{value}"
    rest = f", ... ({len(value)} values)" if len(value) > _MOST_SHOWN else ""
    return f"[{', '.join(f'{v:g}' for v in value[:_MOST_SHOWN])}{rest}]"


def _short(value: object) -> str:
    """Return a value for a message, of a length that is fit for one."""
    text = repr(value)
    return text if len(text) <= _LONGEST else text[:_LONGEST] + "..."


def _typed(name: str, value: object, hint: Any, spec: ParameterSpec) -> object:
    """Return `value` as the declared type, or raise one clear line."""
    if isinstance(hint, types.GenericAlias):  # tuple[float, ...] is the only array type of a parameter
        if not isinstance(value, (list, tuple)):
            raise InputError(f"{name}: {_short(value)} is not a list; a list of numbers in {spec.unit} is required")
        return tuple(_number(f"{name}[{i}]", entry, spec) for i, entry in enumerate(value))
    if hint is float:
        return _number(name, value, spec)
    if hint is int and (isinstance(value, bool) or not isinstance(value, int)):
        raise InputError(f"{name}: {_short(value)} is not a whole number; {spec.allowed()} is required")
    if hint is bool and not isinstance(value, bool):
        raise InputError(f"{name}: {_short(value)} is neither true nor false")
    if hint is str and not isinstance(value, str):
        raise InputError(f"{name}: {_short(value)} is not text; {spec.allowed()} is required")
    return value


def _number(name: str, value: object, spec: ParameterSpec) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        hint = ""
        if isinstance(value, str) and _is_number(value):
            hint = f" (YAML reads {value} as text: write it as {float(value):.6e})"
        elif isinstance(value, str) and value.count(",") == 1 and _is_number(value.replace(",", ".")):
            hint = f" (a decimal point, not a comma, is required: {value.replace(',', '.')})"
        raise InputError(f"{name}: {_short(value)} is not a number{hint}; {spec.allowed()} is required")
    try:
        return float(value)
    except OverflowError:  # of a whole number with hundreds of digits
        raise InputError(f"{name}: a whole number of {len(str(value))} digits; {spec.allowed()} is required") from None


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False

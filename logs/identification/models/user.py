"""A user's own model: a Python file with names, derivatives and observation equations.

``x' = f(x, u, p, c)``, ``y = g(x, u, p, c)`` (Jategaonkar, Flight Vehicle System Identification, 2006, ch. 3). The
file is run as Python and has::

    states = {"alpha": "rad", "q": "rad/s"}              # name: SI unit, or (unit, value at the start)
    inputs = {"delta_e": "rad"}                          # controls, and measured states; none if absent
    outputs = {"alpha": "rad", "q": "rad/s"}
    parameters = {"M_alpha": ("1/s^2", -5.0)}            # or the unit alone: the start is then found by regression
    constants = {"V": 30.0}                              # SI; [constants] of the map replaces them

    def derivatives(x, u, p, c): return q_rate, ...      # of x.alpha, u.delta_e, p.M_alpha, c.V, in the states' order
    def observations(x, u, p, c): return x.alpha, ...    # in the outputs' order; may be absent if outputs are states

Both functions are compiled with numba if it can compile them, else they run as Python, about a hundred times slower.
"""

from __future__ import annotations

import keyword
import math
import traceback
from collections import namedtuple
from collections.abc import Callable, Mapping
from pathlib import Path
from types import FunctionType
from typing import Any, NamedTuple

import numba
import numpy as np

from logs.identification.estimators.engine.problem import Named
from logs.identification.findings import Entry, Finding, register
from logs.identification.models.compiled import Compiled, CompiledModel
from logs.identification.results import Array
from wingbeat.errors import InputError
from wingbeat.text import did_you_mean

SUFFIX = ".py"
FUNCTIONS = ("derivatives", "observations")
TABLES = ("states", "inputs", "outputs", "parameters", "constants")
UNDEFINED = (ArithmeticError, ValueError)
"""raised by functions outside their range of definition: the simulation gives NaN there, as compiled code does"""

register({
    "model_not_compiled": Entry(
        "{subject} runs as plain Python, which is slow: numba could not compile it ({reason})",
        "The functions of a user's model use something that numba does not support.",
        "use numbers, math and NumPy functions only",
    ),
})  # fmt: skip


class UserModel(NamedTuple):
    """A model as its file defines it."""

    model: CompiledModel
    starts: Mapping[str, float]
    """as the parameters' units; start values that the file gives"""
    equations: tuple[str, ...]
    """-; one sentence"""
    findings: tuple[Finding, ...]


class _Definition(NamedTuple):
    """Checked content of a file."""

    path: Path
    states: dict[str, Named]
    inputs: dict[str, str]
    outputs: dict[str, str]
    parameters: dict[str, Named]
    constants: dict[str, float]
    starts: dict[str, float]
    derivatives: Callable[..., Any]
    observations: Callable[..., Any]


def is_user_model(name: str) -> bool:
    """Whether a map's model is a file."""
    return name.endswith(SUFFIX)


def user_inputs(path: Path) -> tuple[str, ...]:
    """Names of the inputs of the model in the file ``path``.

    Raises:
        InputError: as `load_user_model`.
    """
    return tuple(_definition(path, _run(path), {}).inputs)


def load_user_model(path: Path, constants: Mapping[str, float] = {}) -> UserModel:
    """Load the model in the file ``path``; ``constants`` (SI, by name) replace those of the file.

    Raises:
        InputError: the file cannot be run, or a name in it is absent or has the wrong form; one line.
    """
    space = _run(path)
    d = _definition(path, space, constants)
    pair, reason = _functions(d, space)
    findings: tuple[Finding, ...] = ()
    if reason:
        findings = (Finding("model_not_compiled", "info", path.name, details={"reason": reason}),)
    model = CompiledModel(
        d.states, d.inputs, d.outputs, d.parameters, *pair, np.array(list(d.constants.values()), dtype=np.float64),
        interpreted=bool(reason),
    )  # fmt: skip
    return UserModel(model, d.starts, (f"x' = f(x, u, p), y = g(x, u, p) of {path.name}",), findings)


# --- reading ------------------------------------------------------------------------------------------------


def _run(path: Path) -> dict[str, Any]:
    """Names that the file defines."""
    space: dict[str, Any] = {"__name__": path.stem, "__file__": str(path)}
    try:
        exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), space)
    except OSError as error:
        raise InputError(f"cannot read model {path}: {error.strerror}") from None
    except SyntaxError as error:
        raise InputError(f"model {path}, line {error.lineno}: {error.msg}") from None
    except Exception as error:  # the file is the user's: whatever it raises is reported in one line
        raise _error(path, error) from None
    return space


def _error(path: Path, error: Exception) -> InputError:
    """An exception of the user's code in one line, with the last line of the file that led to it."""
    lines = [one.lineno for one in traceback.extract_tb(error.__traceback__) if one.filename == str(path)]
    where = f", line {lines[-1]}" if lines else ""
    return InputError(f"model {path}{where}: {type(error).__name__}: {error}")


def _definition(path: Path, content: Mapping[str, Any], constants: Mapping[str, float]) -> _Definition:
    for name in ("states", "outputs", "parameters", "derivatives"):
        if name not in content:
            raise InputError(f"model {path}: {name} is missing")
    for name in FUNCTIONS:
        if name in content and not callable(content[name]):
            raise InputError(f"model {path}: {name} must be a function of x, u, p, c")
    tables = {name: _table(path, name, content.get(name, {})) for name in TABLES}
    states, parameters = tables["states"], tables["parameters"]
    if not states or not tables["outputs"] or not parameters:
        raise InputError(f"model {path}: a model has at least one state, one output and one parameter")
    twice = states.keys() & tables["inputs"].keys()
    if twice:
        raise InputError(f"model {path}: {', '.join(sorted(twice))} is a state and an input")
    observations = content.get("observations")
    if observations is None:
        for name in tables["outputs"]:
            if name not in states:
                hint = did_you_mean(name, states)
                raise InputError(f"model {path}: output {name} is no state{hint}: define observations(x, u, p, c)")
        observations = _state_observations(tuple(states), tuple(tables["outputs"]))
    known = {name: float(constants.get(name, value or 0.0)) for name, (_, value) in tables["constants"].items()}
    definition = _Definition(
        path,
        {name: Named(unit, value or 0.0) for name, (unit, value) in states.items()},
        {name: unit for name, (unit, _) in tables["inputs"].items()},
        {name: unit for name, (unit, _) in tables["outputs"].items()},
        {name: Named(unit, value or 0.0) for name, (unit, value) in parameters.items()},
        known,
        {name: value for name, (_, value) in parameters.items() if value is not None},
        content["derivatives"],
        observations,
    )
    _try(definition)
    return definition


def _table(path: Path, table: str, entries: Any) -> dict[str, tuple[str, float | None]]:
    """Unit and value by name."""
    if not isinstance(entries, dict):
        raise InputError(f"model {path}: {table} must be a dict of names, not {type(entries).__name__}")
    return {name: _entry(path, table, name, entry) for name, entry in entries.items()}


def _entry(path: Path, table: str, name: Any, entry: Any) -> tuple[str, float | None]:
    key = f"model {path}: {table}[{name!r}]"
    if not isinstance(name, str) or not name.isidentifier() or keyword.iskeyword(name) or name.startswith("_"):
        raise InputError(f"{key}: a name has letters, digits and underscores, and is no keyword of Python")
    unit, value = ("", entry) if table == "constants" else entry if isinstance(entry, tuple) else (entry, None)
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    if not isinstance(unit, str) or not (is_number or (value is None and table != "constants")):
        form = "a number in SI" if table == "constants" else 'a unit such as "rad/s", or (unit, value)'
        raise InputError(f"{key} must be {form}, not {entry!r}")
    return unit, None if value is None else float(value)


def _state_observations(states: tuple[str, ...], outputs: tuple[str, ...]) -> Callable[..., Any]:
    """Observation equations whose outputs are states."""
    places = tuple(states.index(name) for name in outputs)
    source = f"def observations(x, u, p, c):\n    return {', '.join(f'x[{place}]' for place in places)},\n"
    space: dict[str, Any] = {}
    exec(source, space)
    function: Callable[..., Any] = space["observations"]
    return function


def _try(definition: _Definition) -> None:
    """Evaluate both functions once.

    Raises:
        InputError: an exception in one of them, or another number of values than names.
    """
    d = definition
    x = _record("x", d.states)(*(one.value for one in d.states.values()))
    u = _record("u", d.inputs)(*(0.0 for _ in d.inputs))
    p = _record("p", d.parameters)(*(one.value for one in d.parameters.values()))
    c = _record("c", d.constants)(*d.constants.values())
    for function, names in ((d.derivatives, d.states), (d.observations, d.outputs)):
        try:
            values = function(x, u, p, c)
            count = len(values)
            np.array([float(value) for value in values])
        except UNDEFINED:
            continue
        except Exception as error:  # as in `_run`
            raise _error(d.path, error) from None
        if count != len(names):
            expected = f"{len(names)} names: {', '.join(names)}"
            raise InputError(f"model {d.path}: {function.__name__} returns {count} values for {expected}")


def _record(name: str, fields: Mapping[str, Any]) -> Any:
    return namedtuple(name, list(fields))


# --- functions as the integrator calls them -----------------------------------------------------------------


def _wrapper(definition: _Definition, function: Callable[..., Any], count: int) -> Callable[..., None]:
    """A function ``(x, u, p, c, out)`` of arrays that calls ``function`` with named values."""
    d = definition
    tables: dict[str, Mapping[str, Any]] = {"x": d.states, "u": d.inputs, "p": d.parameters, "c": d.constants}
    space: dict[str, Any] = {f"{name}_": _record(name, fields) for name, fields in tables.items()}
    space["function"] = function
    values = ", ".join(
        f"{name}_({', '.join(f'{name}[{i}]' for i in range(len(fields)))})" for name, fields in tables.items()
    )
    lines = [f"    out[{i}] = values[{i}]" for i in range(count)]
    exec("\n".join((f"def wrapper(x, u, p, c, out):\n    values = function({values})", *lines)), space)
    wrapper: Callable[..., None] = space["wrapper"]
    return wrapper


def _functions(definition: _Definition, space: dict[str, Any]) -> tuple[tuple[Compiled, Compiled], str]:
    """Both functions compiled, or as Python with the reason."""
    d = definition
    helpers = {
        name: value for name, value in space.items()
        if isinstance(value, FunctionType) and value.__globals__ is space and name not in FUNCTIONS
    }  # fmt: skip
    # Compiled functions call compiled ones only.
    space.update({name: numba.njit(error_model="numpy")(value) for name, value in helpers.items()})
    try:
        return (_compiled(d, d.derivatives, len(d.states)), _compiled(d, d.observations, len(d.outputs))), ""
    except Exception as error:  # numba reports what it cannot compile by errors of its own and by its lowering's
        space.update(helpers)
        lines = [line for line in str(error).splitlines() if line and not line.startswith("Failed in")]
        pair = _interpreted(d, d.derivatives, len(d.states)), _interpreted(d, d.observations, len(d.outputs))
        return pair, lines[0] if lines else type(error).__name__


def _compiled(definition: _Definition, function: Callable[..., Any], count: int) -> Compiled:
    vector = numba.float64[::1]
    signature = numba.void(vector, vector, vector, vector, vector)
    inner = numba.njit(error_model="numpy")(function)
    compiled: Compiled = numba.njit(signature, error_model="numpy")(_wrapper(definition, inner, count))
    return compiled


def _interpreted(definition: _Definition, function: Callable[..., Any], count: int) -> Compiled:
    """As Python, NaN outside its range of definition."""
    wrapper = _wrapper(definition, function, count)

    def call(x: Array, u: Array, p: Array, c: Array, out: Array) -> None:
        try:
            wrapper(x, u, p, c, out)
        except UNDEFINED:
            out[:] = np.nan

    return call

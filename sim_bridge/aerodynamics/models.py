"""The table of aerodynamic models: a line here, a field of `Air` and a branch of `loads` and `advance` each.

The branches are taken at run time, so that the plant is compiled once for all models and a vehicle may change its
model without waiting for the compiler.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Any, NamedTuple, get_type_hints

from sim_bridge.aerodynamics import blade_element, derivatives, quasi_steady, regression, strip_theory
from sim_bridge.aerodynamics.blade_element import BladeParameters
from sim_bridge.aerodynamics.derivatives import DerivativesParameters
from sim_bridge.aerodynamics.protocol import MODELS, AerodynamicModel, Motion, SectionLoads, Strips
from sim_bridge.aerodynamics.quasi_steady import QuasiSteadyParameters
from sim_bridge.aerodynamics.regression import RegressionParameters
from sim_bridge.aerodynamics.strip_theory import StripParameters
from sim_bridge.aerodynamics.vortex_lattice import coupled as vortex_lattice
from sim_bridge.aerodynamics.vortex_lattice.coupled import FarLattice, far_lattice
from sim_bridge.aerodynamics.vortex_lattice.settings import VortexLatticeParameters
from sim_bridge.compiled import call_far, inlined
from sim_bridge.vectors import Floats
from wingbeat.errors import InputError

__all__ = ["MODELS", "Air", "advance", "air_of", "find_model", "is_compiled_separately", "loads"]

for _module in (strip_theory, quasi_steady, blade_element, regression, derivatives, vortex_lattice):
    MODELS[_module.MODEL.name] = _module.MODEL

STRIP_THEORY, QUASI_STEADY, BLADE_ELEMENT, REGRESSION, DERIVATIVES, VORTEX_LATTICE = range(len(MODELS))


class Air(NamedTuple):
    """Parameters of the chosen model, blanks for the others."""

    which: int
    """index of the model in the table"""
    strip_theory: StripParameters
    quasi_steady: QuasiSteadyParameters
    blade_element: BladeParameters
    regression: RegressionParameters
    derivatives: DerivativesParameters
    vortex_lattice: FarLattice


def find_model(name: str) -> AerodynamicModel:
    """Return the model of this name.

    Raises:
        InputError: there is none.
    """
    if name not in MODELS:
        raise InputError(f'unknown aerodynamic model "{name}"; known: {", ".join(MODELS)}')
    return MODELS[name]


def is_compiled_separately(name: str) -> bool:
    """Return whether the model is compiled at its first flight and not with the plant.

    Raises:
        InputError: there is none.
    """
    return _hints(Air)[find_model(name).name] is FarLattice


def air_of(model: AerodynamicModel, parameters: Any) -> Air:
    """Return the argument of the compiled `loads` for ``parameters`` built by ``model``."""
    kinds = _hints(Air)
    blanks = {name: _blank(kinds[name]) for name in MODELS}
    told = far_lattice(parameters) if isinstance(parameters, VortexLatticeParameters) else parameters
    return Air(list(MODELS).index(model.name), **(blanks | {model.name: told}))


@cache
def _hints(kind: Any) -> Mapping[str, Any]:
    return MappingProxyType(get_type_hints(kind))


def _blank(kind: Any) -> Any:
    if hasattr(kind, "blank"):
        return kind.blank()
    if not hasattr(kind, "_fields"):
        return kind()
    return kind(*(_blank(hint) for hint in _hints(kind).values()))


@inlined
def loads(air: Air, strips: Strips, motion: Motion, density: float, state: Floats, out: SectionLoads) -> None:
    """Fill ``out`` with the loads of the chosen model, see `sim_bridge.aerodynamics.protocol`."""
    if air.which == STRIP_THEORY:
        strip_theory.loads(air.strip_theory, strips, motion, density, state, out)
    elif air.which == QUASI_STEADY:
        quasi_steady.loads(air.quasi_steady, strips, motion, density, state, out)
    elif air.which == BLADE_ELEMENT:
        blade_element.loads(air.blade_element, strips, motion, density, state, out)
    elif air.which == REGRESSION:
        regression.loads(air.regression, strips, motion, density, state, out)
    elif air.which == DERIVATIVES:
        derivatives.loads(air.derivatives, strips, motion, density, state, out)
    elif air.which == VORTEX_LATTICE:
        far = air.vortex_lattice
        call_far(far.loads, far.parameters, (strips, motion, state, out), density)


@inlined
def advance(air: Air, strips: Strips, motion: Motion, density: float, state: Floats, dt: float) -> None:
    """Advance the discrete state of the chosen model by ``dt`` s."""
    if air.which == STRIP_THEORY:
        strip_theory.advance(air.strip_theory, strips, motion, density, state, dt)
    elif air.which == QUASI_STEADY:
        quasi_steady.advance(air.quasi_steady, strips, motion, density, state, dt)
    elif air.which == BLADE_ELEMENT:
        blade_element.advance(air.blade_element, strips, motion, density, state, dt)
    elif air.which == REGRESSION:
        regression.advance(air.regression, strips, motion, density, state, dt)
    elif air.which == DERIVATIVES:
        derivatives.advance(air.derivatives, strips, motion, density, state, dt)
    elif air.which == VORTEX_LATTICE:
        far = air.vortex_lattice
        call_far(far.advance, far.parameters, (strips, motion, state), dt)

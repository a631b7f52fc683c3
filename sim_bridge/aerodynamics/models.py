"""The table of aerodynamic models: one line each."""

from __future__ import annotations

from avionics.quantities import BadInput
from sim_bridge.aerodynamics import blade_element, quasi_steady, regression, strip_theory
from sim_bridge.aerodynamics.protocol import MODELS, AerodynamicModel

__all__ = ["MODELS", "find_model"]

for _model in (strip_theory.MODEL, quasi_steady.MODEL, blade_element.MODEL, regression.MODEL):
    MODELS[_model.name] = _model


def find_model(name: str) -> AerodynamicModel:
    """The model of this name.

    Raises:
        BadInput: there is none.
    """
    if name not in MODELS:
        raise BadInput(f'unknown aerodynamic model "{name}"; known: {", ".join(MODELS)}')
    return MODELS[name]

"""Linear models written as matrices of names."""

from __future__ import annotations

import numpy as np
import pytest

from logs.identification.estimators.engine.problem import Named
from logs.identification.models.matrices import Matrix, written_model
from logs.identification.models.stability import Steady, short_period
from wingbeat.errors import InputError

STATES = {"alpha": Named("rad"), "q": Named("rad/s")}
A: Matrix = [["Z_alpha", "1 + Z_q"], ["M_alpha", "M_q"]]
B: Matrix = [["Z_delta", "Z_0"], ["M_delta", 0.0]]
C: Matrix = [[1.0, 0], ["20*Z_alpha", "2e1*Z_q"]]
D: Matrix = [[0, 0], ["20 * Z_delta", "20*Z_0"]]
OUTPUTS = {"alpha": "rad", "a_z": "m/s^2"}
TRUTH = {"Z_alpha": -2.0, "Z_q": -0.05, "Z_delta": -0.2, "Z_0": 0.01, "M_alpha": -15.0, "M_q": -3.0, "M_delta": -20.0}


def test_it_flies_as_the_short_period() -> None:
    inputs = {"delta_e": "rad", "1": "-"}
    model = written_model(STATES, inputs, OUTPUTS, {"Z_alpha": "1/s"}, {"A": A, "B": B, "C": C, "D": D})
    assert model.parameters["Z_alpha"].unit == "1/s"
    assert list(model.inputs) == ["delta_e"]
    ready = short_period(Steady(20.0))
    elevator = 0.05 * np.sign(np.sin(np.arange(200) / 9))[:, None]
    flown = model.simulate(np.array([TRUTH[n] for n in model.parameters]), np.zeros(2), elevator, 0.02)
    whole = ready.simulate(np.array([TRUTH.get(n, 0.0) for n in ready.parameters]), np.zeros(2), elevator, 0.02)
    np.testing.assert_allclose(flown[:, 0], whole[:, list(ready.outputs).index("alpha")], atol=1e-12)
    np.testing.assert_allclose(flown[:, 1], whole[:, list(ready.outputs).index("a_z")], atol=1e-10)


@pytest.mark.parametrize(
    ("matrices", "words"),
    [
        ({"A": A, "B": [["Z_delta"], ["M_delta"]]}, "lacks its matrix C"),
        ({"A": A[:1], "B": [["Z_delta"], ["M_delta"]], "C": C}, "2 rows of 2"),
        ({"A": A, "B": [["Z_delta"], ["M_delta Z"]], "C": [[1, 0], [0, 1]]}, "cannot be read"),
        ({"A": A, "B": [["Z_delta"], ["sin(x)"]], "C": [[1, 0], [0, 1]]}, "cannot be read"),
        ({"A": A, "B": [["Z_delta"], [""]], "C": [[1, 0], [0, 1]]}, "empty entry"),
    ],
)
def test_what_cannot_be_is_refused(matrices: dict[str, Matrix], words: str) -> None:
    with pytest.raises(InputError, match=words):
        written_model(STATES, {"delta_e": "rad"}, OUTPUTS, {}, matrices)

"""Names of regressors: what they mean, their values and units."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.terms import evaluate, parse, pool, quotient, unit_of

FLIGHT = Experiment(
    "flight",
    np.arange(4.0),
    {"alpha": np.array([1.0, 2.0, 3.0, 0.0]), "q": np.array([4.0, 3.0, np.nan, 1.0]), "a/b": np.arange(4.0)},
    {"alpha": "rad", "q": "rad/s"},
)


@pytest.mark.parametrize(
    ("text", "scale", "powers"),
    [
        ("alpha", 1.0, {"alpha": 1}),
        ("q*c/2V", 0.5, {"q": 1, "c": 1, "V": -1}),
        ("q*c/(2*V)", 0.5, {"q": 1, "c": 1, "V": -1}),
        ("alpha^2", 1.0, {"alpha": 2}),
        ("(q*c/2V)^2", 0.25, {"q": 2, "c": 2, "V": -2}),
        ("alpha*delta/alpha", 1.0, {"delta": 1}),
        ("theta_dot_11^2 * 3", 3.0, {"theta_dot_11": 2}),
    ],
)
def test_meaning(text: str, scale: float, powers: dict[str, int]) -> None:
    term = parse(text)
    assert term.scale == pytest.approx(scale)
    assert dict(term.powers) == powers


def test_values_are_missing_where_a_signal_is_and_where_a_divisor_is_zero() -> None:
    np.testing.assert_allclose(evaluate(parse("2q*k/alpha"), FLIGHT, {"k": 0.5}), [4.0, 1.5, np.nan, np.nan])
    np.testing.assert_allclose(evaluate(parse("alpha^2"), FLIGHT, {}), [1.0, 4.0, 9.0, 0.0])


def test_units() -> None:
    units = {"alpha": "rad", "q": "rad/s", "c": "m", "V": "m/s", "a": "m/s^2", "i": "N m/A"}
    assert unit_of(parse("q*c/2V"), units) == "rad"
    assert unit_of(parse("alpha^2"), units) == "rad^2"
    assert unit_of(parse("1/V"), units) == "s/m"
    assert unit_of(parse("nothing"), units) == "-"
    assert quotient("m/s^2", "m/s") == "1/s"
    assert quotient("-", "rad^2/s^2") == "s^2/rad^2"
    assert quotient("N m", "A") == "N m/A"


def test_a_pool_has_every_product_once() -> None:
    assert pool(("alpha", "q*c/2V"), 2) == ("alpha", "q*c/2V", "alpha^2", "alpha*(q*c/2V)", "(q*c/2V)^2")
    assert len(pool(("a", "b", "c"), 3)) == 3 + 6 + 10
    assert all(parse(name).powers for name in pool(("a", "b", "c/2d"), 3))


@given(st.text(alphabet="aq12*/^(). V_", max_size=12))
def test_any_text_is_read_or_refused_in_one_line(text: str) -> None:
    try:
        term = parse(text)
    except ValueError as refusal:
        assert "\n" not in str(refusal)
        assert "regressor" in str(refusal)
    else:
        assert term.scale > 0

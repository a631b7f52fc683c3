"""Numbers go where what they stand for is not in the data: equations whose outputs the model does not follow."""

from __future__ import annotations

import numpy as np
import pytest

from logs.identification.diagnostics.unexplained_outputs import without_unexplained
from logs.identification.results import FitSeries, Fitted, estimate
from logs.identification.tables.results import EXPLAINS_LITTLE

TIME = 0.02 * np.arange(600)


def one(output: str, share: float, pole: float = 0.97, held_out: bool = False) -> FitSeries:
    """An output of which a model leaves ``share`` of the power by noise of that pole; above 1 it runs against it."""
    noise, model = np.zeros(len(TIME)), np.sin(2.0 * TIME)
    drawn = np.random.default_rng(len(output)).normal(size=len(TIME))
    for k in range(1, len(TIME)):
        noise[k] = pole * noise[k - 1] + drawn[k]
    model, noise = model / model.std(), noise - noise.mean()
    noise -= model * (model @ noise) / (model @ model)
    measured = noise / noise.std() + (-0.3 * model if share > 1.0 else np.sqrt((1.0 - share) / share) * model)
    said = model if share > 1.0 else np.sqrt((1.0 - share) / share) * model
    return FitSeries("run", output, "", TIME, measured, said, held_out)


def told(*series: FitSeries) -> Fitted:
    names = ("L_p", "L_delta_r", "N_r", "Y_beta")
    estimates = tuple(estimate(name, "1/s", -1.0, 0.1) for name in names)
    return Fitted("output error, lateral", (), estimates, (), None, series, ())


def left(*series: FitSeries) -> dict[str, str]:
    found = without_unexplained(told(*series))
    assert {e.name for e in found.estimates} | {u.name for u in found.unidentified} == {
        "L_p",
        "L_delta_r",
        "N_r",
        "Y_beta",
    }
    return {one.name: one.reason for one in found.unidentified}


def test_of_what_follows_all_stays() -> None:
    assert left(one("p", 0.4), one("r", 0.1), one("beta", 0.02)) == {}


@pytest.mark.parametrize(
    "series", [(one("p", 0.7),), (one("p", 0.7), one("p_dot", 0.8)), (one("p", 0.7), one("p", 0.6))]
)
def test_an_equation_of_which_less_than_half_is_explained_goes_alone(series: tuple[FitSeries, ...]) -> None:
    found = left(*series, one("r", 0.1), one("beta", 0.02))
    assert set(found) == {"L_p", "L_delta_r"} and "less than half of p" in found["L_p"]


def test_one_output_worse_than_its_mean_is_enough() -> None:
    """The other of the same equation is explained: they contradict one another."""
    found = left(one("p", 0.1), one("p_dot", 2.0), one("r", 0.1), one("beta", 0.02))
    assert found == dict.fromkeys(("L_p", "L_delta_r"), "the model follows p_dot worse than its mean")


def test_one_of_two_outputs_or_two_manoeuvres_may_be_poor() -> None:
    assert left(one("p", 0.1), one("p_dot", 0.8), one("r", 0.1), one("beta", 0.02)) == {}
    assert left(one("r", 0.1), one("beta", 0.02), one("p", 0.9, held_out=True)) == {}


def test_white_noise_is_no_fault_of_the_model() -> None:
    assert left(one("p", 0.9, pole=0.0), one("r", 0.1), one("beta", 0.02)) == {}


def test_of_next_to_nothing_nothing_stays() -> None:
    assert set(left(one("p", 0.7), one("r", 0.8), one("beta", 0.9)).values()) == {EXPLAINS_LITTLE}

"""The contract of every row of the estimator registry, on one small simulated case each."""

from __future__ import annotations

import json
import runpy
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from linear_ornithopter import AIRCRAFT, Flight, fly
from scipy.signal import lsim

from groundstation.command import identify as identify_command
from logs.identification import estimators as package
from logs.identification.data.experiment import Experiment
from logs.identification.estimators import recursive, registry
from logs.identification.estimators.flight_modes import identify_modes
from logs.identification.estimators.registry import ESTIMATORS, Request, methods
from logs.identification.models import stability as models
from logs.identification.models.modes import short_period_of
from logs.identification.results import EstimationResult
from tests.logs.identification.colored_noise import TRUTH, simulated
from tests.logs.identification.test_filter_error import (
    OUTPUTS,
    SHORT_PERIOD,
    SHORT_PERIOD_TRUTH,
    pitching,
    turbulent,
)
from wingbeat.errors import InputError

A, B = np.array([[-0.9, 1.0], [-12.0, -1.1]]), np.array([-0.1, -8.0])
AIRSPEED = 60.0
MODE = dict(zip(("short_period_frequency", "short_period_damping"), short_period_of(A), strict=True))
STEP = 0.04


def short_period(seed: int, start: tuple[float, float] = (0.0, 0.0)) -> Experiment:
    """Response to a 3-2-1-1, or a free one from another state, with white noise."""
    rng, time = np.random.default_rng(seed), np.arange(0.0, 16.0, STEP)
    delta = np.zeros(len(time))
    if start == (0.0, 0.0):
        for begin, end, size in ((1.0, 2.2, 0.06), (2.2, 3.0, -0.06), (3.0, 3.4, 0.06), (3.4, 3.8, -0.06)):
            delta[(time >= begin) & (time < end)] = size
    states = lsim((A, B[:, None], np.eye(2), np.zeros((2, 1))), delta, time, X0=start)[2]
    alpha, q = (states + rng.normal(size=states.shape) * (5e-4, 1e-3)).T
    signals = {"alpha": alpha, "q": q, "delta": delta, "V": np.full(len(time), AIRSPEED)}
    units = {"alpha": "rad", "q": "rad/s", "delta": "rad", "V": "m/s"}
    return Experiment(f"maneuver {seed}", time, signals, units)


def ml_request(fly: Callable[[int], Experiment]) -> Request:
    """Maximum likelihood of the short-period model."""
    flights = tuple(map(fly, range(1, 4)))
    return Request(flights, (fly(9),), ("delta_e",), OUTPUTS, (), SHORT_PERIOD, SHORT_PERIOD_TRUTH)


class Case(NamedTuple):
    """One simulated case."""

    request: Request
    truth: Mapping[str, float]


REGRESSION = Case(
    Request((simulated("white", 400, 1),), (simulated("white", 300, 2),), (), ("C",), ("alpha", "q", "delta")), TRUTH
)
DRIVEN = Case(Request(tuple(map(short_period, range(3))), (short_period(9),), ("delta",), ("alpha", "q")), MODE)
FREE = Case(
    Request(tuple(short_period(k, (0.08, 0.0)) for k in range(3)), (short_period(9),), (), ("alpha", "q")), MODE
)
DERIVATIVES = {"Z_alpha": A[0, 0], "Z_delta": B[0], "M_alpha": A[1, 0], "M_q": A[1, 1], "M_delta": B[1]}
MODELED = Case(
    Request(
        tuple(map(short_period, range(2))), (short_period(9),), ("delta",), ("alpha", "q"), (),
        models.short_period(models.Steady(AIRSPEED), ("delta",)), {name: 0.7 * v for name, v in DERIVATIVES.items()},
    ),
    DERIVATIVES,
)  # fmt: skip
CASES: dict[str, Case] = {
    "equation_error_time": REGRESSION,
    "equation_error_frequency": REGRESSION,
    "stepwise": REGRESSION,
    "orthogonal": REGRESSION,
    "recursive_least_squares": REGRESSION,
    "equivalent_system": DRIVEN,
    "era": DRIVEN,
    "free_response": FREE,
    "spectrum": FREE,
    "output_error": Case(ml_request(pitching), SHORT_PERIOD_TRUTH),
    "filter_error": Case(ml_request(turbulent), SHORT_PERIOD_TRUTH),
}
"""by row; a new row needs one line here"""
PENDING = {"flight_path", "gps_aided"}
"""rows without outputs in their request, tested in `test_flight_path` and `test_aided_fit`"""


def constant(request: Request) -> Request:
    """The request with outputs that do not move."""
    experiments = tuple(
        one._replace(signals={**one.signals, **{name: np.full(len(one.time), 0.1) for name in request.outputs}})
        for one in request.experiments
    )
    return request._replace(experiments=experiments, held_out=())


def test_every_row_has_a_case() -> None:
    assert set(ESTIMATORS) - PENDING == set(CASES)


def test_reference_of_estimators_is_current() -> None:
    docs = Path(__file__).parents[3] / "docs"
    page = runpy.run_path(str(docs / "write_estimators.py"))["reference"]()
    assert (docs / "reference" / "estimators.md").read_text(encoding="utf-8") == page


@pytest.mark.parametrize("name", CASES)
def test_the_truth_is_inside_the_interval(name: str) -> None:
    case = CASES[name]
    result = ESTIMATORS[name].estimate(case.request)
    assert result.method == name and result.status == "converged" and result.samples > 0
    found = {one.name: one for one in result.estimates}
    assert set(found) >= set(case.truth)
    for one in (found[name] for name in case.truth):
        assert one.contains(case.truth[one.name]), one
        assert one.standard_error < 0.3 * abs(case.truth[one.name]), one


@pytest.mark.parametrize("name", CASES)
def test_a_constant_record_gives_no_number(name: str) -> None:
    try:
        result = ESTIMATORS[name].estimate(constant(CASES[name].request))
    except InputError:
        return
    assert not result.estimates and result.status != "converged"
    assert result.withheld


@pytest.mark.parametrize("name", CASES)
def test_held_out_data_are_predicted_or_the_method_has_no_prediction(name: str) -> None:
    result = ESTIMATORS[name].estimate(CASES[name].request)
    predicted = [one for one in result.series if one.held_out]
    if any(one.code == "no_prediction" for one in result.findings):
        assert not predicted
        return
    for one in predicted:
        error = one.measured - one.model
        assert np.nanvar(error) < 0.5 * np.nanvar(one.measured)
    assert predicted


@pytest.mark.parametrize("name", CASES)
def test_a_result_survives_json(name: str) -> None:
    result = ESTIMATORS[name].estimate(CASES[name].request)
    document = json.loads(json.dumps(
        {
            "estimates": [one._asdict() for one in result.estimates],
            "findings": [one.document() for one in result.findings],
            "covariance": None if result.covariance is None else result.covariance.tolist(),
        }
    ))  # fmt: skip
    assert [type(result.estimates[0])(**one) for one in document["estimates"]] == list(result.estimates)
    assert [one["text"] for one in document["findings"]] == [one.text for one in result.findings]
    assert all("\n" not in one["text"] for one in document["findings"])


def by_name(result: EstimationResult) -> dict[str, float]:
    return {one.name: one.value for one in (*result.estimates, *result.derived)}


def test_recursive_least_squares_ends_at_ordinary_least_squares() -> None:
    """GIVEN no forgetting THEN values and standard errors after the last sample are those of the batch."""
    request = REGRESSION.request._replace(options={"covariance": "white"})
    batch = ESTIMATORS["equation_error_time"].estimate(request)
    last = ESTIMATORS["recursive_least_squares"].estimate(request)
    for one, other in zip(last.estimates, batch.estimates, strict=True):
        assert (one.name, one.unit) == (other.name, other.unit)
        assert one.value == pytest.approx(other.value, rel=1e-9)
        assert one.standard_error == pytest.approx(other.standard_error, rel=1e-9)


def test_recursive_least_squares_follows_a_change() -> None:
    """GIVEN a derivative that doubles halfway THEN forgetting finds both values, each inside its interval."""
    one = simulated("white", 1000, 3, size=0.3)
    doubled = np.where(one.time < one.time[500], 1.0, 2.0)
    response = one.signals["C"] + (doubled - 1.0) * TRUTH["alpha"] * one.signals["alpha"]
    found = recursive.recursive_least_squares(
        (one._replace(signals={**one.signals, "C": response}),), "C", ("alpha", "q", "delta"), 0.98
    )
    history = found.histories[found.names.index("alpha")]
    for sample, truth in ((495, TRUTH["alpha"]), (995, 2 * TRUTH["alpha"])):
        assert abs(history.value[sample] - truth) < 3.0 * history.standard_error[sample]
    assert np.isnan(history.value[1]) and np.all(np.isfinite(history.standard_error[200:]))


def test_the_standard_error_with_forgetting_is_the_dispersion_of_the_estimates() -> None:
    values, errors = [], []
    for seed in range(100):
        found = recursive.recursive_least_squares(
            (simulated("white", 300, seed),), "C", ("alpha", "q", "delta"), 0.98
        )
        values.append(found.histories[1].value[-1])
        errors.append(found.histories[1].standard_error[-1])
    normalized = (np.array(values) - TRUTH["alpha"]) / np.array(errors)
    assert 0.8 < np.std(normalized) < 1.35


def test_the_equivalent_system_reports_handling_qualities() -> None:
    """GIVEN pitch rate and airspeed THEN T_theta2, CAP and dropback are those of the model, and the level follows."""
    request = DRIVEN.request
    result = ESTIMATORS["equivalent_system"].estimate(request)
    found = {one.name: one for one in result.derived}
    zero = (A[0, 0] * B[1] - A[1, 0] * B[0]) / -B[1]
    load = AIRSPEED / 9.80665 * zero
    truth = {
        "T_theta2": 1 / zero, "n_alpha": load, "CAP": MODE["short_period_frequency"] ** 2 / load,
        "dropback": 1 / zero - 2 * MODE["short_period_damping"] / MODE["short_period_frequency"],
        "q_gain": zero * B[1] / MODE["short_period_frequency"] ** 2,
    }  # fmt: skip
    for name, value in truth.items():
        assert found[name].contains(value), (name, value, found[name])
    assert abs(found["delay"].value) < 0.05 * STEP
    (level,) = [one for one in result.findings if one.code == "handling_level"]
    assert 0.28 <= truth["CAP"] <= 3.6 and 0.25 <= MODE["short_period_damping"] < 0.35
    assert level.value == 2.0 and level.details["delay_level"] == 1


def ring_down() -> Experiment:
    """A free oscillation of 6 rad/s with a damping ratio of 0.1."""
    time = np.arange(0.0, 10.0, 0.01)
    noise = 0.002 * np.random.default_rng(1).normal(size=len(time))
    ringing = np.exp(-0.1 * 6.0 * time) * np.cos(6.0 * np.sqrt(0.99) * time) + noise
    smooth = np.convolve(ringing, np.ones(21) / 21.0, mode="same")
    return Experiment("ring-down", time, {"q": smooth}, {"q": "rad/s"})


@pytest.fixture
def added(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Add the estimator of the README: its file and its row."""
    page = (Path(__file__).parents[3] / "logs" / "identification" / "README.md").read_text(encoding="utf-8")
    file, row = (part.split("```")[0] for part in page.split("```python\n")[1:3])
    (tmp_path / "decrement.py").write_text(file, encoding="utf-8")
    monkeypatch.setattr(package, "__path__", [*package.__path__, str(tmp_path)])
    rows: dict[str, Any] = {"ESTIMATORS": {}, "Estimator": registry.Estimator}
    exec(compile(row, "README.md", "exec"), rows)
    monkeypatch.setitem(registry.ESTIMATORS, "decrement", rows["ESTIMATORS"]["decrement"])


@pytest.mark.usefixtures("added")
def test_readme_example_is_an_estimator() -> None:
    """GIVEN the estimator in the README WHEN it runs on a ring-down THEN its interval holds the damping."""
    record = ring_down()
    (found,) = ESTIMATORS["decrement"].estimate(Request((record,), outputs=("q",))).estimates
    assert found.contains(0.1), found
    with pytest.raises(InputError, match="peaks"):
        constant_rate = {"q": np.ones(len(record.time))}
        ESTIMATORS["decrement"].estimate(Request((record._replace(signals=constant_rate),), outputs=("q",)))


@pytest.mark.usefixtures("added")
def test_readme_example_is_a_method_of_map_command_and_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """GIVEN the file and the row of the README THEN a map, the command and the documentation have the method."""
    record = ring_down()
    np.savetxt(
        tmp_path / "ring.csv", np.column_stack((record.time, record.signals["q"])), delimiter=",", header="t,q",
        comments="",
    )  # fmt: skip
    signals = '[time]\ncolumn = "t"\n[signals]\nq = { column = "q", unit = "rad/s" }\n[modes]\noutputs = ["q"]\n'
    for name, text in (("by_map", 'method = "decrement"\n'), ("by_command", "")):
        (tmp_path / f"{name}.toml").write_text(signals + text, encoding="utf-8")
        words = [] if text else ["--method", "decrement"]
        table, mapping = str(tmp_path / "ring.csv"), str(tmp_path / f"{name}.toml")
        assert identify_command.run([table, "--map", mapping, "--json", *words]) == 0
        (fit,) = json.loads(capsys.readouterr().out)["fits"]
        (damping,) = fit["estimates"]
        assert damping["low"] < 0.1 < damping["high"]
    assert "decrement" in identify_command.build_parser().format_help()
    page = runpy.run_path(str(Path(__file__).parents[3] / "docs" / "write_estimators.py"))["reference"]()
    assert "| `decrement` | Logarithmic decrement | Klein & Morelli, 2016, ch. 7 |" in page


@pytest.mark.usefixtures("added")
def test_readme_example_works_on_a_flight() -> None:
    """GIVEN a flight with short maneuvers WHEN the added method is requested THEN its reason is given."""
    with pytest.raises(InputError, match="q: 2 peaks; three are needed"):
        identify_modes(fly(Flight(seed=1)), AIRCRAFT, method="decrement")


@pytest.mark.validate
def test_a_flight_by_one_method_has_the_numbers_of_all_together() -> None:
    flight = fly(Flight(seed=1))
    every = {one.method: one.frequency for one in identify_modes(flight, AIRCRAFT).modes}
    for method in methods("modes"):
        (mode,) = identify_modes(flight, AIRCRAFT, method=method).modes
        other = every[mode.method.lower()]
        assert (mode.frequency is None) == (other is None)
        if mode.frequency is not None and other is not None:
            assert abs(mode.frequency.value / other.value - 1.0) < 0.02

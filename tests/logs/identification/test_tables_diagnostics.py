"""What a table cannot tell is said, not printed as a number: forced motion, noise."""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lsim

from logs.identification.data.experiment import Experiment
from logs.identification.diagnostics import Context
from logs.identification.diagnostics.estimates import disagreements, with_regressor_noise
from logs.identification.diagnostics.model_structure import lack_of_fit, poor_fit
from logs.identification.estimators.equation_error import Settings
from logs.identification.estimators.equivalent_system import equivalent_system
from logs.identification.estimators.era import realization
from logs.identification.estimators.modal import records_of
from logs.identification.estimators.nonparametric import modes_of_experiments, modes_of_records
from logs.identification.estimators.registry import ESTIMATORS, Request
from logs.identification.report.tables import notes_of as said_of
from logs.identification.report.tables import table_document
from logs.identification.results import EstimationResult, FitSeries, estimate
from logs.identification.sources.table.run import identify_tables
from tests.logs.identification.test_frequency_equations import SLOW, exact
from tests.logs.identification.test_tables_identified import BASE, codes, flight
from tests.logs.identification.test_tables_strangers import identified
from wingbeat.errors import InputError

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"
STEP = 0.04
TIME = np.arange(0, 25, STEP)
FREE_MAP = """
[time]
column = 1
[signals]
q = { column = 2, unit = "rad/s" }
delta_e = { column = 3, unit = "rad" }
[maneuvers]
windows = [[%g, 25]]
[modes]
model = "none"
inputs = []
outputs = ["q"]
"""


def driven(slow: bool = False) -> Experiment:
    """Pitch rate and pitch after a 3-2-1-1, exact: 2 rad/s and 0.3, and where ``slow`` a phugoid of 0.2 rad/s."""
    delta = np.where((TIME > 2) & (TIME < 4.4), 0.05, 0.0) - np.where((TIME >= 4.4) & (TIME < 6), 0.05, 0.0)
    theta = filtered(delta, 2.0, 0.3) + (0.3 * filtered(delta, 0.2, 0.05) if slow else 0.0)
    q = np.gradient(theta, STEP)
    units = {"q": "rad/s", "theta": "rad", "delta_e": "rad"}
    return Experiment("one", TIME, {"q": q, "theta": theta, "delta_e": delta}, units)


def filtered(given: np.ndarray, frequency: float, damping: float) -> np.ndarray:
    """What an oscillator makes of ``given`` (N,), by its pulse response."""
    turn = frequency * np.sqrt(1 - damping**2)
    pulse = np.exp(-damping * frequency * TIME) * np.sin(turn * TIME) / turn
    return np.convolve(given, pulse)[: len(given)] * STEP


def noise(seed: int, colour: float) -> Experiment:
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(len(TIME), 2)) * 0.01
    for k in range(1, len(values)):
        values[k] += colour * values[k - 1]
    signals = {"alpha": values[:, 0], "q": values[:, 1], "delta_e": driven().signals["delta_e"]}
    return Experiment(f"noise {seed}", TIME, signals, {"alpha": "rad", "q": "rad/s", "delta_e": "rad"})


def test_free_response_of_a_record_in_which_the_control_moves_is_refused(tmp_path: Path) -> None:
    one = driven()
    q = one.signals["q"] + 1e-4 * np.random.default_rng(1).normal(size=len(TIME))
    table, mapping = tmp_path / "t.csv", tmp_path / "m.toml"
    np.savetxt(table, np.column_stack((TIME, q, one.signals["delta_e"])), delimiter=",")
    mapping.write_text(FREE_MAP % 0)
    with pytest.raises(InputError, match=r"delta_e moves until 5\.96 s in maneuver 1 of t\.csv"):
        identify_tables([table], mapping)
    mapping.write_text(FREE_MAP % 6.1)
    found = identify_tables([table], mapping).modes
    assert found is not None
    modes = {mode.method: mode for mode in found.modes}
    free = modes["free response"].frequency
    assert free is not None and free.value == pytest.approx(2.0, rel=0.01)


@pytest.mark.parametrize("colour", [0.0, 0.95])
def test_noise_has_no_mode_by_any_method(colour: float) -> None:
    for name in (None, "delta_e"):
        records = records_of((noise(1, colour),), name, ("alpha", "q"))
        for mode in modes_of_records(records, ("short_period",)):
            assert mode.frequency is None, (mode.method, name)


def test_pitch_in_the_equivalent_system_has_an_interval_of_some_width() -> None:
    records = records_of((driven(slow=True),), "delta_e", ("q", "theta"))
    mode = equivalent_system(records)
    assert mode.frequency is None or (mode.frequency.contains(2.0) and mode.frequency.standard_error > 1e-6)
    plain = equivalent_system(records_of((driven(),), "delta_e", ("q", "theta")))
    assert plain.frequency is not None
    assert plain.frequency.value == pytest.approx(2.0, rel=0.01)


def test_a_constant_output_and_a_short_record_are_refused_in_words() -> None:
    one = driven()
    still = one._replace(signals={**one.signals, "theta": np.full(len(TIME), 0.1)})
    short = one._replace(time=TIME[45:65], signals={name: v[45:65] for name, v in one.signals.items()})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        expected = [realization(records_of((e,), "delta_e", ("q", "theta"))).withheld[0].text for e in (still, short)]
    assert expected == ["an output is constant", "the records are too short: 20 of 30 samples needed"]


def test_an_input_that_rests_is_not_called_unmeasured() -> None:
    one = driven()
    resting = one._replace(signals={**one.signals, "delta_e": np.zeros(len(TIME))})
    modes = modes_of_experiments((resting,), "delta_e", ("q",)).modes
    assert modes[0].withheld[0].text == "the input does not move in the records"


def noisy_moment(seed: int, level: float) -> Experiment:
    """A coefficient of two rates that move together, the second measured with noise ``level`` of its spread."""
    rng, signals = np.random.default_rng(seed), driven().signals
    q, delta = signals["q"], filtered(signals["delta_e"], 2.5, 0.5)
    expected = 3 * q - 2 * delta + 0.02 * float(np.std(q)) * rng.normal(size=len(TIME))
    measured = q + level * float(np.std(q)) * rng.normal(size=len(TIME))
    units = {"q": "rad/s", "delta": "rad", "C": "-"}
    return Experiment("one", TIME, {"q": measured, "delta": delta, "C": expected}, units)


def regressed(flights: tuple[Experiment, ...], names: tuple[str, ...]) -> EstimationResult:
    return ESTIMATORS["equation_error_time"].estimate(Request(flights, outputs=("C",), regressors=names))


@pytest.mark.parametrize(("level", "reported"), [(0.15, True), (0.005, False)])
def test_intervals_include_the_bias_by_noise_in_a_regressor(level: float, reported: bool) -> None:
    """GIVEN q with noise THEN its coefficient, the other's and the intercept are off, and every interval holds it."""
    held, plain, names = [], [], ("q", "delta")
    for seed in range(30):
        flights = (noisy_moment(seed, level),)
        bare = regressed(flights, names)
        found, findings = with_regressor_noise(bare, flights, Settings())
        assert [one.value for one in found.estimates] == [one.value for one in bare.estimates]
        truth = {"intercept": 0.0, "q": 3.0, "delta": -2.0}
        held.append([one.contains(truth[one.name]) for one in found.estimates])
        plain.append([one.contains(truth[one.name]) for one in bare.estimates])
        assert ("q" in [one.subject for one in findings]) is reported
    assert np.all(np.mean(held, axis=0) >= 0.9)
    assert (np.mean(plain, axis=0)[1] < 0.5) is np.bool_(reported)


def test_a_regressor_that_is_noise_has_a_warning() -> None:
    flights = (noisy_moment(1, 1.5),)
    bare = regressed(flights, ("q", "delta"))
    found, findings = with_regressor_noise(bare, flights, Settings())
    assert ("noisy_regressor", "q") in [(one.code, one.subject) for one in findings]
    assert found.estimates[1].high > 3.0, "the interval includes the bias"


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_fast_motion_without_noise_is_not_called_noise(noise: float) -> None:
    """GIVEN q faster than its samples show WHEN the response follows it to 1 part in 1e6 THEN none of it is noise."""
    rng = np.random.default_rng(1)
    time = 0.1 * np.arange(300)
    q, delta = np.sin(5.0 * time + 2.0 * np.sin(0.3 * time)), np.sin(1.1 * time) + 0.5 * np.sin(5.0 * time)
    response = 3.0 * q - 2.0 * delta + 1e-6 * rng.normal(size=300)
    signals = {"q": q + noise * rng.normal(size=300), "delta": delta, "C": response}
    flights = (Experiment("one", time, signals, {"q": "rad/s", "delta": "rad", "C": "-"}),)
    bare = regressed(flights, ("q", "delta"))
    found, findings = with_regressor_noise(bare, flights, Settings())
    if noise:
        assert all(one.contains(true) for one, true in zip(found.estimates[1:], (3.0, -2.0), strict=True))
        return
    assert findings == ()
    wider = [
        one.standard_error / own.standard_error for one, own in zip(found.estimates, bare.estimates, strict=True)
    ]
    assert max(wider) < 3.0, "without that, a thousand times as wide"


@pytest.mark.parametrize("seeds", [(3,), tuple(range(9, 12)), tuple(range(24, 27))])
def test_realization_of_noise_that_no_input_moves_is_refused(seeds: tuple[int, ...]) -> None:
    """One record that once passed for a mode, and three at a time."""
    records = records_of(tuple(noise(seed, 0.0) for seed in seeds), "delta_e", ("alpha", "q"))
    assert "less than 50%" in realization(records).withheld[0].text


def test_a_realization_faster_than_the_input_is_no_mode() -> None:
    """GIVEN an elevator that moves within 1 Hz WHEN noise rings at 5 Hz THEN ERA gives no number of it."""
    time, reported = 0.02 * np.arange(1000), set()
    for seed in range(12):
        rng = np.random.default_rng(seed)
        delta = gaussian_filter1d(rng.normal(size=1000), 12)
        alpha = lsim(([-0.6, -63.0], [1.0, 9.0, 60.0]), 0.1 * delta / delta.std(), time)[1]
        signals = {"alpha": alpha + 0.005 * rng.normal(size=1000), "delta_e": 0.1 * delta / delta.std()}
        one = Experiment("one", time, signals, {"alpha": "rad", "delta_e": "rad"})
        found = realization(records_of((one,), "delta_e", ("alpha",)))
        assert found.frequency is None or found.frequency.contains(math.sqrt(60.0)), seed
        reported |= {each.text for each in found.withheld}
    assert any("above the input's bandwidth" in one for one in reported)


def test_an_equivalent_system_needs_some_periods_of_the_mode() -> None:
    """GIVEN one record of 9 s WHEN its mode takes 3.1 s THEN there is no number, in 25 s there is.

    Of one so short half of the intervals held the truth.
    """
    whole = driven()
    short = whole._replace(time=TIME[:225], signals={name: values[:225] for name, values in whole.signals.items()})
    given = [equivalent_system(records_of((one,), "delta_e", ("q", "theta"))) for one in (short, whole)]
    assert given[0].frequency is None and "of 4.9 periods of the mode" in given[0].withheld[0].text
    assert given[1].frequency is not None
    twice = equivalent_system(records_of((short, short, short), "delta_e", ("q", "theta")))
    assert twice.frequency is not None, "several short records are as good as a long one"


@pytest.mark.parametrize("outputs", [("q_dot",), ("q_dot", "a_z")])
def test_an_angular_acceleration_answers_the_input_at_once(outputs: tuple[str, ...]) -> None:
    """GIVEN 3.13 rad/s and 0.67 in q_dot WHEN the model has its direct power THEN the equivalent system has them.

    Without it q_dot alone gave 25 rad/s, with a_z 3.32.
    """
    one = exact(SLOW, 0.02, "foh", 0.8)
    q_dot = SLOW["M_alpha"] * one.signals["alpha"] + SLOW["M_q"] * one.signals["q"]
    q_dot = q_dot + SLOW["M_delta"] * one.signals["delta"]
    noise = np.random.default_rng(1).normal(0.0, 0.01, len(q_dot))
    whole = one._replace(signals={**one.signals, "q_dot": q_dot + noise}, units={**one.units, "q_dot": "rad/s^2"})
    mode = equivalent_system(records_of((whole,), "delta", outputs))
    assert mode.frequency is not None and mode.damping is not None
    assert mode.frequency.value == pytest.approx(math.sqrt(1.3 * 2.9 + 6.0), rel=0.015)
    assert mode.damping.value == pytest.approx(4.2 / 2.0 / math.sqrt(1.3 * 2.9 + 6.0), rel=0.015)


@pytest.mark.validate
@pytest.mark.parametrize(("late", "expected"), [(0, False), (3, True)])
def test_a_channel_that_is_late_is_more_than_noise(tmp_path: Path, late: int, expected: bool) -> None:
    """GIVEN a vane that is 0.12 s late THEN it is said how much more than noise the model leaves of it."""
    columns = flight(noise=0.5)
    columns["alpha"] = np.concatenate((np.repeat(columns["alpha"][0], late), columns["alpha"]))[: len(columns["t"])]
    found = identified(tmp_path, columns)
    assert bool({"lack_of_fit", "time_skew"} & codes(found)) is expected


def test_methods_that_know_one_input_are_left_out_where_a_second_moves() -> None:
    """GIVEN a second input THEN only what is free after both is used; one that rests with noise changes nothing."""
    one = driven()
    given = np.where((TIME > 9.0) & (TIME < 11.0), 0.05, 0.0)
    noise = np.random.default_rng(3).normal(0.0, 1e-4, len(TIME))
    signals = one.signals | {"q": one.signals["q"] + np.gradient(filtered(given, 2.0, 0.3), STEP)}
    both, resting = (one._replace(signals=signals | {"flap": flap}) for flap in (given + noise, noise))
    found = modes_of_experiments((both,), "delta_e", ("q",), others=("flap",)).modes
    expected = {mode.method: mode for mode in found}
    for name in ("equivalent system", "eigensystem realization", "spectrum"):
        assert expected[name].withheld[0].text == "flap moves as well: the method has one input"
    assert records_of((both,), "delta_e", ("q",), ("flap",)).pieces[0].free_from >= np.searchsorted(TIME, 11.0)
    plain = modes_of_experiments((resting,), "delta_e", ("q",)).modes
    assert [m.frequency for m in modes_of_experiments((resting,), "delta_e", ("q",), others=("flap",)).modes] == [
        m.frequency for m in plain
    ]


@pytest.mark.parametrize(("share", "expected"), [(0.02, "2"), (0.097, "10"), (0.2, "20"), (0.55, "55"), (1.0, "100")])
def test_what_a_model_lacks_is_told_in_whole_per_cents_of_the_power(share: float, expected: str) -> None:
    time = np.arange(0.0, 20.0, 0.02)
    model = math.sqrt(2.0 * (1.0 - share)) * np.sin(2.0 * np.pi * time)
    measured = model + math.sqrt(2.0 * share) * np.sin(np.pi * time)
    measured += np.random.default_rng(1).normal(0.0, 1e-4, len(time))
    series = (FitSeries("one", "q", "rad/s", time, measured, model),)
    (one,) = lack_of_fit(Context((), result=EstimationResult("output_error", series=series)))
    assert one.text.endswith(f" times its noise, {expected} % of its power")


def test_lack_of_fit_names_each_output() -> None:
    time = np.arange(0.0, 20.0, 0.02)
    noise = np.random.default_rng(1).normal(0.0, 1e-3, len(time))
    series = [
        FitSeries("one", name, "rad/s", time, np.sin(time) + share * np.sin(0.5 * time) + noise, np.sin(time))
        for name, share in (("p", 0.5), ("q", 0.0), ("r", 0.3))
    ]
    found = lack_of_fit(Context((), result=EstimationResult("output_error", series=tuple(series))))
    assert [one.subject for one in found] == ["p", "r"]


def test_warnings_stand_before_information(tmp_path: Path) -> None:
    """GIVEN samples that were not measured and spikes THEN the spikes come first, and JSON keeps both."""
    columns = flight()
    columns["q"] = columns["q"].copy()
    columns["q"][20:25] = np.nan
    columns["q"][[100, 160]] += 1.0
    found = identified(tmp_path, columns, BASE + 'states = 2\nmethod = "output_error"\n')
    fit = found.fits[0]
    lines = list(said_of(fit))
    places = [next(i for i, line in enumerate(lines) if word in line) for word in ("outliers", "not measured")]
    assert places == sorted(places)
    expected = table_document(found)["fits"][0]
    assert {"outliers", "missing_samples"} <= {one["code"] for one in expected["findings"]}
    assert all(set(one) == {"code", "severity", "subject", "value", "limit", "text"} for one in expected["findings"])


def test_a_poor_fit_is_reported_if_its_residuals_are_colored() -> None:
    time = np.arange(0.0, 20.0, 0.02)
    noise = np.random.default_rng(1).normal(0.0, 1.0, len(time))
    series = (
        FitSeries("one", "p", "rad/s", time, np.sin(time), np.sin(0.5 * time)),
        FitSeries("one", "q", "rad/s", time, 0.1 * np.sin(time) + noise, 0.1 * np.sin(time)),
    )
    found = poor_fit(Context((), result=EstimationResult("output_error", series=series)))
    assert [(one.subject, one.severity) for one in found] == [("p", "warning")]


@pytest.mark.parametrize("gap", [0.05, 1.0])
def test_results_that_contradict_each_other_are_reported(gap: float) -> None:
    """GIVEN M_alpha of output error and of a regression of q_dot THEN a difference beyond the intervals is found."""
    one = EstimationResult(
        "output_error", estimates=(estimate("M_alpha", "1/s^2", -6.0, 0.05),), title="output error"
    )
    other = EstimationResult(
        "equation_error",
        estimates=(estimate("alpha", "1/s^2", -6.0 - gap, 0.05),),
        response="q_dot",
        title="regression",
    )
    found = disagreements(Context((), inputs=("delta_e",), results=(one, other)))
    assert [each.subject for each in found] == (["M_alpha"] if gap == 1.0 else [])

"""Equation error on plain records: what is not sure of the delay is in its intervals, and no plain least squares."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.frequency_equations import EquationSettings, frequency_equation_error

STEP, TIME = 0.02, np.arange(0.0, 16.0, 0.02)
UNITS = {"alpha": "rad", "q": "rad/s", "delta": "rad"}


def simulated(seed: int, z_alpha: float = -1.2, m_q: float = -1.5, m_alpha: float = -6.0) -> Experiment:
    """A short period after a 3-2-1-1, with noise."""
    given = np.zeros(len(TIME))
    for start, end, size in ((1.0, 2.8, 0.05), (2.8, 4.0, -0.05), (4.0, 4.6, 0.05), (4.6, 5.2, -0.05)):
        given[(start <= TIME) & (end > TIME)] = size
    a, b = np.array([[z_alpha, 1.0], [m_alpha, m_q]]), np.array([[-0.15], [-8.0]])
    f, g, *_ = cont2discrete((a, b, np.eye(2), np.zeros((2, 1))), STEP, "foh")
    states, x = [], np.zeros(2)
    for value in given:
        x = f @ x + g[:, 0] * value
        states.append(x)
    noise = np.random.default_rng(seed).normal(size=(len(TIME), 2)) * [5e-4, 1e-3]
    alpha, q = (np.array(states) + noise).T
    return Experiment(f"flight {seed}", TIME, {"alpha": alpha, "q": q, "delta": given}, UNITS)


def test_the_error_of_a_delay_that_was_found_is_in_the_intervals() -> None:
    """GIVEN a delay that another method found to 30 ms THEN M_q is as unsure as 30 ms move it, at the least."""
    records, sure = (simulated(1), simulated(2)), EquationSettings(("delta",), {"Z_q": 0.0})
    exact = frequency_equation_error(records, sure)
    unsure = frequency_equation_error(records, sure._replace(delay_error=0.03))
    later = frequency_equation_error(records, sure._replace(delay=0.03))
    found, wider, moved = (next(e for e in mode.derivatives if e.name == "M_q") for mode in (exact, unsure, later))
    assert found.value == wider.value
    assert wider.standard_error == pytest.approx(np.hypot(found.standard_error, moved.value - found.value), rel=1e-6)
    assert wider.standard_error > 2.0 * found.standard_error


def test_equations_whose_own_motion_runs_away_give_nothing() -> None:
    """GIVEN a motion that doubles in a third of a second THEN noise in the regressors has no instrument."""
    short = simulated(1, m_alpha=8.0)
    kept = TIME < 4.0
    signals = {name: values[kept] for name, values in short.signals.items()}
    mode = frequency_equation_error((short._replace(time=TIME[kept], signals=signals),), EquationSettings(("delta",)))
    assert mode.frequency is None and "runs away" in mode.withheld[0].text


FAST = {"Z_alpha": -6.0, "Z_delta": -0.6, "M_alpha": -90.0, "M_q": -9.0, "M_delta": -110.0}
SLOW = {"Z_alpha": -1.3, "Z_delta": -0.12, "M_alpha": -6.0, "M_q": -2.9, "M_delta": -10.0}


def exact(truth: dict[str, float], step: float, way: str, unit: float) -> Experiment:
    """A 3-2-1-1 of ``unit`` s without noise, between samples as ``way`` (``zoh`` or ``foh``) has it."""
    time = np.arange(0.0, 24.0 * unit, step)
    given = np.zeros(len(time))
    for start, end, size in ((3, 6, 0.05), (6, 8, -0.05), (8, 9, 0.05), (9, 10, -0.05)):
        given[(start * unit - 1e-9 <= time) & (end * unit - 1e-9 > time)] = size
    a = np.array([[truth["Z_alpha"], 1.0], [truth["M_alpha"], truth["M_q"]]])
    b = np.array([[truth["Z_delta"]], [truth["M_delta"]]])
    _, states, _ = dlsim((*cont2discrete((a, b, np.eye(2), np.zeros((2, 1))), step, way)[:4], step), given)
    acting = np.concatenate((given[:1], given[:-1])) if way == "zoh" else given
    force = 100.0 * (truth["Z_alpha"] * states[:, 0] + truth["Z_delta"] * acting)
    signals = {"alpha": states[:, 0], "q": states[:, 1], "delta": given, "a_z": force}
    return Experiment("exact", time, signals, UNITS | {"a_z": "m/s^2"})


@pytest.mark.parametrize("airspeed", [None, 100.0])
@pytest.mark.parametrize(("truth", "step", "way", "unit"), [(FAST, 0.02, "foh", 0.16), (SLOW, 0.04, "zoh", 0.64)])
def test_few_samples_a_radian_leave_no_derivative_off(
    truth: dict[str, float], step: float, way: str, unit: float, airspeed: float | None
) -> None:
    """GIVEN 4 samples a radian, or an input that is held at 8 THEN the means beside the slopes leave nothing off."""
    hold = ("delta",) if way == "zoh" else ()
    asked = EquationSettings(("delta",), {"Z_q": 0.0}, airspeed, zoh_inputs=hold)
    mode = frequency_equation_error((exact(truth, step, way, unit),), asked)
    for one in mode.derivatives:
        assert one.value == pytest.approx(truth[one.name], rel=1e-5), one.name


MODEL = FAST | {"Z_q": -0.05}
TRAINER = {"Z_alpha": -2.5, "Z_q": -0.03, "Z_delta": -0.25, "M_alpha": -20.0, "M_q": -3.5, "M_delta": -30.0}
JET = SLOW | {"Z_q": -0.02}
PARTS, AIRSPEED = 10, 30.0


def delayed(truth: dict[str, float], rate: float, late: float, arm: float, way: str, noise: int = 0) -> Experiment:
    """A 3-2-1-1, ``late`` samples late, stepped exactly in tenths of one; noise of 2 % by a seed, if any."""
    a = np.array([[truth["Z_alpha"], 1.0 + truth["Z_q"]], [truth["M_alpha"], truth["M_q"]]])
    b, unit = np.array([[truth["Z_delta"]], [truth["M_delta"]]]), round(1.6 / np.sqrt(np.linalg.det(a)) * rate) / rate
    time = np.arange(round(24.0 * unit * rate)) / rate
    given = np.zeros(len(time))
    for start, end, size in ((3, 6, 0.05), (6, 8, -0.05), (8, 9, 0.05), (9, 10, -0.05)):
        given[(start * unit - 1e-9 <= time) & (end * unit - 1e-9 > time)] = size
    places = np.arange(len(time) * PARTS) / PARTS - late
    held = given[np.maximum(np.floor(places + 1e-9), 0).astype(int)]
    acting = held if way == "zoh" else np.interp(places, np.arange(len(time)), given)
    system = cont2discrete((a, b, np.eye(2), np.zeros((2, 1))), 1 / rate / PARTS, way)[:4]
    states = dlsim((*system, 1 / rate / PARTS), acting)[1][::PARTS]
    before = np.append(0.0, acting[:-1])[::PARTS] if way == "zoh" else acting[::PARTS]
    rates = states @ a.T + before[:, None] @ b.T
    force = AIRSPEED * (rates[:, 0] - states[:, 1]) - arm * rates[:, 1]
    clean = np.column_stack((states, force))
    told = clean + 0.02 * clean.std(axis=0) * np.random.default_rng(noise).normal(size=clean.shape) * (noise > 0)
    signals = {"alpha": told[:, 0], "q": told[:, 1], "delta": given, "a_z": told[:, 2]}
    return Experiment("delayed", time, signals, UNITS | {"a_z": "m/s^2"})


@pytest.mark.parametrize("way", ["zoh", "foh"])
@pytest.mark.parametrize(("airspeed", "arm"), [(None, 0.0), (AIRSPEED, 0.0), (AIRSPEED, 0.5)])
@pytest.mark.parametrize(
    "late", [0.0, pytest.param(0.3, marks=pytest.mark.validate), pytest.param(0.5, marks=pytest.mark.validate), 0.8]
)
@pytest.mark.parametrize(
    ("truth", "rate"), [(JET, 10.0), pytest.param(TRAINER, 20.0, marks=pytest.mark.validate), (MODEL, 100.0)]
)
def test_an_input_late_by_a_part_of_a_sample_leaves_no_derivative_off(
    truth: dict[str, float], rate: float, late: float, airspeed: float | None, arm: float, way: str
) -> None:
    """GIVEN inputs that are held, or lines, and late THEN the equations are those of the motion between samples."""
    hold = ("delta",) if way == "zoh" else ()
    asked = EquationSettings(("delta",), {}, airspeed, arm, late / rate, zoh_inputs=hold)
    mode = frequency_equation_error((delayed(truth, rate, late, arm, way),), asked)
    assert len(mode.derivatives) == 6
    for one in mode.derivatives:
        assert one.value == pytest.approx(truth[one.name], rel=1e-5), one.name


@pytest.mark.parametrize(
    ("truth", "rate", "late"),
    [
        pytest.param(JET, 10.0, 0.3, marks=pytest.mark.validate),
        pytest.param(MODEL, 50.0, 0.8, marks=pytest.mark.validate),
    ],
)
def test_the_intervals_of_late_held_inputs_hold_the_truth(truth: dict[str, float], rate: float, late: float) -> None:
    """Forty records with noise of 2 %: each derivative in 85 % of the intervals or more."""
    asked = EquationSettings(("delta",), {"Z_q": truth["Z_q"]}, AIRSPEED, 0.5, late / rate, zoh_inputs=("delta",))
    hits: dict[str, list[bool]] = {}
    for seed in range(1, 41):
        for one in frequency_equation_error((delayed(truth, rate, late, 0.5, "zoh", seed),), asked).derivatives:
            hits.setdefault(one.name, []).append(one.contains(truth[one.name]))
    assert len(hits) == 5
    assert all(np.mean(inside) >= 0.85 for inside in hits.values()), hits

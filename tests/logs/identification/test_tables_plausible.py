"""Signals that contradict one another are refused with the mistake that explains it; those that agree are not."""

from __future__ import annotations

import numpy as np
import pytest
from output_error_cases import LATERAL, LATERAL_TRUTH, steps
from output_error_cases import flown as flown_laterally

from logs.identification.data.experiment import Experiment
from logs.identification.diagnostics.consistency_checks import check_plausible
from logs.identification.diagnostics.derivative_signs import turned
from logs.identification.diagnostics.unit_sign_errors import Known, said_of
from logs.identification.results import Estimate, estimate
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError

STEP, SPEED = 0.02, 20.0
UNITS = {"alpha": "rad", "theta": "rad", "q": "rad/s", "a_z": "m/s^2"}


def flown(imu_x: float = 0.0, noise: float = 1.0, seed: int = 1, **scales: float) -> Experiment:
    """A short period after doublets, level flight; each of ``scales`` multiplies a signal."""
    rng, time = np.random.default_rng(seed), np.arange(0.0, 12.0, STEP)
    delta = 0.1 * np.sign(np.sin(2.0 * np.pi * time / 3.0)) * (np.sin(2.0 * np.pi * time / 6.0) > 0)
    states, q_dot = np.zeros((len(time), 3)), np.zeros(len(time))
    for k in range(len(time)):
        alpha, q, _ = states[k]
        q_dot[k] = -20.0 * alpha - 3.0 * q + 15.0 * delta[k]
        if k + 1 < len(time):
            states[k + 1] = states[k] + STEP * np.array([q - 2.5 * alpha, q_dot[k], q])
    alpha, q, theta = states.T
    signals = {"alpha": 0.08 + alpha, "theta": 0.08 + theta, "q": q}
    signals["a_z"] = -STANDARD_GRAVITY - 2.5 * SPEED * alpha - imu_x * q_dot
    for name, size in (("alpha", 2e-3), ("theta", 2e-3), ("q", 4e-3), ("a_z", 0.2)):
        signals[name] = (signals[name] + noise * size * rng.normal(size=len(time))) * scales.get(name, 1.0)
    return Experiment("one", time, signals, UNITS)


def without(one: Experiment, *names: str) -> Experiment:
    return one._replace(signals={name: values for name, values in one.signals.items() if name not in names})


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("scale", [0.85, 1.0, 1.15])
@pytest.mark.parametrize("imu_x", [0.0, 0.4])
def test_a_flight_with_errors_of_scale_is_none_of_these_mistakes(seed: int, scale: float, imu_x: float) -> None:
    check_plausible((flown(imu_x, seed=seed, alpha=scale, a_z=scale),), {"V": SPEED})


@pytest.mark.parametrize(
    ("scales", "said"),
    [
        ({"a_z": -1.0}, r"a_z is \+9\.\d m/s\^2 on the mean .* scale = -1\.0"),
        ({"a_z": STANDARD_GRAVITY}, "it is in m/s.2 already, not in g"),
        ({"a_z": 1.0 / STANDARD_GRAVITY}, "a_z does not fit the changes of alpha and q: it is in g, not in m/s"),
        ({"theta": -1.0}, "theta changes against q"),
        ({"theta": np.pi / 180}, "theta changes 57 times as slowly as q says"),
        ({"q": 180 / np.pi, "alpha": 1.0}, "57 times as slowly as q says"),
    ],
)
def test_a_known_mistake_is_named(scales: dict[str, float], said: str) -> None:
    with pytest.raises(InputError, match=said):
        check_plausible((flown(**scales),), {"V": SPEED})


@pytest.mark.parametrize(("told", "right"), [(10.3, False), (14.0, True), (SPEED, True), (30.0, True), (38.9, False)])
def test_an_airspeed_of_the_constants_that_is_not_the_measured_one_is_refused(told: float, right: bool) -> None:
    """GIVEN 20 m/s measured, in knots or of knots taken for m/s in the constants THEN it is said."""
    moved = flown_at(np.full(len(flown().time), SPEED))
    if right:
        check_plausible((moved,), {"V": told})
        return
    with pytest.raises(InputError, match=rf"constants.V is {told:.4g} m/s and signals.V 20 m/s: one of both"):
        check_plausible((moved,), {"V": told})


def flown_at(speed: np.ndarray) -> Experiment:
    """`flown` with an airspeed, without a_z."""
    one = without(flown(), "a_z")
    return one._replace(signals=one.signals | {"V": speed}, units=one.units | {"V": "m/s"})


def test_spikes_a_blocked_pitot_and_changes_of_the_airspeed_say_nothing_of_its_unit() -> None:
    steady = np.full(len(flown().time), SPEED)
    spiky, blocked = steady.copy(), steady.copy()
    spiky[7], blocked[: len(blocked) * 2 // 5] = 5e4, 0.0
    for speed in (spiky, blocked, steady - SPEED + 0.3, steady - SPEED - 0.3):
        check_plausible((flown_at(speed),), {"V": SPEED})


def test_the_sign_of_an_a_z_without_its_mean_is_told_by_alpha_and_q() -> None:
    one = flown(a_z=-1.0)
    level = one.signals["a_z"] - one.signals["a_z"].mean()
    with pytest.raises(InputError, match="a_z is against the changes of alpha and q: its sign is wrong"):
        check_plausible((one._replace(signals={**one.signals, "a_z": level}),), {"V": SPEED})


def test_nothing_is_concluded_from_noise_gaps_or_missing_signals() -> None:
    noisy = flown(noise=60.0, theta=-1.0)
    gaps = flown(theta=-1.0)
    gaps.signals["q"][::10] = np.nan
    for one in (noisy, gaps, without(flown(theta=-1.0), "q"), without(flown(a_z=-1.0), "a_z", "theta")):
        check_plausible((one,), {})


def turning(seed: int = 1, **scales: float) -> Experiment:
    """Speed, bank, pitch and sideslip that swing as prescribed, 20 s; specific forces and rates follow."""
    rng, time = np.random.default_rng(seed), np.arange(0.0, 20.0, STEP)
    theta, phi = 0.1 + 0.08 * np.sin(0.5 * time), 0.3 * np.sin(0.6 * time)
    u, v = 30.0 + 3.0 * np.cos(0.5 * time), 1.5 * np.sin(1.1 * time)
    w, heading = 2.0 + 0.5 * np.sin(0.9 * time), 0.15 * np.sin(0.6 * time)
    p = np.gradient(phi, STEP) - heading * np.sin(theta)
    q = np.gradient(theta, STEP) * np.cos(phi) + heading * np.cos(theta) * np.sin(phi)
    r = -np.gradient(theta, STEP) * np.sin(phi) + heading * np.cos(theta) * np.cos(phi)
    g, speed = STANDARD_GRAVITY, np.sqrt(u**2 + v**2 + w**2)
    a_x = np.gradient(u, STEP) + q * w - r * v + g * np.sin(theta)
    a_y = np.gradient(v, STEP) + r * u - p * w - g * np.cos(theta) * np.sin(phi)
    signals = {"V": speed, "alpha": np.arctan2(w, u), "beta": np.arcsin(v / speed), "theta": theta, "phi": phi}
    signals |= {"p": p, "q": q, "r": r, "a_x": a_x + 0.2, "a_y": a_y - 0.15}
    for name, size in (("V", 0.3), ("alpha", 3e-3), ("beta", 3e-3), ("a_x", 0.1), ("a_y", 0.1)):
        signals[name] = (signals[name] + size * rng.normal(size=len(time))) * scales.get(name, 1.0)
    return Experiment("one", time, signals, {})


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("scale", [0.85, 1.0, 1.15])
def test_forces_that_speed_and_attitude_bear_out_are_taken(seed: int, scale: float) -> None:
    check_plausible((turning(seed, a_x=scale, a_y=scale),), {})


@pytest.mark.parametrize("force", ["a_x", "a_y"])
@pytest.mark.parametrize(
    ("scale", "said"), [(-1.0, "its sign is wrong"), (1 / STANDARD_GRAVITY, "it is in g"), (9.80665, "it is in m/s")]
)
def test_a_force_against_speed_and_attitude_is_refused(force: str, scale: float, said: str) -> None:
    with pytest.raises(InputError, match=f"{force} .*{said}"):
        check_plausible((turning(**{force: scale}),), {})


@pytest.mark.parametrize(("scale", "said"), [(1.0, ""), (0.0, ""), (-1.0, "its sign is wrong")])
def test_a_steady_climb_tells_the_sign_of_a_x_by_its_mean(scale: float, said: str) -> None:
    """GIVEN 0.1 rad of pitch at constant speed THEN a_x is g sin(theta), whatever its bias."""
    rng, count = np.random.default_rng(4), 500
    signals = {"V": np.full(count, 40.0), "alpha": np.full(count, 0.06), "theta": np.full(count, 0.1)}
    signals |= {"q": np.zeros(count), "a_x": np.full(count, STANDARD_GRAVITY * np.sin(0.1) + 0.2)}
    for name, size in (("V", 0.3), ("alpha", 3e-3), ("theta", 2e-3), ("q", 3e-3), ("a_x", 0.05)):
        signals[name] = signals[name] + size * rng.normal(size=count)
    signals["a_x"] = scale * signals["a_x"]
    one = Experiment("one", STEP * np.arange(count), signals, {})
    if not said:
        return check_plausible((one,), {})
    with pytest.raises(InputError, match=f"a_x .*{said}"):
        check_plausible((one,), {})
    return None


def rung(seed: int, speed: float, noise: tuple[float, float, float]) -> Experiment:
    """A lightly damped motion that fades, 30 Hz, with ``noise`` of alpha (rad), q (rad/s) and a_z (m/s^2)."""
    rng, time = np.random.default_rng(seed), np.arange(0.0, 20.0, 1.0 / 30.0)
    lift, rate = -0.45, np.array([[-0.45, 1.0], [-39.3, -0.24]])
    values, vectors = np.linalg.eig(rate)
    weights = np.linalg.solve(vectors, np.array([0.15, 0.0]))
    alpha, q = np.real((vectors * weights) @ np.exp(np.outer(values, time)))
    signals = {"alpha": 0.1 + alpha, "q": q, "a_z": lift * speed * alpha - STANDARD_GRAVITY}
    for name, size in zip(signals, noise, strict=True):
        signals[name] = signals[name] + size * rng.normal(size=len(time))
    return Experiment("rung", time, signals, UNITS)


@pytest.mark.parametrize(("speed", "force"), [(7.0, 0.2), (7.0, 0.5)])
def test_what_noise_adds_up_to_is_no_mistake(speed: float, force: float) -> None:
    """With all of the motion alone 15 % and more of these were refused."""
    for seed in range(40):
        check_plausible((rung(seed, speed, (0.005, 0.017, force)),), {"V": speed})


@pytest.mark.parametrize("seed", range(20))
def test_a_mistake_is_named_whatever_the_noise(seed: int) -> None:
    with pytest.raises(InputError, match="it is in g, not in m/s"):
        check_plausible((flown(seed=seed, a_z=1.0 / STANDARD_GRAVITY),), {"V": SPEED})
    with pytest.raises(InputError, match="is it in kn, not in m/s"):
        check_plausible((flown(seed=seed, noise=0.3),), {"V": SPEED * 3600.0 / 1852.0})


@pytest.mark.parametrize(("unit", "times"), [("kn", 3600.0 / 1852.0), ("ft/s", 1.0 / 0.3048), ("km/h", 3.6)])
@pytest.mark.parametrize("more", [0.0, 0.15])
def test_a_speed_in_another_unit_is_told_though_vane_and_forces_are_off(unit: str, times: float, more: float) -> None:
    """Either way round; a vane that reads 15 % more and one that is 0.5 m ahead do not hide it."""
    one = flown(alpha=1.0 + more)
    one.signals["alpha"] = one.signals["alpha"] - more * 0.5 / SPEED * one.signals["q"]
    check_plausible((one,), {"V": SPEED})
    for speed, said in (
        (SPEED * times, f"is it in .*{unit}, not in m/s"),
        (SPEED / times, f"is it in m/s, not in .*{unit}"),
    ):
        with pytest.raises(InputError, match=f"V does not fit alpha, q and a_z: {said}"):
            check_plausible((one,), {"V": speed})


def test_a_mistake_that_leaves_nothing_at_all_is_named() -> None:
    """GIVEN a table without any noise, of which the mended terms leave 0."""
    known = [Known("V does not fit: is it in", {"pushed": 2.0}, (unit, "m/s")) for unit in ("kn", "mph")]
    assert (
        said_of([(0.0, known[0]), (0.1, known[1])])
        == "V does not fit: is it in kn, not in m/s, or is their scale wrong?"
    )


def test_an_airspeed_by_its_other_name_is_asked_for_its_unit() -> None:
    one = flown(noise=0.3)
    one.signals["airspeed"] = np.full(len(one.time), SPEED * 3600.0 / 1852.0)
    with pytest.raises(InputError, match="is it in kn, not in m/s"):
        check_plausible((one,), {})


SIDEWAYS = {"V": 20.0, "theta": 0.06, "alpha": 0.06}


def sideslipping(seed: int, noise: float, **scales: float) -> Experiment:
    """The lateral motion after steps of both controls; each of ``scales`` multiplies a signal."""
    time = 0.02 * np.arange(1000)
    inputs = np.column_stack((steps(time, 9.0, 0.3, 0.05), steps(time, 1.0, 0.4, 0.08)))
    record = flown_laterally(LATERAL, LATERAL_TRUTH, inputs, 0.02, noise, seed)
    return record._replace(
        signals={name: scales.get(name, 1.0) * np.asarray(v) for name, v in record.signals.items()}
    )


@pytest.mark.parametrize("noise", [0.02, 0.2])
def test_a_lateral_motion_is_none_of_these_mistakes(noise: float) -> None:
    for seed in range(10):
        check_plausible((sideslipping(seed, noise, beta=1.2, a_y=0.9),), SIDEWAYS)


@pytest.mark.parametrize(
    ("scales", "said"),
    [
        ({"a_y": -1.0}, "a_y is against the changes of beta: its sign is wrong"),
        ({"a_y": 1.0 / STANDARD_GRAVITY}, "a_y does not fit the changes of beta: it is in g, not in m/s"),
        ({"r": -1.0}, "r is against the changes of beta"),
        ({"r": np.pi / 180}, "r does not fit the changes of beta: it is in rad/s, not in deg/s"),
        ({"beta": -1.0}, "beta changes against p, r, phi and a_y"),
    ],
)
def test_a_known_mistake_of_the_lateral_motion_is_named(scales: dict[str, float], said: str) -> None:
    for seed in range(5):
        with pytest.raises(InputError, match=said):
            check_plausible((sideslipping(seed, 0.02, **scales),), SIDEWAYS)


@pytest.mark.parametrize("scales", [{"V": 1.05}, {"V": 0.95}, {"a_y": 0.9}, {"r": 1.05, "p": 0.95}, {"phi": 0.93}])
def test_turns_that_balance_do_not_make_a_mistake_of_a_sensors_scale(scales: dict[str, float]) -> None:
    """GIVEN a coordinated flight, in which a_y is next to nothing, and 4 % of airspeed: it was told to be in g."""
    for seed in range(6):
        check_plausible((turning(seed, **scales),), {})


def test_a_bank_tells_the_unit_of_the_speed() -> None:
    with pytest.raises(InputError, match=r"V does not fit beta, r, phi and a_y: is it in kn.*, not in m/s"):
        check_plausible((turning(V=3600.0 / 1852.0),), {})


def test_derivatives_of_no_aircraft_are_named() -> None:
    def one(name: str, value: float) -> Estimate:
        return estimate(name, "", value, 0.1)

    assert turned([one("Y_beta", -3.0), one("L_p", 0.1), one("Z_alpha", -1.0), one("C_D_0", 0.5)]) == ()
    (said,) = turned([one("Y_beta", 3.0), one("L_p", 1.0), one("M_alpha", 4.0)])
    assert said.startswith("Y_beta, L_p have the signs of no aircraft")
    (said,) = turned([one("intercept", -0.5), one("alpha", 3.0)], "C_D")
    assert said.startswith("intercept has the sign of no aircraft")

"""The filter over strokes: its forecasts' errors have the covariance that it says, and a still system is exact."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from logs.identification.estimators.flight.gust_filter import Averaged, Driven, Kinds, innovations
from logs.identification.results import Array

A = np.array([[-1.0, 6.0, 0.5], [-4.0, -2.0, -1.0], [0.0, 0.0, -0.8]])
"""two states that move, one of gusts"""
C = np.array([[1.0, 0.3, 0.0], [0.2, -1.0, 0.7]])
LENGTHS = np.array([0.2, 0.25])
STEPS = 200


def system(intensity: float, noise: float, start: float) -> Driven:
    density = np.diag([0.0, 0.0, intensity, 0.0, 0.0])
    one = (
        A,
        np.array([[2.0], [-5.0]]),
        C,
        np.array([[0.4], [0.0]]),
        density,
        start**2 * np.eye(3),
        np.full(2, 1e-6),
        np.full(2, noise),
    )
    return Driven(*(each[..., None] for each in (*one, np.zeros((5, 3)), np.zeros((5, 5)))))


def beside(each: list[Driven]) -> Driven:
    """Several systems as one call takes them."""
    return Driven(*(np.concatenate(parts, axis=-1) for parts in zip(*each, strict=True)))


def flown(seed: int, strokes: int, intensity: float, noise: float, start: float) -> Averaged:
    """Strokes of the system by steps of a two-hundredth, each exact, its outputs averaged by the trapezoidal rule."""
    rng = np.random.default_rng(seed)
    which = rng.integers(0, 2, strokes)
    tail = np.cumsum(rng.normal(0, 0.02, strokes * STEPS + 1))
    state = np.concatenate((rng.normal(0, start, 3), [0.0]))
    averages, tails = [], []
    for k in range(strokes):
        step = LENGTHS[which[k]] / STEPS
        over = expm(np.block([[A, np.array([[2.0], [-5.0], [0.0]])], [np.zeros((1, 4))]]) * step)
        part = tail[k * STEPS : (k + 1) * STEPS + 1]
        outputs = []
        for i in range(STEPS):
            outputs.append(C @ state[:3] + np.array([0.4, 0.0]) * part[i])
            state[3] = (part[i] + part[i + 1]) / 2
            state = over @ state
            state[2] += rng.normal(0, np.sqrt(intensity * step))
        outputs.append(C @ state[:3] + np.array([0.4, 0.0]) * part[-1])
        averages.append(np.trapezoid(outputs, axis=0) / STEPS + rng.normal(0, noise, 2))
        tails.append(part)
    first = np.arange(strokes) == 0
    kinds = Kinds(LENGTHS, np.ones(2), np.zeros((2, 2, 2)), which[:, None], np.ones((strokes, 1)))
    return Averaged(kinds, first, np.array(tails)[:, None], np.array(averages))


def whitened(seed: int) -> Array:
    (white,) = innovations(system(0.5, 0.02, 0.3), flown(seed, 60, 0.5, 0.02, 0.3)).white
    return white


def test_forecasts_err_by_what_the_filter_says_and_one_does_not_foretell_the_next() -> None:
    white = np.array([whitened(seed) for seed in range(12)])
    values = white.ravel()
    assert np.mean(values**2) == pytest.approx(1.0, abs=4 * np.sqrt(2 / values.size))
    for shift in (1, 2):
        product = np.mean(white[:, shift:] * white[:, :-shift], axis=(0, 1))
        assert np.all(np.abs(product) < 4 / np.sqrt(white[:, shift:, 0].size))


def test_without_noise_the_forecast_is_the_measured() -> None:
    """GIVEN an aircraft that starts at rest and no gust THEN every stroke's average is foretold."""
    averaged = flown(5, 30, 0.0, 0.0, 0.0)
    found = innovations(system(0.0, 1e-6, 0.0), averaged)
    np.testing.assert_allclose(found.surprise, 0.0, atol=2e-4 * np.ptp(averaged.outputs))


def test_a_new_stretch_forgets_the_one_before() -> None:
    one = flown(3, 20, 0.5, 0.02, 0.3)
    kinds = one.kinds._replace(which=np.tile(one.kinds.which, (2, 1)), shares=np.tile(one.kinds.shares, (2, 1)))
    twice = Averaged(kinds, np.tile(one.first, 2), np.tile(one.inputs, (2, 1, 1)), np.tile(one.outputs, (2, 1)))
    found = innovations(system(0.5, 0.02, 0.3), twice)
    np.testing.assert_array_equal(found.surprise[:, :20], found.surprise[:, 20:])
    np.testing.assert_array_equal(found.root[:, :20], found.root[:, 20:])


def dense(one: Driven, averaged: Averaged) -> tuple[Array, Array, Array]:
    """Surprises, covariances and motion of the first stretch by SciPy's exponentials and the textbook's filter.

    Its state holds the integrals of the outputs, zero when a stroke begins, and the outputs' biases. The inputs do
    not act.
    """
    rates = np.zeros((7, 7))
    rates[:3, :3], rates[3:5, :3] = one.a[..., 0], one.c[..., 0]
    density = np.zeros((7, 7))
    density[:5, :5] = one.density[..., 0]
    state, known, surprises, covariances, ends = np.zeros(7), np.zeros((7, 7)), [], [], [np.zeros(2)]
    known[:3, :3], known[5:, 5:] = one.start[..., 0], np.diag(one.bias[:, 0] ** 2)
    for which, output in zip(averaged.kinds.which[:, 0], averaged.outputs, strict=True):
        length = averaged.kinds.lengths[which]
        # van Loan, IEEE Transactions on Automatic Control 23, 1978
        both = expm(np.block([[-rates, density], [np.zeros((7, 7)), rates.T]]) * length)
        over = both[7:, 7:].T
        seen = np.hstack((np.zeros((2, 3)), np.eye(2) / length, np.eye(2)))
        state, known = over @ state, over @ known @ over.T + over @ both[:7, 7:]
        covariance = seen @ known @ seen.T + np.diag(one.noise[:, 0] ** 2)
        gain = known @ seen.T @ np.linalg.inv(covariance)
        surprises.append(output - seen @ state)
        covariances.append(covariance)
        state, known = state + gain @ surprises[-1], known - gain @ covariance @ gain.T
        state[3:5] = known[3:5] = known[:, 3:5] = 0.0
        ends.append(state[:2].copy())
    return np.array(surprises), np.array(covariances), (np.array(ends)[1:] + np.array(ends)[:-1]) / 2.0


def test_surprise_and_covariance_are_those_of_dense_linear_algebra() -> None:
    """GIVEN systems side by side that share all, nothing, the strokes or the inputs' work with the first."""
    averaged = flown(7, 25, 0.5, 0.02, 0.3)
    averaged = averaged._replace(inputs=np.zeros_like(averaged.inputs))
    base = system(0.5, 0.02, 0.3)
    known = np.array([[0.5, 0.1, 0.0], [0.1, 0.4, -0.2], [0.0, -0.2, 0.3]])[..., None]
    each = [base, base._replace(a=1.2 * base.a, c=0.7 * base.c), system(0.5, 0.05, 0.3), system(0.9, 0.02, 0.1), base]
    each.append(base._replace(start=known))
    found = innovations(beside(each), averaged)
    for place, one in enumerate(each):
        surprise, covariance, motion = dense(one, averaged)
        np.testing.assert_allclose(found.followed[place], motion, atol=1e-9)
        root = found.root[place]
        np.testing.assert_allclose(found.surprise[place], surprise, atol=1e-9)
        np.testing.assert_allclose(root @ root.transpose(0, 2, 1), covariance, rtol=1e-8, atol=1e-12)
        white = np.linalg.solve(root, surprise[:, :, None])[:, :, 0]
        np.testing.assert_allclose(found.white[place], white, atol=1e-7)


def test_at_another_airspeed_the_filter_is_that_of_the_system_there() -> None:
    """GIVEN a part that grows with the airspeed, and kinematics of a stroke's own THEN each is of its own system."""
    averaged, base = flown(9, 25, 0.5, 0.02, 0.3), system(0.5, 0.02, 0.3)
    growing, denser = 0.3 * np.concatenate((base.a, base.c)), 0.5 * base.density
    turned = np.array([np.zeros((2, 2)), [[0.0, 0.8], [-0.5, 0.0]]])
    fast = averaged._replace(kinds=averaged.kinds._replace(airspeeds=np.array([1.0, 1.3]), kinematics=turned))
    found = innovations(base._replace(growing=growing, denser=denser), fast)
    rates, kinds = np.concatenate((base.a, base.c)) + 0.3 * growing, averaged.kinds.which[:, 0]
    rates[:2, :2] += turned[1][..., None]
    there = base._replace(a=rates[:3], c=rates[3:], density=base.density + 0.3 * denser)
    for kind, alone in ((0, base), (1, there)):
        # The first stroke of a stretch knows of none before: each alone is foretold by its own system.
        single = innovations(alone, averaged._replace(first=np.full(25, True)))
        each = innovations(base._replace(growing=growing, denser=denser), fast._replace(first=np.full(25, True)))
        np.testing.assert_allclose(each.surprise[0, kinds == kind], single.surprise[0, kinds == kind], atol=1e-12)
        np.testing.assert_allclose(each.root[0, kinds == kind], single.root[0, kinds == kind], atol=1e-12)
    assert not np.allclose(found.surprise, innovations(base, averaged).surprise)


def test_between_two_airspeeds_a_stroke_is_nearly_that_of_its_own() -> None:
    """GIVEN the system an eighth of the airspeed apart THEN in between the forecast is right to its second order."""
    averaged, base = flown(10, 25, 0.5, 0.02, 0.3), system(0.5, 0.02, 0.3)
    base = base._replace(growing=0.3 * np.concatenate((base.a, base.c)), denser=0.5 * base.density)
    own = innovations(base, averaged._replace(kinds=averaged.kinds._replace(airspeeds=np.full(2, 1.03125))))
    places, shares = averaged.kinds.which + np.array([0, 2]), np.tile([0.75, 0.25], (25, 1))
    kinds = Kinds(np.tile(LENGTHS, 2), np.repeat([1.0, 1.125], 2), np.zeros((4, 2, 2)), places, shares)
    found, slower = innovations(base, averaged._replace(kinds=kinds)), innovations(base, averaged)
    for near, far, exact in zip(found, slower, own, strict=True):
        assert np.max(np.abs(near - exact)) < 0.05 * np.max(np.abs(far - exact))


def test_systems_side_by_side_are_each_what_they_are_alone() -> None:
    """GIVEN inputs that act THEN what is shared with the first system is the same as what is found anew."""
    averaged, base = flown(8, 25, 0.5, 0.02, 0.3), system(0.5, 0.02, 0.3)
    each = [base, base._replace(b=2.0 * base.b), base._replace(d=-base.d), base._replace(a=1.1 * base.a), base]
    found = innovations(beside(each), averaged)
    for place, one in enumerate(each):
        alone = innovations(one, averaged)
        for together, single in zip(found, alone, strict=True):
            np.testing.assert_array_equal(together[place], single[0])

"""Covariance of a linear estimate whose residuals are coloured: the recipe behind every interval of a regression.

An estimate that is linear in the samples, theta = W^T z, has the covariance W^T Gamma W, with Gamma the residuals'
autocovariance. Two ways to have Gamma:

`parzen`, the default. A lag window of a tenth of the record is shorter than the memory of slow residuals, and fitted
residuals lack what the regressors took of them: alone it promises up to three times too little. So the residuals are
first made white by an autoregression (`autoregression`; Andrews & Monahan, Econometrica 60, 1992); the lag window
(Parzen's, N/10) sees what that left, corrected for the fit; and the autoregression colours the result again. What is
not known of Gamma itself widens the intervals by Student's factor, by each parameter's degrees of freedom
(Satterthwaite, Biometrics 2, 1946): an intercept under slow noise has few of them, a derivative in the same fit many.

`all lags`, Morelli & Klein, Accuracy of Aerodynamic Model Parameters Estimated from Flight Test Data, J. Guidance
20(1), 1997: the residuals' autocovariance as it is, at all lags. It promises too much: see the README.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.signal import lfilter

from logs.identification.results import Array
from logs.identification.statistics.autoregression import Autoregression, autocovariance, autoregression_of, runs
from logs.identification.statistics.residual_autocorrelation import parzen

Complex = NDArray[np.complex128]
STEP = 1e-3
LEAST_SHARE = 0.1
"""-; of the white density, that the whitened residuals have at every frequency: less has come about by chance"""
FINE = 16
"""-; frequencies per lag at which that is seen to"""


class Linear(NamedTuple):
    """One record of a linear estimate."""

    weights: Array
    """(N, p); theta is the sum over records of weights^T response"""
    basis: Array
    """(N, p); orthonormal over all records, spans the columns that the residuals are orthogonal to"""
    residuals: Array
    """(N,); 0 where not used"""
    used: Array
    """-; (N,), 1.0 or 0.0"""


class Noise(NamedTuple):
    """What is known of the noise in a response."""

    autocovariance: Array
    """residual squared; (N,), at the lags of the longest record"""
    model: Autoregression
    lags: int
    """-; of Parzen's window"""
    pairs: float
    """-; whitened samples"""
    free: float
    """-; samples less fitted parameters"""


class Coloured(NamedTuple):
    """Covariance of an estimate and what it is worth."""

    covariance: Array
    """(p, p)"""
    degrees: Array
    """-; (p,), effective degrees of freedom of each parameter's variance"""


def white(records: tuple[Linear, ...]) -> Coloured:
    """The textbook's covariance, true of white residuals alone."""
    squares, free = _squares(records), _free(records)
    covariance = np.sum([r.weights.T @ r.weights for r in records], axis=0) * (squares / free)
    return Coloured(np.asarray(covariance), np.full(records[0].weights.shape[1], free))


def all_lags(records: tuple[Linear, ...]) -> Coloured:
    """Morelli & Klein's covariance with the residuals' autocovariance at all lags, as published."""
    records = _not_empty(records)
    longest = max(len(record.used) for record in records)
    sums, count = np.zeros(longest), sum(float(r.used.sum()) for r in records)
    for record in records:
        sums[: len(record.used)] += correlate(record.residuals[:, None], len(record.used))[:, 0]
    free = _free(records)
    return Coloured(_quadratic(records, sums / count), np.full(records[0].weights.shape[1], free))


def prewhitened(records: tuple[Linear, ...], least_lags: int = 1) -> Coloured:
    """The default: Parzen's window of a tenth of the longest record on residuals made white.

    The window has at least ``least_lags`` lags. A record of no samples adds nothing.

    Raises:
        numpy.linalg.LinAlgError: nothing is left to learn the residuals' colour from.
    """
    return under(noise_of(records, least_lags), records)


def noise_of(records: tuple[Linear, ...], least_lags: int = 1) -> Noise:
    """What made the residuals of ``records``; raises as `prewhitened`."""
    records = _not_empty(records)
    basis, residuals, used = ([record[k] for record in records] for k in (1, 2, 3))
    model = autoregression_of(basis, residuals, used)
    longest = max(len(mask) for mask in used)
    lags = max(int(longest / 10), least_lags, 1)
    window, pairs = _white_autocovariance(records, model, lags)
    autocovariances = _coloured_again(_nowhere_negative(window), model, longest)
    return Noise(autocovariances, model, lags, pairs, _free(records))


def under(noise: Noise, records: tuple[Linear, ...]) -> Coloured:
    """Covariance of the estimate by the weights of ``records`` under ``noise``, theirs or a fuller model's."""
    records = _not_empty(records)
    doubt = 2 / noise.free + _doubt_of_model(records, noise.model) + _doubt_of_window(records, noise)
    return Coloured(_quadratic(records, noise.autocovariance), np.maximum(2 / doubt, 1.0))


def _not_empty(records: tuple[Linear, ...]) -> tuple[Linear, ...]:
    """The ``records`` that have samples, of which there is one or more.

    Raises:
        numpy.linalg.LinAlgError: no record has any.
    """
    if not (some := tuple(record for record in records if len(record.used))):
        raise np.linalg.LinAlgError("no record has a sample")
    return some


def _squares(records: tuple[Linear, ...]) -> float:
    return float(sum(record.residuals @ record.residuals for record in records))


def _free(records: tuple[Linear, ...]) -> float:
    count = sum(float(record.used.sum()) for record in records)
    return float(max(count - records[0].weights.shape[1], 1.0))


def correlate(columns: Array, lags: int) -> Array:
    """Sum of each column of ``columns`` (N, k) times itself, at lags 0 to ``lags`` - 1, N at most: (lags, k)."""
    size = _room_for(len(columns) + lags)
    power = np.abs(rfft(columns, size, axis=0)) ** 2
    return np.asarray(irfft(power, size, axis=0)[:lags])


def _room_for(samples: int) -> int:
    """An even number of samples, as many or some more, whose Fourier transform is fast."""
    return 2 * int(next_fast_len((samples + 1) // 2, real=True))


def _quadratic(records: tuple[Linear, ...], autocovariance: Array) -> Array:
    """Sum over records of W^T Gamma W, Gamma of the ``autocovariance`` (longest,) by lag."""
    width = records[0].weights.shape[1]
    total = np.zeros((width, width))
    for record in records:
        size = _room_for(2 * len(record.used))
        spectrum = _spectrum(record.weights, size)
        density = _density(autocovariance[: len(record.used)], size)
        total += (spectrum.conj().T @ (spectrum * density[:, None])).real
    return total


def _spectrum(weights: Array, size: int) -> Complex:
    """Fourier transform (F, p) of ``weights`` (N, p) in ``size`` samples: 2 N or more, so that nothing wraps."""
    return np.asarray(rfft(weights, size, axis=0) / np.sqrt(size))


def _density(autocovariance: Array, size: int) -> Array:
    """Spectral density (F,) of an ``autocovariance`` (N,) at the frequencies of `_spectrum`, both sides together."""
    between = np.zeros(size + 1 - 2 * len(autocovariance))
    density = rfft(np.concatenate((autocovariance, between, autocovariance[:0:-1]))).real
    density[1:-1] *= 2
    return np.asarray(density)


def _white_autocovariance(records: tuple[Linear, ...], model: Autoregression, lags: int) -> tuple[Array, float]:
    """Autocovariance (lags,) of the whitened residuals under Parzen's window, and the samples that it is from.

    Whitened residuals lack what the whitened regressors took, which makes their neighbours look opposed; that part is
    known for white noise and put back.
    """
    order = len(model.reflections)
    masks = [(runs(record.used, order) >= order).astype(float) for record in records]
    columns = [np.column_stack((record.basis, record.residuals)) for record in records]
    filtered = [lfilter(model.filter, [1.0], c, axis=0) * m[:, None] for c, m in zip(columns, masks, strict=True)]
    whole = np.vstack(filtered)
    basis, _ = np.linalg.qr(whole[:, :-1])
    rest = whole[:, -1] - basis @ (basis.T @ whole[:, -1])
    count = float(sum(mask.sum() for mask in masks))
    variance = float(rest @ rest) / max(count - basis.shape[1], 1.0)
    sums, pairs, at = np.zeros(lags), np.zeros(lags), 0
    for mask in masks:
        part = slice(at, at + len(mask))
        at += len(mask)
        there = min(lags, len(mask))
        own = correlate(np.column_stack((rest[part], mask, basis[part])), there)
        sums[:there] += own[:, 0] + variance * own[:, 2:].sum(axis=1)
        pairs[:there] += own[:, 1]
    found = sums / np.maximum(pairs, 1.0)
    found[0] = variance
    return found * parzen(lags), count


def _nowhere_negative(window: Array) -> Array:
    """The autocovariance ``window`` (L,) with its spectral density raised to `LEAST_SHARE`: (FINE L / 2,)."""
    size = _room_for(FINE * len(window))
    density = 2 * rfft(window, size).real - window[0]
    return np.asarray(irfft(np.maximum(density, LEAST_SHARE * window[0]), size)[: size // 2])


def _coloured_again(window: Array, model: Autoregression, count: int) -> Array:
    """Autocovariance (count,) of the noise whose whitened autocovariance is ``window`` (L,)."""
    both_sides = np.concatenate((window[:0:-1], window))
    lags = len(window)
    long = autocovariance(model.reflections, count + lags)
    mirrored = np.concatenate((long[:0:-1], long))
    size = _room_for(len(both_sides) + len(mirrored))
    product = irfft(rfft(both_sides, size) * rfft(mirrored, size), size)
    centre = len(long) - 1 + lags - 1
    return np.asarray(product[centre : centre + count])


def _doubt_of_model(records: tuple[Linear, ...], model: Autoregression) -> Array:
    """Variance (p,) of the logarithm of each parameter's variance, from that of the autoregression."""
    at = np.arctanh(model.reflections)
    if not len(at):
        return np.zeros(records[0].weights.shape[1])
    longest = max(len(record.used) for record in records)
    sizes = [_room_for(2 * len(record.used)) for record in records]
    powers = [np.abs(_spectrum(record.weights, size)) ** 2 for record, size in zip(records, sizes, strict=True)]

    def logarithms(transformed: Array) -> Array:
        noise = autocovariance(np.tanh(transformed), longest) * model.variances(transformed)
        of_records = zip(records, sizes, powers, strict=True)
        parts = [_density(noise[: len(r.used)], size) @ power for r, size, power in of_records]
        return np.asarray(np.log(np.maximum(np.sum(parts, axis=0), 1e-300)))

    steps = np.eye(len(at)) * STEP
    slopes = np.array([(logarithms(at + step) - logarithms(at - step)) / (2 * STEP) for step in steps])
    return np.asarray(np.einsum("ka,kl,la->a", slopes, model.uncertainty, slopes))


def _doubt_of_window(records: tuple[Linear, ...], noise: Noise) -> Array:
    """The same from the scatter of the autocovariances inside the lag window.

    The first have none: the autoregression was chosen so that they vanish (Box & Pierce, JASA 65, 1970).
    """
    order = len(noise.model.reflections)
    own = np.zeros((noise.lags, records[0].weights.shape[1]))
    for record in records:
        back = lfilter([1.0], noise.model.filter, record.weights[::-1], axis=0)[::-1]
        there = min(noise.lags, len(back))
        own[:there] += correlate(back, there)
    shares = 2 * parzen(noise.lags)[:, None] * own / np.maximum(own[0], 1e-300)
    return np.asarray(np.sum(shares[order + 1 :] ** 2, axis=0) / max(noise.pairs, 1.0))

"""Control effectiveness of the elevator from a record in closed loop, by instrumental variables.

In closed loop the elevator depends on the gusts that move the aircraft, which biases regression and output error. A
signal from outside the loop, the excitation or the setpoint, is correlated with the elevator and not with the gusts:
two-stage least squares with it as instrument is consistent (Ljung, System Identification, 1999, ch. 7.6 and 13.4;
Söderström & Stoica, Instrumental Variable Methods for System Identification, 1983). With a weak instrument its
interval is wrong, which the first-stage F shows (Staiger & Stock, Econometrica 65, 1997).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import StateSpace, cont2discrete, lfilter, lsim

from logs.identification.data.experiment import runs
from logs.identification.data.flight import Aircraft, FlightData
from logs.identification.data.resampling import averaging_matrix, behind, wing_period
from logs.identification.findings import Entry, Finding, register
from logs.identification.results import Array, Estimate, EstimationResult
from logs.identification.statistics.covariance import MAX_CONDITION, ParameterUncertainty, colored_covariance
from wingbeat.constants import STANDARD_GRAVITY

METHOD = "instrumental variables"
EFFECTIVENESS = "M_delta"
REGRESSORS = {EFFECTIVENESS: "1/s^2", "M_w": "1/(m s)", "M_q": "1/s"}
EQUATIONS = (
    "dq/dt = M_δ δ + M_w w + M_q q",
    "two-stage least squares; instruments: the excitation or the setpoint behind the tail's lag and low-pass filters;"
    " all signals are averages over a stroke, high-pass filtered",
)
STEP = 0.04
"""s; between stroke averages"""
TAIL_LAG = 0.05
"""s; of a tail whose time constant is not known"""
HIGH_PASS = 1.0
"""rad/s; of all signals, twice: removes trim and drift"""
INSTRUMENTS, MEMORY = 5, 0.15
"""-, s; instruments: outputs of low-pass filters in series, and the time constant of each"""
SETTLED = 2.0
"""s; after which the filters are settled"""
MIN_DURATION = 8.0
"""s; of flapping flight without interruption"""
FEEDBACK = 0.25
"""-; of the elevator's variance in the inputs: above it, what is not excitation is feedback; less than it is the
sampling of a logged excitation"""
MIN_STRENGTH = 10.0
"""-; first-stage F, below which an instrument is weak"""
MIN_AIRSPEED, FLAPPING = 2.0, 0.6
"""m/s, -; airspeed and share of the usual flapping frequency of forward flight"""
AMPLITUDES = (math.radians(3.0), math.radians(5.0), math.radians(8.0), math.radians(12.0))
"""rad; of planned doublets, the first that needs few enough"""
WIDTH, EVERY, MANY = 0.3, 4.0, 40
"""s, s, -; width of a step and distance of planned doublets; the most of them at a smaller amplitude"""
LIFT_SLOPE = 3.0
"""1/rad; of the typical aircraft that planned doublets move"""

register({
    "not_informative": Entry(
        "{instrument} hardly moves the elevator beside the feedback (first-stage F {value:.1f}, needed {limit:g}):"
        " add {count} doublets of {amplitude:.0f} deg and {width:g} s to the elevator",
        "In closed loop only a signal from outside the loop tells the effect of the elevator from its feedback. The"
        " conditional first-stage F (Sanderson & Windmeijer, J. Econometrics 190, 2016) of excitation or setpoint is"
        " too low, so that the sign of the control effectiveness is unknown; it is withheld from every method.",
        "fly the inputs of the text in closed loop, or freeze the pitch loop during the inputs",
    ),
    "closed_loop": Entry(
        "the pitch loop is active in the inputs; {subject} by other methods is biased by gusts",
        "The elevator follows feedback and excitation. Methods that take the elevator as input are biased toward the"
        " negative inverse of the controller where gusts move it; instrumental variables are not.",
        "prefer instrumental variables for the control effectiveness, or freeze the pitch loop during inputs",
    ),
    "closed_loop_bias": Entry(
        "its sign contradicts that by instrumental variables",
        "An estimate of a method that is biased in closed loop has the other sign than the consistent one.",
        "use the estimate by instrumental variables",
    ),
})  # fmt: skip


class Record(NamedTuple):
    """Filtered stroke averages of one stretch of flapping flight, `STEP` apart."""

    response: Array
    """(N,) rad/s^2; pitch acceleration"""
    regressors: Array
    """(N, 3); tail angle, w, q"""
    instruments: Array
    """(N, k)"""


class TwoStage(NamedTuple):
    """Two-stage least squares."""

    values: Array
    """(3,) of `REGRESSORS`"""
    uncertainty: ParameterUncertainty
    strength: float
    """-; conditional first-stage F of the elevator"""


class ClosedLoop(NamedTuple):
    """What a record in closed loop tells about the elevator."""

    result: EstimationResult
    finding: Finding
    """`closed_loop`, or `not_informative`"""

    @property
    def effectiveness(self) -> Estimate | None:
        """M_delta; None if the data are not informative."""
        return self.result.estimate(EFFECTIVENESS)

    def contradiction(self, estimate: Estimate) -> Finding | None:
        """Why a biased method's estimate of M_delta is withheld; None if its sign agrees or it has none.

        Without a sure sign by instrumental variables no other method has one.
        """
        consistent = self.effectiveness
        if consistent is None:
            return self.finding
        if estimate.contains(0.0):
            return None
        agrees = not consistent.contains(0.0) and consistent.value * estimate.value > 0.0
        return None if agrees else Finding("closed_loop_bias", "withheld", EFFECTIVENESS, estimate.value)


def is_closed_loop(data: FlightData) -> bool:
    """Whether the elevator moves by more than the excitation during the inputs, or there is no input."""
    feedback = total = 0.0
    for maneuver in runs(data.active > 0):
        moved = np.flatnonzero(data.excitation[maneuver]) + maneuver.start
        if len(moved) < 2:
            continue
        span = slice(int(moved[0]), int(moved[-1]) + 1)  # the records of other programs begin and end in the loop
        elevator = data.elevator[span] - data.elevator[span].mean()
        rest = data.elevator[span] - data.excitation[span]
        feedback += float(np.sum((rest - rest.mean()) ** 2))
        total += float(np.sum(elevator**2))
    return feedback > FEEDBACK * total or total == 0.0


def control_effectiveness(data: FlightData, aircraft: Aircraft) -> ClosedLoop | None:
    """Estimate M_delta of a flight in closed loop; None in open loop, or without an instrument."""
    if not is_closed_loop(data):
        return None
    excited = bool(np.any(data.excitation))
    instrument = data.excitation if excited else data.pitch_setpoint
    if instrument is None:
        return None
    records = _records(data, aircraft, instrument)
    fit = two_stage(records)
    name = "the excitation" if excited else "the pitch setpoint"
    if fit is None or fit.strength < MIN_STRENGTH:
        amplitude, count = _inputs_needed(data, aircraft, fit.strength if fit else 0.0)
        details = {"instrument": name, "count": count, "amplitude": math.degrees(amplitude), "width": WIDTH}
        strength = fit.strength if fit else 0.0
        weak = Finding("not_informative", "withheld", EFFECTIVENESS, strength, MIN_STRENGTH, details)
        result = EstimationResult(METHOD, "modes", "", EQUATIONS, "not identifiable", findings=(weak,))
        return ClosedLoop(result, weak)
    estimates = fit.uncertainty.estimates(REGRESSORS, fit.values)
    found = Finding("closed_loop", "warning", EFFECTIVENESS, fit.strength)
    result = EstimationResult(
        METHOD, "modes", "", EQUATIONS, "converged", estimates, fit.uncertainty.covariance, fit.uncertainty.degrees,
        samples=sum(len(one.response) for one in records),
    )  # fmt: skip
    return ClosedLoop(result, found)


def two_stage(records: list[Record]) -> TwoStage | None:
    """Two-stage least squares with the covariance of colored residuals; None without enough instruments."""
    if not records:
        return None
    y, x, z = (np.concatenate([getattr(one, name) for one in records]) for name in Record._fields)
    left, size, _ = np.linalg.svd(z / np.maximum(np.std(z, axis=0), 1e-12), full_matrices=False)
    basis = left[:, size > 1e-6 * max(size[0], 1e-6)]
    if basis.shape[1] < x.shape[1]:
        return None
    bounds = np.cumsum([len(one.response) for one in records])[:-1]
    fitted = basis @ (basis.T @ x)
    information = fitted.T @ fitted
    if np.linalg.cond(information / np.sqrt(np.outer(np.diag(information), np.diag(information)))) > MAX_CONDITION:
        return None
    inverse = np.linalg.inv(information)
    values = inverse @ (fitted.T @ y)
    covariance, degrees = _colored(y - x @ values, fitted, inverse, bounds)
    return TwoStage(values, ParameterUncertainty(covariance, degrees), _strength(x, fitted, basis, bounds))


def _strength(x: Array, fitted: Array, basis: Array, bounds: Array) -> float:
    """First-stage F of the first column of ``x`` given the others (Sanderson & Windmeijer, 2016, Eq. 16).

    The covariance is that of colored residuals.
    """
    others = fitted[:, 1:]
    remaining = x[:, 0] - x[:, 1:] @ np.linalg.solve(others.T @ others, others.T @ x[:, 0])
    coefficients = basis.T @ remaining
    covariance, _ = _colored(remaining - basis @ coefficients, basis, np.eye(len(coefficients)), bounds)
    wald = float(coefficients @ np.linalg.solve(covariance, coefficients))
    return wald / float(basis.shape[1] - others.shape[1])


def _colored(residuals: Array, sensitivities: Array, inverse: Array, bounds: Array) -> tuple[Array, float]:
    parts = [np.split(one, bounds) for one in (residuals[:, None], np.ones((len(residuals), 1)))]
    return colored_covariance(
        parts[0], parts[1], np.split(sensitivities[:, None, :], bounds), inverse, sensitivities.shape[1]
    )


def _records(data: FlightData, aircraft: Aircraft, instrument: Array) -> list[Record]:
    step = float(data.time[1] - data.time[0])
    long = [span for span in runs(_flapping(data)) if (span.stop - span.start) * step >= MIN_DURATION]
    return [one for span in long if (one := _record(data, span, aircraft, instrument)) is not None]


def _flapping(data: FlightData) -> NDArray[np.bool_]:
    """Whether each sample is of forward flapping flight, by the stroke rate over a second."""
    window = round(1.0 / float(data.time[1] - data.time[0]))
    if len(data.time) <= window:
        return np.zeros(len(data.time), bool)
    rate = np.zeros(len(data.time))
    rate[window:] = data.strokes[window:] - data.strokes[:-window]
    usual = float(np.median(rate[rate > 1.0])) if np.any(rate > 1.0) else math.inf
    flapping: NDArray[np.bool_] = (rate > FLAPPING * usual) & (data.airspeed > MIN_AIRSPEED)
    return flapping


def _record(data: FlightData, span: slice, aircraft: Aircraft, instrument: Array) -> Record | None:
    time, step = data.time[span], float(data.time[1] - data.time[0])
    lag = TAIL_LAG if aircraft.tail_time_constant is None else aircraft.tail_time_constant
    tail, outside = (
        behind(one[span] - one[span.start], step, aircraft.tail_delay, lag, zoh=True)
        for one in (data.elevator, instrument)
    )
    q = data.pitch_rate[span]
    q_dot = np.gradient(q, step)
    force = data.accel_z[span] + aircraft.imu_x * q_dot
    w_dot = force + data.airspeed[span] * q + STANDARD_GRAVITY * np.cos(data.pitch[span])
    at = np.arange(time[0], time[-1], STEP)
    period = wing_period(time, data.strokes[span], at)
    inside = np.isfinite(period)
    inside[inside] = (at - period / 2 > time[0] + 2 * step)[inside] & (at + period / 2 < time[-1] - 2 * step)[inside]
    if inside.sum() * STEP < MIN_DURATION:
        return None
    # Averages of a steady stretch: a longest run without a gap, since the filters count samples.
    rows = max(runs(inside), key=lambda one: one.stop - one.start)
    averages = averaging_matrix(time, period[rows], at[rows]) @ np.column_stack((q_dot, tail, w_dot, q, outside))
    return record_of(*averages.T)


def record_of(q_dot: Array, tail: Array, w_dot: Array, q: Array, outside: Array) -> Record:
    """Filter stroke averages; w is the integral of its rate, high-pass filtered."""
    numerator, denominator = (1.0, 0.0), (1.0, HIGH_PASS)
    x, y, z = ([_filtered(numerator, denominator, one) for one in (tail, q)], q_dot, outside)
    w = _filtered((1.0,), denominator, w_dot)
    columns = [_filtered(numerator, denominator, one) for one in (x[0], w, x[1])]
    response, first = (_filtered(numerator, denominator, _filtered(numerator, denominator, one)) for one in (y, z))
    instruments = [first]
    for _ in range(INSTRUMENTS - 1):
        instruments.append(_filtered((1.0,), (MEMORY, 1.0), instruments[-1]))
    settled = int(SETTLED / STEP)
    parts = response, np.column_stack(columns), np.column_stack(instruments)
    return Record(*(one[settled:] - one[settled:].mean(axis=0) for one in parts))


def _filtered(numerator: tuple[float, ...], denominator: tuple[float, ...], values: Array) -> Array:
    """``values`` (N,), less the first, through a filter in s, by the bilinear transformation."""
    (b,), a, _ = cont2discrete((numerator, denominator), STEP, "bilinear")
    return np.asarray(lfilter(b, a, values - values[0]), np.float64)


def _inputs_needed(data: FlightData, aircraft: Aircraft, strength: float) -> tuple[float, int]:
    """Amplitude (rad) and number of doublets in closed loop that would make the instrument strong.

    The response of a typical aircraft to them is added to the record; the noncentrality of F is proportional to
    their number.
    """
    amplitude, count = AMPLITUDES[-1], MANY
    for amplitude in AMPLITUDES:
        records = _planned(data, aircraft, amplitude)
        fit = two_stage(records)
        inputs = sum(len(one.response) for one in records) * STEP / EVERY
        count = math.ceil(inputs * MIN_STRENGTH / max(fit.strength, 0.1)) if fit else MANY + 1
        if count <= MANY:
            break
    return amplitude, count


def _planned(data: FlightData, aircraft: Aircraft, amplitude: float) -> list[Record]:
    """Records with doublets and the response of a typical aircraft added to what was measured."""
    time = data.time - data.time[0]
    since = time % EVERY
    doublets = amplitude * (
        np.where(since < WIDTH, 1.0, 0.0) - np.where((since >= WIDTH) & (since < 2 * WIDTH), 1, 0)
    )
    flying = data.airspeed > MIN_AIRSPEED
    airspeed = float(np.mean(data.airspeed[flying])) if flying.any() else MIN_AIRSPEED
    damping = STANDARD_GRAVITY / airspeed * LIFT_SLOPE
    rates = np.array([[-damping, airspeed], [-(damping**2) / airspeed, -damping]])
    system = StateSpace(rates, np.array([[0.0], [damping**2]]), np.eye(2), np.zeros((2, 1)))
    _, states, _ = lsim(system, doublets, time, interp=False)
    w_dot = states @ rates[0]
    moved = data._replace(
        elevator=data.elevator + doublets,
        pitch_rate=data.pitch_rate + states[:, 1],
        accel_z=data.accel_z + w_dot - airspeed * states[:, 1],
    )
    return _records(moved, aircraft, doublets)

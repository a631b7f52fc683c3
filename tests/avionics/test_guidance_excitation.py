"""Sweeps and orthogonal multisines: their spectra as computed and as flown, the loops meanwhile, the envelope."""

import json
import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from surrogate_gains import VEHICLE as RAVEN
from test_autopilot_flights import Flight

from avionics import snapshot, topics
from avionics.guidance import altitude, excitation, multisine
from avionics.guidance.mission import Channel, Excitation, ItemKind, MissionItem, Shape
from avionics.messages import Mode, Stage
from avionics.state import AutopilotState, initial_state
from avionics.tasks import guide
from wingbeat.topic import Topic

GAINS = excitation.Gains(
    recovery=0.5,
    spread=0.0,
    fade=1.0,
    pitch_max=0.4,
    roll_max=0.8,
    airspeed_min=4.0,
    airspeed_max=12.0,
    altitude_max=8.0,
    altitude_floor=10.0,
)
FLOWN = excitation.EnvelopeState(0.3, 0.0, 7.5, 40.0)
DT = 0.01
SWEEP = Excitation(Channel.ELEVATOR, Shape.LINEAR_SWEEP, 0.1, 10.0, 0.5, 1, 0.5, 3.0)
THREE = Excitation(
    Channel.ELEVATOR, Shape.MULTISINE, 0.06, 10.0, 1.0, 1, 0.3, 2.6, other_amplitudes=(0.0, 0.08, 0.1), loops=1
)
"""24 harmonics of 10 s, eight on each channel"""


def simulate(requests: Excitation, seconds: float = 30.0) -> tuple[excitation.State, np.ndarray]:
    """The state at the end, and time since the input began, elevator, throttle, rudder while it lasted (N, 4)."""
    state, rows = excitation.start(excitation.State(), requests), []
    for i in range(round(seconds / DT)):
        state, status = excitation.step(GAINS, state, round(i * DT * 1e6), DT, True, FLOWN)
        if state.phase == excitation.Phase.INPUT:
            rows.append((state.elapsed, status.elevator, status.throttle, status.rudder))
    return state, np.array(rows)


# --- sweeps ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [Shape.LINEAR_SWEEP, Shape.LOGARITHMIC_SWEEP])
@pytest.mark.parametrize("band", [(0.5, 3.0), (3.0, 0.5)])
def test_the_frequency_of_a_sweep_runs_from_its_start_to_its_end(shape: Shape, band: tuple[float, float]) -> None:
    requests = SWEEP._replace(shape=shape, low=band[0], high=band[1], width=20.0)
    time = np.linspace(0.0, 20.0, 200_001)
    signal = np.array([excitation.sweep(requests, 0.0, t) for t in time])
    crossings = time[:-1][np.diff(np.signbit(signal).astype(int)) != 0]
    middle, frequency = 0.5 * (crossings[1:] + crossings[:-1]), 0.5 / np.diff(crossings)
    share = middle / 20.0
    low, high = band
    linear = low + (high - low) * share
    expected = linear if shape == Shape.LINEAR_SWEEP else low * (high / low) ** share
    assert frequency[1:-1] == pytest.approx(expected[1:-1], rel=0.01)
    assert len(crossings) > 30


def test_a_sweep_fades_in_and_out_and_stays_within_its_amplitude() -> None:
    _, rows = simulate(SWEEP)
    time, elevator = rows[:, 0], rows[:, 1]
    assert len(rows) == 1000
    assert abs(elevator[0]) == 0.0
    assert np.max(np.abs(elevator)) == pytest.approx(0.1, rel=2e-3)
    for share in (0.25, 0.5, 0.75):
        envelope = 0.1 * (0.5 - 0.5 * math.cos(math.pi * share))
        assert np.max(np.abs(elevator[time <= share])) <= envelope
        assert np.max(np.abs(elevator[time >= 10.0 - share])) <= envelope
    assert np.max(np.abs(np.diff(elevator))) < 0.1 * 2 * math.pi * 3.0 * DT * 1.1


def test_a_sweep_that_stays_at_one_frequency_is_a_sine() -> None:
    requests = SWEEP._replace(shape=Shape.LOGARITHMIC_SWEEP, low=2.0, high=2.0)
    for t in (0.1, 3.33, 9.0):
        assert excitation.sweep(requests, 0.0, t) == pytest.approx(math.sin(4.0 * math.pi * t))


# --- multisines -----------------------------------------------------------------------------------------


@settings(max_examples=20, deadline=None)
@given(first=st.integers(1, 12), count=st.integers(8, 16), channels=st.integers(1, 3))
def test_the_relative_peak_factor_is_below_1_25(first: int, count: int, channels: int) -> None:
    time = np.arange(0.0, 10.0, 0.004)
    for harmonics in multisine.channel_harmonics(first, first + channels * count - 1, channels):
        assert len(harmonics) == count
        lines = multisine.design(harmonics, 10.0, 0.1)
        signal = sum(a * np.sin(w * time + p) for w, p, a in lines)
        assert multisine.relative_peak_factor(signal) < 1.25
        assert np.max(np.abs(signal)) == pytest.approx(0.1, rel=5e-3)
        assert multisine.value(lines, 0.0) == pytest.approx(0.0, abs=1e-6)


def test_the_peak_factor_of_a_sine_is_1_and_schroeders_is_improved() -> None:
    time = np.arange(0.0, 1.0, 1e-4)
    assert multisine.relative_peak_factor(np.sin(2 * np.pi * time)) == pytest.approx(1.0, abs=1e-4)
    harmonics = (4, 7, 10, 13, 16, 19, 22, 25)
    order = np.arange(1, 9)
    schroeder = -np.pi * order * (order - 1) / 8
    phases = [p for _, p, _ in multisine.design(harmonics, 1.0, 1.0)]
    before, after = (
        multisine.relative_peak_factor(np.cos(2 * np.pi * np.outer(time, harmonics) + p + shift).sum(axis=1))
        for p, shift in ((schroeder, 0.0), (np.array(phases), -np.pi / 2))
    )
    assert after < before - 0.1


def spectrum(signal: np.ndarray) -> np.ndarray:
    """Amplitude of each harmonic of the record's length."""
    return np.abs(np.fft.rfft(signal)) * 2.0 / len(signal)


def check_orthogonal(rows: np.ndarray) -> None:
    """Power at each channel's own harmonics only, and no product of two channels over the period."""
    dealt = multisine.channel_harmonics(3, 26, 3)
    for signal, own in zip(rows.T, dealt, strict=True):
        lines = spectrum(signal)
        size = np.max(lines)
        assert lines[list(own)] == pytest.approx(np.full(8, size), rel=1e-6)
        others = np.delete(lines, own)
        assert np.max(others) < 1e-6 * size
    correlation = np.corrcoef(rows.T) - np.eye(3)
    assert np.max(np.abs(correlation)) < 1e-6


def test_three_channels_are_orthogonal_over_a_period() -> None:
    state, rows = simulate(THREE)
    assert state.finished == 1
    assert len(rows) == 1000
    check_orthogonal(rows[:, 1:])
    assert np.max(np.abs(rows[:, 1:]), axis=0) == pytest.approx([0.06, 0.08, 0.1], rel=0.02)


def test_a_multisine_is_continued_from_a_snapshot_bit_for_bit() -> None:
    state = excitation.start(excitation.State(), THREE)
    for _ in range(300):
        state, _ = excitation.step(GAINS, state, 0, DT, True, FLOWN)
    again = snapshot.builder(excitation.State)(_through_json(state))
    assert again == state
    for _ in range(200):
        state, status = excitation.step(GAINS, state, 0, DT, True, FLOWN)
        again, repeated = excitation.step(GAINS, again, 0, DT, True, FLOWN)
        assert repeated == status


def _through_json(value: object) -> object:
    return json.loads(json.dumps(value))


# --- loops and envelope ---------------------------------------------------------------------------------


def running(requests: Excitation) -> excitation.State:
    state = excitation.start(excitation.State(), requests)
    for _ in range(120):
        state, _ = excitation.step(GAINS, state, 0, DT, True, FLOWN)
    assert excitation.running(state)
    return state


@pytest.mark.parametrize(
    ("requests", "frozen", "roll_frozen"),
    [
        (SWEEP, 1, 0),
        (SWEEP._replace(loops=1), 0, 0),
        (SWEEP._replace(channel=Channel.RUDDER), 1, 1),
        (THREE, 0, 0),
        (THREE._replace(loops=0), 1, 1),
        (SWEEP._replace(channel=Channel.THROTTLE), 1, 0),
    ],
)
def test_the_loops_are_frozen_or_fly_on_as_asked(requests: Excitation, frozen: int, roll_frozen: int) -> None:
    state = running(requests)
    assert (excitation.frozen(state), excitation.roll_frozen(state)) == (frozen, roll_frozen)
    done = excitation.stop(state)
    assert (excitation.frozen(done), excitation.roll_frozen(done), done.lines) == (0, 0, ())


@pytest.mark.parametrize(("loops", "calm"), [(0, True), (1, False)])
def test_a_trim_is_sought_before_each_frozen_input_and_never_otherwise(loops: int, calm: bool) -> None:
    requests = Excitation(Channel.ELEVATOR, Shape.DOUBLET, 0.1, 0.2, 0.5, repeats=2, loops=loops)
    state, sought = excitation.start(excitation.State(), requests), []
    assert not excitation.recovering(excitation.State())
    for _ in range(round(2 * (GAINS.recovery + 0.5 + 0.4 + 0.5) / DT)):
        sought.append((excitation.recovering(state), state.manoeuvre, state.phase))
        assert not (excitation.recovering(state) and excitation.frozen(state))
        state, _ = excitation.step(GAINS, state, 0, DT, True, FLOWN)
    recover = [(number, phase) for yes, number, phase in sought if yes]
    assert {phase for _, phase in recover} <= {excitation.Phase.RECOVER}
    times = [sum(number == each for number, _ in recover) * DT for each in (0, 1)]
    assert times == pytest.approx([GAINS.recovery * calm] * 2, abs=2 * DT)
    assert not excitation.recovering(excitation.stop(state))


def vertical(requests: Excitation) -> tuple[AutopilotState, altitude.State]:
    """The memory after a step of the climb loop, too low and sinking while ``requests`` begins; its state before."""
    s = initial_state(RAVEN.gains, ())
    s.modes = s.modes._replace(armed=1, mode=int(Mode.AUTO), stage=int(Stage.EN_ROUTE))
    s.altitude_loop = before = altitude.initial(RAVEN.gains.altitude, RAVEN.gains.altitude.throttle_trim)
    s.excitation = excitation.start(s.excitation, requests)
    s.clock = s.clock._replace(dt_50=0.02)
    s.target = s.target._replace(altitude=2.0)
    guide.vertical(s, lambda topic, message: None)
    return s, before


def test_the_climb_loop_is_calm_while_a_trim_is_sought() -> None:
    gains, measured = RAVEN.gains.altitude, altitude.Measured(0.0, 0.0, 0.0)
    for requests, flown_by in ((SWEEP, altitude.calm(gains)), (SWEEP._replace(loops=1), gains)):
        s, before = vertical(requests)
        assert s.altitude_loop == altitude.step(flown_by, before, 0, 0.02, 2.0, measured)[0]
    assert altitude.step(gains, before, 0, 0.02, 2.0, measured) != altitude.step(
        altitude.calm(gains), before, 0, 0.02, 2.0, measured
    )


@pytest.mark.parametrize("requested", [SWEEP, SWEEP._replace(loops=1), THREE])
@pytest.mark.parametrize(
    "outside",
    [
        FLOWN._replace(pitch=0.75),
        FLOWN._replace(roll=-0.9),
        FLOWN._replace(airspeed=3.0),
        FLOWN._replace(altitude=49.0),
        FLOWN._replace(airspeed=math.nan),
    ],
)
def test_leaving_the_envelope_aborts_every_shape(requested: Excitation, outside: excitation.EnvelopeState) -> None:
    state, status = excitation.step(GAINS, running(requested), 0, DT, True, outside)
    assert (status.aborted, status.active, state.finished) == (1, 0, 1)
    assert status[3:6] == (0.0, 0.0, 0.0)


# --- flown by the surrogate -----------------------------------------------------------------------------

MISSION = (
    MissionItem(ItemKind.TAKEOFF, altitude=22.0),
    MissionItem(ItemKind.HOLD, altitude=22.0, heading=1.5, duration=3.0),
    MissionItem(ItemKind.EXCITE, excitation=THREE),
    MissionItem(
        ItemKind.EXCITE,
        excitation=Excitation(Channel.RUDDER, Shape.DOUBLET, 0.1, 0.3, 0.4, 1),
    ),
    MissionItem(ItemKind.EXCITE, excitation=SWEEP._replace(amplitude=0.05, loops=1)),
    MissionItem(ItemKind.HOLD, altitude=22.0, heading=1.5, duration=2.0),
)


@cache
def flight() -> Flight:
    return Flight(MISSION).launch().fly(75.0, until=Stage.LANDED)


@cache
def column(topic: Topic, name: str) -> np.ndarray:
    return np.array([getattr(message, name) for message in flight().of(topic)])


def during(number: int) -> tuple[int, int]:
    """First and last time (us) of a manoeuvre."""
    active = (column(topics.EXCITATION, "active") == 1) & (column(topics.EXCITATION, "manoeuvre") == number)
    times = column(topics.EXCITATION, "time_us")[active]
    return int(times[0]), int(times[-1])


@pytest.mark.validate
def test_a_flown_multisine_has_power_at_its_harmonics_only_and_its_channels_are_orthogonal() -> None:
    begin, end = during(1)
    logged = [m for m in flight().of(topics.EXCITATION) if begin <= m.time_us <= end]
    first = next(i for i, m in enumerate(logged) if abs(m.elevator) > 1e-12)
    rows = np.array([m[3:6] for m in logged[first : first + 1000]])
    check_orthogonal(rows)
    assert not any(m.aborted for m in logged)


def test_loops_fly_on_during_the_multisine_and_hold_still_during_the_frozen_doublet() -> None:
    for topic, name in ((topics.PITCH_LOOP, "elevator"), (topics.ROLL_LOOP, "roll_command")):
        times = column(topic, "time_us")
        (begin, end), (begin_frozen, end_frozen) = during(1), during(2)
        values = column(topic, name)
        assert len(set(values[(times > begin) & (times < end)])) > 500
        assert len(set(values[(times > begin_frozen) & (times < end_frozen)])) == 1


def test_the_loops_take_over_again_without_a_jump() -> None:
    _, end = during(2)
    for topic, name, jump in ((topics.PITCH_LOOP, "elevator", 0.02), (topics.ROLL_LOOP, "roll_command", 0.05)):
        times, values = column(topic, "time_us"), column(topic, name)
        after = int(np.searchsorted(times, end, side="right"))
        assert np.max(np.abs(np.diff(values[after - 1 : after + 20]))) < jump


def test_every_input_of_the_mission_was_flown_to_its_end() -> None:
    reports = flight().events()
    for item in range(2, 5):
        assert any(text.startswith(f"waypoint {item} ") for text in reports)
    assert not any("aborted" in text for text in reports)


@given(
    frequency=st.floats(2.0, 12.0),
    turns=st.integers(8, 60),
    miss=st.floats(-0.15, 0.15),
)
def test_a_period_that_folds_is_told_with_one_that_does_not(frequency: float, turns: int, miss: float) -> None:
    """GIVEN lines from 0.1 to 0.9 of the flapping frequency THEN images meet lines, half a period later not."""
    requests = Excitation(
        Channel.ELEVATOR, Shape.MULTISINE, 0.05, (turns + miss) / frequency, 0.5, 1, 0.1 * frequency, 0.9 * frequency
    )
    better = excitation.unfolding_period(requests, frequency)
    assert better * frequency == pytest.approx(turns + 0.5)
    assert excitation.unfolding_period(requests._replace(width=better), frequency) == 0.0
    below_half = requests._replace(high=0.45 * frequency)
    assert excitation.unfolding_period(below_half, frequency) == 0.0
    assert excitation.unfolding_period(requests._replace(shape=Shape.LINEAR_SWEEP), frequency) == 0.0
    assert excitation.unfolding_period(requests, 0.0) == 0.0

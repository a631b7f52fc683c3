"""Wings on stroke, deviation and feathering joints: their loads, hover, its modes, and hover held."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from plant_bench import VACUUM, equations

from groundstation.command.fly import build_parser, check
from sim_bridge import plant_kernel as k
from sim_bridge.flight_mechanics.hover import (
    BODY,
    CRANK,
    ELEVATOR,
    PITCH,
    STRIDE,
    THROTTLE,
    HoverMap,
    HoverModel,
    HoverOrbit,
    Q,
    U,
    W,
    X,
    Z,
    fly,
    growth,
    hover,
    linearize,
    position_gain,
    state_space,
)
from sim_bridge.flight_mechanics.orbit import trim
from sim_bridge.flight_mechanics.prescribed import (
    Harmonics,
    PrescribedStroke,
    kinematics,
)
from sim_bridge.flight_mechanics.stroke_loads import StrokeLoads, stroke_loads
from sim_bridge.mechanism import total_mass
from sim_bridge.plant import Plant
from sim_bridge.plant_kernel import STEP
from sim_bridge.validation.insects import AUTHORITY, TOLERANCES, hover_excursion, pushed
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import load_vehicle, with_model
from wingbeat.errors import InputError

NAMES = ("hawkmoth", "entomopter")
FREQUENCY, DENSITY = 25.0, 1.2
PHASES = 40
MOVING = np.array([1.3, 0.3, 0.4, 0.5, 0.7, -0.6])
"""m/s, rad/s; of a body that is carried through the air while it turns"""


@cache
def orbit_of(name: str) -> HoverOrbit:
    return hover(load_vehicle(name))


@cache
def model_of(name: str) -> HoverModel:
    return linearize(load_vehicle(name), orbit_of(name))


def confined_air(density: float = DENSITY) -> k.Surroundings:
    return k.Surroundings(0.0, 0.0, 0.0, density, k.HELD, 0.0, 0.0, 0.0)


def controls(duration: float, elevator: float = 0.0, rudder: float = 0.0) -> k.Controls:
    """The crank driven at `FREQUENCY`."""
    return k.Controls(0.0, 0.0, 0.0, 0.0, 0.5, elevator, rudder, duration, 1.0)


# --- the same wings without a plant ---------------------------------------------------------------------------


def harmonics(motion: tuple[float, ...]) -> Harmonics:
    return Harmonics(motion[0], motion[1::2], motion[2::2])


def runners_loads(plant: Plant, body: Floats, phases: int = PHASES) -> StrokeLoads:
    """Loads of the vehicle's strips by the runner of prescribed strokes, which knows no joints."""
    parts, strips = plant.vehicle.bodies, plant.mechanism.wings.strips
    root = parts["right_stroke"]
    # The leading edge is straight, ahead of the axis by so many chords of each strip.
    axis = parts["right_wing"].place[0] / strips.chord[: plant.vehicle.wing.strips]
    stroke = PrescribedStroke(
        FREQUENCY,
        math.pi / 2 - root.rotation[1],
        harmonics(root.motion),
        harmonics(parts["right_deviation"].motion),
        harmonics(parts["right_feathering"].motion),
        axis=axis,
        hinge=root.place,
    )
    moving = kinematics(stroke, strips, body, phases)
    return stroke_loads(plant.mechanism.model, plant.mechanism.aerodynamics, strips, moving, DENSITY)


def at_phase(plant: Plant, share: float, body: Floats) -> Floats:
    """The state in which crank and joints are at ``share`` of a stroke, the body moving with ``body`` (6,)."""
    y, layout, motion = np.zeros_like(plant.y), plant.layout, np.zeros(3)
    y[2], y[3], y[7:13] = -1000.0, 1.0, body
    y[layout.crank_phase], y[layout.crank_speed] = 2.0 * math.pi * share, FREQUENCY
    for i in range(len(layout.coordinates)):
        k.prescribed_motion(plant.parameters.joints.motion[i], 2.0 * math.pi * share, motion)
        y[k.COORDINATES + i] = motion[0]
        y[layout.rate(k.COORDINATES + i)] = motion[1] * 2.0 * math.pi * FREQUENCY
    return y


@pytest.mark.parametrize("name", NAMES)
def test_a_held_insect_bears_the_loads_of_a_prescribed_stroke(name: str) -> None:
    """Force and moment of the parts of the model at every phase, to rounding."""
    plant = Plant(load_vehicle(name))
    runner, own = runners_loads(plant, MOVING), len(plant.mechanism.model.parts)
    for i in range(PHASES):
        plant.y[:] = at_phase(plant, i / PHASES, MOVING)
        plant.evaluate(controls(STEP), confined_air())
        computed = plant.wing_loads().sum(axis=0)
        reference = np.concatenate((runner.force[i, :own].sum(axis=0), runner.moment[i, :own].sum(axis=0)))
        assert computed == pytest.approx(reference, rel=1e-9, abs=1e-14)


@pytest.mark.parametrize("name", NAMES)
def test_what_holds_it_feels_the_apparent_mass_too(name: str) -> None:
    """What it takes to hold the body, in air less in a vacuum, is what the air does to the wings, all parts."""
    plant = Plant(load_vehicle(name))
    runner = runners_loads(plant, MOVING)
    for i in range(0, PHASES, 3):
        y = at_phase(plant, i / PHASES, MOVING)
        plant.y[:] = y
        plant.evaluate(controls(STEP), confined_air())
        rates, others = plant.scratch.accelerations.copy(), plant.scratch.body_load + plant.scratch.plate_load
        takes = []
        for density in (DENSITY, VACUUM):
            mass, load = equations(plant, y, confined_air(density))
            takes.append((mass @ rates - load)[:6])
        reference = np.concatenate((runner.force[i].sum(axis=0), runner.moment[i].sum(axis=0)))
        scale = float(np.max(np.abs(reference)))
        assert takes[1] - takes[0] - others == pytest.approx(reference, rel=1e-6, abs=1e-7 * scale)


@pytest.mark.parametrize("name", NAMES)
def test_joints_and_mean_loads_keep_to_the_stroke_when_integrated(name: str) -> None:
    plant, still = Plant(load_vehicle(name)), np.zeros(6)
    runner, own = runners_loads(plant, still), len(plant.mechanism.model.parts)
    plant.y[:] = at_phase(plant, 0.0, still)
    interval, total = controls(1.0 / (FREQUENCY * PHASES)), np.zeros(6)
    for i in range(2 * PHASES):
        wanted = at_phase(plant, i / PHASES, still)
        first = plant.layout.rate(k.COORDINATES)
        assert plant.y[k.COORDINATES : first] == pytest.approx(wanted[k.COORDINATES : first], abs=3e-4)
        plant.evaluate(interval, confined_air())
        total += plant.wing_loads().sum(axis=0) / (2 * PHASES)
        plant.advance(interval, confined_air())
    reference = (
        np.concatenate((runner.force[:, :own].sum(axis=(0, 1)), runner.moment[:, :own].sum(axis=(0, 1)))) / PHASES
    )
    assert total[:3] == pytest.approx(reference[:3], abs=1e-3 * float(np.linalg.norm(reference[:3])))
    assert total[3:] == pytest.approx(reference[3:], abs=1e-3 * 0.01 * float(np.linalg.norm(reference[:3])))


@pytest.mark.parametrize("name", NAMES)
def test_elevator_pitches_the_nose_up_and_rudder_yaws_it_right(name: str) -> None:
    plant = Plant(load_vehicle(name))

    def mean_moment(elevator: float, rudder: float) -> Floats:
        plant.y[:] = at_phase(plant, 0.0, np.zeros(6))
        interval, total = controls(1.0 / (FREQUENCY * PHASES), elevator, rudder), np.zeros(3)
        for i in range(3 * PHASES):
            plant.advance(interval, confined_air())
            plant.evaluate(interval, confined_air())
            total += plant.wing_loads().sum(axis=0)[3:] / PHASES if i >= PHASES else 0.0
        return total

    weight = plant.parameters.weight
    up = mean_moment(0.1, 0.0) - mean_moment(-0.1, 0.0)
    right = mean_moment(0.0, 0.1) - mean_moment(0.0, -0.1)
    assert up[1] > 0.1 * 0.5 * 0.045 * weight
    assert abs(up[0]) + abs(up[2]) < 1e-9 * up[1]
    assert right[2] > 0.0
    assert abs(right[1]) < 1e-9 * right[2]


def test_the_moth_weighs_what_the_paper_says() -> None:
    assert 1e3 * total_mass(load_vehicle("hawkmoth")) == pytest.approx(1.995, rel=1e-9)


# --- hover ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_hover_repeats_itself_in_its_place(name: str) -> None:
    orbit, vehicle = orbit_of(name), load_vehicle(name)
    end = HoverMap(vehicle)(orbit.state, orbit.inputs)
    assert end[: len(BODY)] == pytest.approx(orbit.state[: len(BODY)], abs=1e-8)
    # The joints come again but for the error of the integrator, which the prescription makes good.
    assert end[len(BODY) :] == pytest.approx(orbit.state[len(BODY) :], abs=0.02)
    assert 0.0 < orbit.inputs[THROTTLE] < 1.0
    assert abs(orbit.inputs[ELEVATOR]) < vehicle.tail_servo.travel


@pytest.mark.parametrize("name", NAMES)
def test_frequency_and_attitude_of_hover_are_those_of_the_held_insects_force(name: str) -> None:
    """Force goes by the square of the frequency, to within what the body's own swinging changes."""
    plant, orbit = Plant(load_vehicle(name)), orbit_of(name)
    force = runners_loads(plant, np.zeros(6)).force.sum(axis=1).mean(axis=0) * 1.225 / DENSITY
    frequency = FREQUENCY * math.sqrt(plant.parameters.weight / float(np.linalg.norm(force)))
    assert 1.0 / orbit.period == pytest.approx(frequency, rel=0.05)
    course = HoverMap(plant.vehicle).course(orbit.state, orbit.inputs)
    assert np.mean(course[:-1, PITCH]) == pytest.approx(math.atan2(force[0], -force[2]), abs=0.08)


@pytest.mark.parametrize("name", NAMES)
def test_flight_goes_on_from_hover_to_the_speed_asked_for(name: str) -> None:
    vehicle = load_vehicle(name)
    orbit = hover(vehicle, 1.5 * STRIDE, 0.2)
    end = HoverMap(vehicle)(orbit.state, orbit.inputs)
    assert end[X] == pytest.approx(1.5 * STRIDE * orbit.period, rel=1e-6)
    assert end[Z] == pytest.approx(-0.2 * orbit.period, rel=1e-6)
    assert end[: PITCH + 1] == pytest.approx(orbit.state[: PITCH + 1], abs=1e-7)


@pytest.mark.parametrize("name", NAMES)
def test_a_millisecond_resolves_the_stroke_and_the_error_falls_as_that_of_runge_and_kutta(name: str) -> None:
    """Fourth order of the smooth joints; of the body not quite, for air loads have kinks where the flow reverses."""
    stroke, orbit = HoverMap(load_vehicle(name)), orbit_of(name)
    ends = []
    for pieces in (math.ceil(orbit.period / STEP), 50, 100, 200, 400, 3200):
        stroke.pieces = pieces
        ends.append(stroke(orbit.state, orbit.inputs))
    usual, coarse, middle, fine, finest = (np.abs(end - ends[-1]) for end in ends[:-1])
    assert np.max(usual[[U, W, PITCH]]) < 1e-4 and usual[Q] < 0.01
    assert np.max(usual[[X, Z]]) < 1e-6
    moving = fine > 1e-9
    moving[: len(BODY)] = False
    assert np.log2(middle[moving] / fine[moving]) == pytest.approx(4.0, abs=0.25)
    body = [U, W, PITCH]
    assert np.linalg.norm(coarse[body]) > 8**3 * np.linalg.norm(finest[body])


@pytest.mark.parametrize("name", NAMES)
def test_slow_flight_is_that_of_the_trim_at_an_airspeed(name: str) -> None:
    """`trim` knows neither the place nor the crank's lag, and makes steps of its own."""
    vehicle = load_vehicle(name)
    computed, reference = hover(vehicle, 2.0), trim(vehicle, 2.0, 0.0)
    assert 1.0 / computed.period == pytest.approx(reference.inputs.frequency, rel=1e-3)
    assert computed.inputs[ELEVATOR] == pytest.approx(reference.inputs.elevator, abs=1e-3)
    assert computed.state[PITCH] == pytest.approx(reference.state[3], abs=2e-3)


def test_what_is_no_insect_is_told_so() -> None:
    with pytest.raises(
        InputError, match=r"^robo_raven_ii_d: hover needs a crank drive and joints that are all moved"
    ):
        hover(load_vehicle("robo_raven_ii_d"))
    moth = load_vehicle("hawkmoth")
    with pytest.raises(
        InputError, match=r"^hawkmoth: hover needs a crank that never stops: drive\.frequencies above 0"
    ):
        hover(moth._replace(drive=moth.drive._replace(frequencies=(0.0, 35.0))))
    lagging = moth.sections | {"strip_theory": load_vehicle("robo_raven_ii_d").sections["strip_theory"]}
    lagging["strip_theory"] = lagging["strip_theory"]._replace(wake_lag=1.0)
    with pytest.raises(InputError, match=r"^hawkmoth: hover needs air loads without memory, not strip_theory"):
        hover(with_model(moth._replace(sections=lagging), "strip_theory"))


def test_a_speed_beyond_the_moth_names_what_it_would_take() -> None:
    wanted = r"^hawkmoth: no flight at 0 m/s climbing 6 m/s with throttle 0 to 1 and elevator within 0\.4 rad: beyond"
    with pytest.raises(InputError, match=wanted) as refused:
        hover(load_vehicle("hawkmoth"), 0.0, 6.0)
    assert "\n" not in str(refused.value)


# --- linear ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_hover_left_to_itself_swings_up_beside_two_modes_that_die_away(name: str) -> None:
    """The longitudinal modes known of hovering insects: an oscillation that grows, a fast and a slow subsidence."""
    model = model_of(name)
    exponents = np.log(np.linalg.eigvals(model.a[:X, :X]).astype(complex)) / model.period
    swinging = exponents[np.abs(exponents.imag) > 1.0]
    assert len(swinging) == 2 and np.all(swinging.real > 0.0)
    slow, fast = sorted(-exponents[np.abs(exponents.imag) <= 1.0].real)
    assert 0.0 < slow < 5.0 < fast
    assert growth(model).real == pytest.approx(float(swinging[0].real))
    assert abs(growth(model).imag) * model.period < math.pi / 4, "the stroke map does not alias it"


@pytest.mark.parametrize("name", NAMES)
def test_place_and_crank_enter_as_physics_has_it(name: str) -> None:
    model, vehicle = model_of(name), load_vehicle(name)
    assert model.a[:, [X, Z]] == pytest.approx(np.eye(len(model.a))[:, [X, Z]], abs=1e-6)
    # The crank goes by a lag over a stroke which is itself shorter when the crank is fast.
    lag = math.exp(-model.period / vehicle.drive.spin_time_constant)
    assert model.a[CRANK, CRANK] == pytest.approx(lag, rel=0.05)
    span = vehicle.drive.frequencies[-1] - vehicle.drive.frequencies[0]
    assert model.b[CRANK, THROTTLE] == pytest.approx(span * (1.0 - lag), rel=0.05)
    assert state_space(model).dt == model.period


@pytest.mark.parametrize("name", NAMES)
def test_small_steps_of_state_and_inputs_are_what_the_linear_model_foretells(name: str) -> None:
    model, orbit, stroke = model_of(name), orbit_of(name), HoverMap(load_vehicle(name))
    apart = np.zeros(len(orbit.state))
    apart[:X] = (0.002, -0.001, 0.02, 0.001)
    change = np.array((0.001, 0.0005))
    flown, calm = orbit.state + apart, orbit.state
    for _ in range(5):
        flown, calm = stroke(flown, orbit.inputs + change), stroke(calm, orbit.inputs)
        apart = model.a @ apart + model.b @ change
    scale = np.array((0.01, 0.01, 0.1, 0.01, 0.001, 0.001, 0.1))
    assert (flown - calm)[: len(BODY)] / scale == pytest.approx(apart[: len(BODY)] / scale, abs=0.03)


# --- held -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_hover_is_held_from_a_push_for_a_hundred_strokes(name: str) -> None:
    vehicle, orbit, model = load_vehicle(name), orbit_of(name), model_of(name)
    gain = position_gain(model, TOLERANCES, AUTHORITY)
    assert np.max(np.abs(np.linalg.eigvals(model.a - model.b @ gain))) < 1.0
    course = fly(vehicle, orbit, pushed(orbit.state), gain, 100) - orbit.state
    assert np.max(np.hypot(course[:, X], course[:, Z])) < 0.02
    assert np.max(np.hypot(course[50:, X], course[50:, Z])) < 1e-3
    assert np.max(np.abs(course[50:, PITCH])) < 1e-3
    assert hover_excursion(vehicle, orbit) == pytest.approx(float(np.max(np.hypot(course[:, X], course[:, Z]))))


@pytest.mark.parametrize("name", NAMES)
def test_without_feedback_the_same_push_grows_at_the_rate_foretold(name: str) -> None:
    vehicle, orbit, model = load_vehicle(name), orbit_of(name), model_of(name)
    none = np.zeros((2, len(orbit.state)))
    course = fly(vehicle, orbit, pushed(orbit.state), none, 80) - orbit.state
    assert np.max(np.abs(course[-15:, PITCH])) > 5.0 * 0.05
    # Small enough to stay linear: after two periods the swinging is larger by what the exponent says.
    exponent = growth(model)
    strokes = round(2.0 * math.pi / abs(exponent.imag) / model.period)
    start = orbit.state.copy()
    start[PITCH] += 1e-4
    pitch = (fly(vehicle, orbit, start, none, 3 * strokes) - orbit.state)[:, PITCH]
    first, second = (float(np.max(np.abs(pitch[i * strokes : (i + 1) * strokes]))) for i in (1, 2))
    assert math.log(second / first) / (strokes * model.period) == pytest.approx(exponent.real, rel=0.15)


@pytest.mark.parametrize("name", NAMES)
def test_an_insect_is_refused_by_the_flight_in_one_line(name: str) -> None:
    wanted = rf"^{name} has no flight-computer file: it can be trimmed and linearized, not flown; arizona_100cm"
    with pytest.raises(InputError, match=wanted) as refused:
        check(build_parser().parse_args(["--vehicle", name]))
    assert "\n" not in str(refused.value)

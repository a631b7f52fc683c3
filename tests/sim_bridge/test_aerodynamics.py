"""What every model of the table keeps to, whatever it computes: `sim_bridge.aerodynamics.protocol`."""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from aerodynamics_bench import (
    CASES,
    DENSITY,
    ELSEWHERE,
    MIRROR,
    NAMES,
    SLACK,
    STATES,
    Case,
    air,
    blank,
    evaluated,
    inertia_and_load,
    loaded,
    mirrored,
    mirrored_strips,
    motion_of,
    moving,
    near,
    numbers,
    plant_of,
    simulate,
    strips_of,
    tumbling,
)

from sim_bridge import plant_kernel as k
from sim_bridge.aerodynamics import protocol
from sim_bridge.aerodynamics.models import MODELS, Air, advance, find_model, loads
from sim_bridge.aerodynamics.protocol import MASS, Motion, Strips
from sim_bridge.aerodynamics.surfaces import body_drag
from sim_bridge.compiled import Bound
from sim_bridge.flight.world import Scenario, SimulatedWorld
from sim_bridge.plant import Plant, plant_parameters
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import load_vehicle, models_of, with_model
from wingbeat.errors import InputError

README = Path(protocol.__file__).with_name("README.md")
WITH_APPARENT_MASS = {"strip_theory", "quasi_steady", "vortex_lattice"}
"""models that tell the air's mass; the others have none"""

# The coupled lattice takes half a minute to compile; interpreted it is in `test_vortex_lattice_coupled`.
every_case = pytest.mark.parametrize(
    "case",
    [pytest.param(case, marks=pytest.mark.validate if case.model == "vortex_lattice" else ()) for case in CASES],
    ids=str,
)
every_vehicle = pytest.mark.parametrize("name", NAMES)
every_state = pytest.mark.parametrize("state", STATES)


# --- the table --------------------------------------------------------------------------------------------------


def test_names_settings_and_parameters_belong_to_one_model_each() -> None:
    assert list(MODELS) == [model.name for model in MODELS.values()]
    assert len({model.settings for model in MODELS.values()}) == len(MODELS)
    assert tuple(MODELS) == Air._fields[1:]
    for model in MODELS.values():
        assert find_model(model.name) is model
        assert len(set(model.parts)) == len(model.parts) > 0


def test_an_unknown_model_is_told_the_known_ones() -> None:
    with pytest.raises(InputError, match=r'^unknown aerodynamic model "panels"; known: ' + ", ".join(MODELS)):
        find_model("panels")


@pytest.mark.parametrize("model", MODELS.values(), ids=list(MODELS))
def test_a_model_says_what_it_is(model: protocol.AerodynamicModel) -> None:
    assert model.title
    for piece in (model.settings, model.parameters, model.build, model.initial, model.loads, model.advance):
        text = inspect.getdoc(piece)
        # A NamedTuple without a docstring gets one of its fields' names.
        assert text and not text.startswith(f"{getattr(piece, '__name__', '')}(")
    assert len(inspect.getdoc(inspect.getmodule(model.build)) or "") > 100


@pytest.mark.parametrize("model", MODELS.values(), ids=list(MODELS))
def test_the_readme_has_a_row_for_the_model_with_its_parts(model: protocol.AerodynamicModel) -> None:
    rows = [line for line in README.read_text(encoding="utf-8").splitlines() if line.startswith(f"| `{model.name}`")]
    assert len(rows) == 1
    assert ", ".join(part.replace("_", " ") for part in model.parts) in rows[0]


@every_vehicle
def test_a_model_flies_the_vehicles_whose_files_have_its_section(name: str) -> None:
    assert set(models_of(load_vehicle(name))) == set(MODELS) - set(ELSEWHERE)


# --- parameters and state ---------------------------------------------------------------------------------------


@every_vehicle
@every_case
def test_parameters_are_a_tuple_of_the_models_own_type(name: str, case: Case) -> None:
    vehicle = simulate(name, case)
    model, strips = MODELS[case.model], strips_of(plant_of(name, case))
    settings = vehicle.sections[case.model]
    assert type(settings) is model.settings
    parameters = model.build(settings, strips)
    assert type(parameters) is model.parameters and isinstance(parameters, tuple)
    assert model.build(settings, strips) == parameters


@every_vehicle
@every_case
def test_the_state_begins_finite_and_has_a_rate_for_each_of_its_numbers(name: str, case: Case) -> None:
    plant, model = plant_of(name, case), MODELS[case.model]
    state = model.initial(plant.mechanism.aerodynamics, strips_of(plant))
    assert state.ndim == 1 and state.dtype == np.float64 and np.all(np.isfinite(state))
    assert state.shape == loaded(plant, motion_of(plant, tumbling(plant, 1))).rates.shape
    assert plant.y.shape[0] == plant.layout.aerodynamics + state.shape[0] == plant.layout.size
    assert np.array_equal(plant.y[plant.layout.aerodynamics :], state)


# --- loads ------------------------------------------------------------------------------------------------------


@every_vehicle
@every_case
@every_state
def test_loads_are_finite_and_bounded(name: str, case: Case, state: str) -> None:
    plant = plant_of(name, case)
    out = loaded(plant, motion_of(plant, STATES[state](plant)))
    assert np.all(np.isfinite(numbers(out)))
    assert out.parts.shape[0] == len(MODELS[case.model].parts)
    # No section of these wings pulls more than two hundred times the weight of the vehicle.
    assert np.max(np.abs(out.parts)) < 200.0 * plant.parameters.weight


@every_vehicle
@every_case
def test_a_wing_at_rest_in_still_air_bears_nothing(name: str, case: Case) -> None:
    plant = plant_of(name, case)
    out = loaded(plant, motion_of(plant, moving(plant, (0.0, 0.0, 0.0))))
    assert np.all(out.parts == 0.0) and np.all(out.body == 0.0) and np.all(out.rates == 0.0)


@every_case
def test_every_part_bears_something_somewhere_on_strips_or_body(case: Case) -> None:
    plant = plant_of("arizona_100cm", case)
    result = [loaded(plant, motion_of(plant, STATES[state](plant))) for state in STATES]
    on_strips = np.max([np.max(np.abs(out.parts), axis=(1, 2)) for out in result], axis=0)
    on_body = np.max([np.max(np.abs(out.body), axis=1) for out in result], axis=0)
    assert len(on_strips) == len(on_body) == len(MODELS[case.model].parts)
    assert np.all(on_strips + on_body > 1e-6)


@every_vehicle
@every_case
def test_the_loads_are_of_this_instant_and_not_of_what_was_in_their_place(name: str, case: Case) -> None:
    plant, out = plant_of(name, case), blank(plant_of(name, case))
    motions = [motion_of(plant, tumbling(plant, seed)) for seed in (1, 2)]
    memory, mechanism = plant.mechanism.aerodynamic_state.copy(), plant.mechanism
    for motion in (*motions, motions[0]):
        loads(plant.parameters.air, mechanism.wings.strips, motion, DENSITY, memory, out)
    assert np.array_equal(numbers(out), numbers(loaded(plant, motions[0])))
    assert np.array_equal(memory, mechanism.aerodynamic_state)


@every_vehicle
@every_case
def test_air_loads_and_apparent_mass_scale_with_density(name: str, case: Case) -> None:
    plant = plant_of(name, case)
    motion = motion_of(plant, tumbling(plant, 6))
    once, thrice = (loaded(plant, motion, density) for density in (0.8, 2.4))
    assert max(float(np.max(np.abs(part))) for part in (once.parts, once.body)) > 0.01
    for one, three in zip(
        (once.parts, once.apparent, once.body), (thrice.parts, thrice.apparent, thrice.body), strict=True
    ):
        assert three == pytest.approx(3.0 * one, rel=1e-12, abs=1e-12 * float(np.max(np.abs(one))) + 1e-300)
    assert near(thrice.rates, once.rates, 1e-6, 1e-12)


@every_vehicle
@every_case
@every_state
def test_apparent_mass_is_positive_where_the_model_has_one(name: str, case: Case, state: str) -> None:
    plant = plant_of(name, case)
    out = loaded(plant, motion_of(plant, STATES[state](plant)))
    if case.model in WITH_APPARENT_MASS:
        assert np.min(out.apparent[MASS]) > 0.0
    assert np.min(out.apparent) >= 0.0 and np.any(out.apparent) == (case.model in WITH_APPARENT_MASS)
    # Less than that of a plate across an ideal flow, which moves a cylinder of air about its chord.
    strips = strips_of(plant)
    cylinder = 0.25 * math.pi * DENSITY * strips.chord**2 * strips.width
    assert np.all(out.apparent[MASS] <= cylinder * (1.0 + 1e-12))


@every_vehicle
@every_case
@every_state
def test_the_compiled_call_is_the_call_from_python(name: str, case: Case, state: str) -> None:
    plant, model = plant_of(name, case), MODELS[case.model]
    motion = motion_of(plant, STATES[state](plant))
    arguments = (strips_of(plant), motion, DENSITY)
    memory, plain, compiled = plant.mechanism.aerodynamic_state, blank(plant), blank(plant)
    model.loads.py_func(plant.mechanism.aerodynamics, *arguments, memory.copy(), plain)  # type: ignore[attr-defined]
    loads(plant.parameters.air, *arguments, memory.copy(), compiled)
    # Laid into their callers, sums may be ordered otherwise: to rounding.
    scale = max(float(np.max(np.abs(plain.parts))), float(np.max(np.abs(plain.body))), 1e-9)
    for other in (plain, loaded(plant, motion)):
        assert near(numbers(compiled), numbers(other), 1e-12, 1e-12 * scale)


@every_vehicle
@every_case
def test_a_model_that_does_not_need_the_strips_places_does_not_look_at_them(name: str, case: Case) -> None:
    plant = plant_of(name, case)
    motion = motion_of(plant, tumbling(plant, 7))
    told = numbers(loaded(plant, motion))
    nowhere = motion._replace(place=np.full_like(motion.place, np.nan), axes=np.full_like(motion.axes, np.nan))
    untold = numbers(loaded(plant, nowhere))
    assert np.array_equal(told, untold, equal_nan=False) == (not MODELS[case.model].needs_places)


# --- parts, strips, and what moves the body ---------------------------------------------------------------------


@every_vehicle
@every_case
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_parts_sum_to_the_strips_loads(name: str, case: Case, seed: int) -> None:
    plant = plant_of(name, case)
    evaluated(plant, tumbling(plant, seed))
    whole, parts = plant.wing_loads(), plant.scratch.wings.loads.parts.copy()
    pieces = np.zeros_like(whole)
    for part in range(parts.shape[0]):
        plant.scratch.wings.loads.parts[:] = 0.0
        plant.scratch.wings.loads.parts[part] = parts[part]
        pieces += plant.wing_loads()
    plant.scratch.wings.loads.parts[:] = parts
    assert pieces == pytest.approx(whole, abs=1e-12 * max(float(np.max(np.abs(parts))), 1e-9))


@every_vehicle
@every_case
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_parts_sum_to_all_that_the_air_does_to_the_aircraft(name: str, case: Case, seed: int) -> None:
    """Strips through the mechanism, the body through what the base is loaded with, less the fuselage's own drag."""
    plant = plant_of(name, case)
    evaluated(plant, tumbling(plant, seed))
    parts, told, s = plant.part_loads(), plant.scratch.wings.loads.parts.copy(), plant.scratch
    assert parts.shape == (len(MODELS[case.model].parts), 6)
    drag, total = np.zeros(6), s.body_load.copy()
    if not MODELS[case.model].with_fuselage:
        hull = plant.vehicle.fuselage
        body_drag(s.wings.motion.body[:3], hull.drag_area, hull.side_area, DENSITY, drag[:3])
        assert np.any(drag)
    alone = inertia_and_load(plant, 0.0 * told)[1][:6]
    total += inertia_and_load(plant, told)[1][:6] - alone - drag
    scale = max(float(np.max(np.abs(part))) for part in (parts, alone))
    assert parts.sum(axis=0) == pytest.approx(total, abs=1e-12 * scale)
    assert plant.air_load() == pytest.approx(parts.sum(axis=0), abs=1e-12 * scale)
    assert np.max(np.abs(parts)) > 0.1


@every_vehicle
@every_case
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_part_on_the_body_is_a_part_of_what_loads_the_base(name: str, case: Case, seed: int) -> None:
    """Of rows that no model tells: the kernel sums them all, in every direction."""
    plant = plant_of(name, case)
    y, s = tumbling(plant, seed), plant.scratch
    told = np.random.default_rng(seed).normal(size=s.wings.loads.body.shape)
    loads = []
    for body in (told, 0.0 * told):
        evaluated(plant, y)
        s.wings.loads.body[:] = body
        k.load_fuselage.py_func(DENSITY, plant.parameters.drag_areas, s)  # type: ignore[attr-defined]
        loads.append((s.body_load.copy(), plant.part_loads().sum(axis=0)))
    for one, none in zip(*loads, strict=True):
        assert one - none == pytest.approx(told.sum(axis=0), abs=1e-12)


@every_vehicle
@every_case
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_strips_sum_to_the_force_and_moment_on_the_body(name: str, case: Case, seed: int) -> None:
    plant = plant_of(name, case)
    evaluated(plant, tumbling(plant, seed))
    strips, parts = plant.wing_loads(), plant.scratch.wings.loads.parts.copy()
    _, alone = inertia_and_load(plant, 0.0 * parts)
    _, with_air = inertia_and_load(plant, parts)
    scale = max(float(np.max(np.abs(strips))), float(np.max(np.abs(alone))))
    assert (with_air - alone)[:6] == pytest.approx(strips.sum(axis=0), abs=1e-12 * scale)


@every_vehicle
@every_case
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_accelerations_are_those_that_the_strips_loads_give(name: str, case: Case, seed: int) -> None:
    """Newton and Euler backwards: what the base's motion takes, less all else, is the air of the wings."""
    plant = plant_of(name, case)
    evaluated(plant, tumbling(plant, seed))
    scratch, strips = plant.scratch, plant.wing_loads().sum(axis=0)
    others = scratch.plate_load + scratch.body_load
    mass, inertial = inertia_and_load(plant, 0.0 * scratch.wings.loads.parts)
    taken = mass[:6] @ scratch.accelerations
    scale = max(float(np.max(np.abs(part))) for part in (taken, inertial, strips, others))
    assert taken - inertial[:6] - others == pytest.approx(strips, abs=1e-10 * scale)
    assert np.max(np.abs(strips)) + np.max(np.abs(scratch.wings.loads.body)) > 0.1


@every_vehicle
@every_case
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_air_takes_from_the_mechanism_what_its_strips_do(name: str, case: Case, seed: int) -> None:
    """Virtual power in still air: the load on every speed, joints and twist too, against the sections' own motion."""
    plant = plant_of(name, case)
    evaluated(plant, tumbling(plant, seed))
    parts, motion = plant.scratch.wings.loads.parts.copy(), plant.scratch.wings.motion
    c = len(plant.layout.coordinates)
    speeds = np.concatenate((plant.y[7:13], plant.y[k.COORDINATES + c : k.COORDINATES + 2 * c]))
    loads = inertia_and_load(plant, parts)[1] - inertia_and_load(plant, 0.0 * parts)[1]
    forward, upward, outward, nose_up = parts.sum(axis=0)
    power = forward * motion.along - upward * motion.down + outward * motion.outward + nose_up * motion.pitch_rate
    scale = max(float(np.sum(np.abs(power))), 1e-9)
    assert loads @ speeds == pytest.approx(np.sum(power), abs=1e-11 * scale)


@every_vehicle
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_whatever_a_strip_bears_moves_body_and_joints(name: str, seed: int) -> None:
    """Loads in every direction of the section, outward too, which no model of the table has: wrench and power."""
    plant = plant_of(name, CASES[0])
    evaluated(plant, tumbling(plant, seed))
    parts = np.random.default_rng(seed).normal(size=plant.scratch.wings.loads.parts.shape)
    alone = inertia_and_load(plant, 0.0 * parts)[1]
    loads = inertia_and_load(plant, parts)[1] - alone
    motion, c = plant.scratch.wings.motion, len(plant.layout.coordinates)
    scale = max(float(np.sum(np.abs(parts))), float(np.max(np.abs(alone))))
    assert loads[:6] == pytest.approx(plant.wing_loads().sum(axis=0), abs=1e-12 * scale)
    speeds = np.concatenate((plant.y[7:13], plant.y[k.COORDINATES + c : k.COORDINATES + 2 * c]))
    forward, upward, outward, nose_up = parts.sum(axis=0)
    power = forward * motion.along - upward * motion.down + outward * motion.outward + nose_up * motion.pitch_rate
    assert loads @ speeds == pytest.approx(np.sum(power), abs=1e-11 * scale)


# --- symmetry ---------------------------------------------------------------------------------------------------


@every_vehicle
@every_case
@every_state
def test_a_mirrored_motion_has_the_mirrored_loads(name: str, case: Case, state: str) -> None:
    plant, image = plant_of(name, case), mirrored_strips(plant_of(name, case))
    y = STATES[state](plant)
    ours = loaded(plant, motion_of(plant, y))
    theirs = loaded(plant, motion_of(plant, mirrored(plant, y)))
    scale = max(float(np.max(np.abs(ours.parts))), 1e-9)
    assert theirs.parts[:, :, image] == pytest.approx(ours.parts, rel=1e-9, abs=1e-12 * scale)
    assert theirs.apparent[:, image] == pytest.approx(ours.apparent, rel=1e-9)
    assert theirs.body == pytest.approx(ours.body * (*MIRROR, *-MIRROR), rel=1e-9, abs=1e-12)


@every_vehicle
@every_case
def test_a_mirrored_flight_is_the_flight_in_a_mirror(name: str, case: Case) -> None:
    """Wings, tail and wind without symmetry; the air's memory grows on the way and is never asked."""
    plant, image = plant_of(name, case), mirrored_strips(plant_of(name, case))
    start = tumbling(plant, 3)
    commands = k.Controls(0.1, 0.12, -0.2, -0.19, 0.4, 0.1, 0.2, 0.005, 1.0)
    swapped = commands._replace(left_start=-0.2, left_end=-0.19, right_start=0.1, right_end=0.12, rudder=-0.2)
    if plant.parameters.drive_kind == k.CRANK:
        swapped = commands._replace(rudder=-0.2)
    flights = []
    for y, command, wind in ((start, commands, (2.0, 1.0, 0.3)), (mirrored(plant, start), swapped, (2.0, -1.0, 0.3))):
        plant.y[:] = y
        for _ in range(4):
            plant.advance(command, air(wind))
        flights.append((plant.y.copy(), plant.wing_loads()))
    (ours, loads), (theirs, images) = flights
    mechanical = slice(0, plant.layout.aerodynamics)
    assert mirrored(plant, theirs)[mechanical] == pytest.approx(ours[mechanical], rel=1e-7, abs=1e-7)
    turned = images[image] * (*MIRROR, *-MIRROR)
    assert turned == pytest.approx(loads, rel=1e-6, abs=1e-6 * max(float(np.max(np.abs(loads))), 1e-9))


@every_vehicle
@every_case
def test_moving_through_still_air_is_standing_in_wind(name: str, case: Case) -> None:
    plant, wind = plant_of(name, case), np.array([4.0, -1.5, 0.7])
    y = tumbling(plant, 8)
    still = evaluated(plant, y)
    loads, motion = plant.wing_loads(), [column.copy() for column in plant.scratch.wings.motion]
    r = plant.scratch.r.copy()
    carried = y.copy()
    carried[7:10] += r.T @ wind
    windy = evaluated(plant, carried, air(wind))
    for ours, theirs in zip(motion, plant.scratch.wings.motion, strict=True):
        assert theirs == pytest.approx(ours, rel=1e-9, abs=1e-9)
    assert plant.wing_loads() == pytest.approx(loads, rel=1e-9, abs=1e-9 * max(float(np.max(np.abs(loads))), 1.0))
    # The body's axes turn under the wind that it is carried by.
    expected = still.copy()
    expected[0:3] += wind
    expected[7:10] -= np.cross(y[10:13], r.T @ wind)
    assert windy == pytest.approx(expected, rel=1e-8, abs=1e-8 * float(np.max(np.abs(still))))


# --- memory -----------------------------------------------------------------------------------------------------


@every_vehicle
@every_case
def test_advance_leaves_the_state_finite_and_what_the_integrator_moves_alone(name: str, case: Case) -> None:
    plant = plant_of(name, case)
    plant.y[:] = tumbling(plant, 2)
    for _ in range(3):
        plant.advance(SLACK, air())
    motion = motion_of(plant, plant.y.copy())
    before = plant.y[plant.layout.aerodynamics :].copy()
    smooth = loaded(plant, motion, state=before.copy()).rates != 0.0
    after, compiled = before.copy(), before.copy()
    arguments = (strips_of(plant), motion, DENSITY)
    plant.mechanism.model.advance(plant.mechanism.aerodynamics, *arguments, after, 0.001)
    advance(plant.parameters.air, *arguments, compiled, 0.001)
    assert np.all(np.isfinite(after))
    assert np.array_equal(after[smooth], before[smooth])
    assert np.array_equal(after, compiled)
    assert MODELS[case.model].advances or np.array_equal(after, before)


Shed = tuple[list[Floats], Floats, float, float]


@pytest.fixture
def shed(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Shed]]:
    """What `advance` of the table is given: motion, state, density and dt of each call; it counts in the state."""
    calls: list[Shed] = []

    def note(air: Air, strips: Strips, motion: Motion, density: float, state: Floats, dt: float) -> None:
        calls.append(([column.copy() for column in motion], state.copy(), density, dt))
        state += 1.0

    monkeypatch.setattr(k.models, "advance", note)
    monkeypatch.setattr(k, "bound_values", lambda bound: bound.values)
    for name in ("advance_memory", "_add_means", "_add_specific_force"):
        monkeypatch.setattr(k, name, getattr(k, name).py_func)
    yield calls


@every_vehicle
@pytest.mark.parametrize("case", [CASES[1], Case("strip_theory", {"wake_lag": 1.0})], ids=str)
def test_the_motion_that_advance_is_given_is_that_of_the_new_state(name: str, case: Case, shed: list[Shed]) -> None:
    """The integrator in Python, so that the table's `advance` can be another; the right-hand side is the compiled."""
    plant, h, steps = plant_of(name, case), 0.001, 3
    p, s = plant.parameters._replace(advances=True), plant.scratch
    plant.evaluate(SLACK, air())
    y, controls = tumbling(plant, 2), SLACK._replace(duration=h)
    for step in range(steps):
        k.advance.py_func(y, 1, controls, air(), Bound((p, s)))  # type: ignore[attr-defined]
        last, trial = [column.copy() for column in s.wings.motion], s.trial.copy()
        motion, state, density, dt = shed[step]
        assert (density, dt) == (DENSITY, h) and len(shed) == step + 1
        assert np.array_equal(y[plant.layout.aerodynamics :], state + 1.0)
        new = motion_of(plant, y)
        for field, ours, theirs in zip(Motion._fields, motion, new, strict=True):
            if MODELS[case.model].needs_places or field not in ("place", "axes"):
                assert ours == pytest.approx(theirs, rel=1e-12, abs=1e-12)
        assert all(np.array_equal(one, other) for one, other in zip(motion, last, strict=True))
        # The last stage's motion, which is another, would pass a tolerance of some 1e-6 m/s.
        evaluated(plant, trial)
        assert np.max(np.abs(plant.scratch.wings.motion.down - new.down)) > 1e-9


def test_a_model_with_nothing_to_advance_is_not_asked(shed: list[Shed]) -> None:
    plant = plant_of(NAMES[0], CASES[0])
    y = tumbling(plant, 2)
    bound = Bound((plant.parameters, plant.scratch))
    k.advance.py_func(y, 2, SLACK, air(), bound)  # type: ignore[attr-defined]
    assert not MODELS[CASES[0].model].advances and shed == []


@pytest.mark.parametrize("case", [case for case in CASES if not MODELS[case.model].advances], ids=str)
def test_what_it_costs_to_advance_changes_no_flight(case: Case) -> None:
    """Compiled: the motion evaluated once more a step leaves no trace but in the scratch, where a model has no memory
    to advance."""
    plant, ends = plant_of(NAMES[0], case), []
    parameters = plant.parameters
    for advances in (False, True):
        plant.parameters = parameters._replace(advances=advances)
        plant.y[:] = tumbling(plant, 2)
        plant.advance(SLACK, air())
        ends.append(plant.y.copy())
        motion = [column.copy() for column in plant.scratch.wings.motion]
        new = motion_of(plant, plant.y.copy())
        assert np.allclose(motion[1], new.down, rtol=1e-12, atol=1e-12) == advances
    plant.parameters = parameters
    assert np.array_equal(*ends)


def test_a_wake_remembers() -> None:
    plant = plant_of("robo_raven_ii_d", Case("strip_theory", {"wake_lag": 1.0}))
    plant.y[:] = tumbling(plant, 2)
    plant.advance(SLACK, air())
    assert np.all(plant.y[plant.layout.aerodynamics :] != 0.0)


# --- in the plant -----------------------------------------------------------------------------------------------


@every_vehicle
@every_case
def test_a_model_swapped_at_run_time_flies(name: str, case: Case) -> None:
    plant = plant_of(name, case)
    assert plant.vehicle.aerodynamics.model == case.model
    start = moving(plant, (9.2, 0.0, 0.5), (5.0, 5.0))
    plant.y[:] = start
    means = plant.advance(SLACK, air())
    assert np.all(np.isfinite(plant.y)) and np.all(np.isfinite(means))
    assert plant.y[0] == pytest.approx(9.2 * 0.005, rel=0.02)


@every_vehicle
def test_the_models_differ_in_what_they_do_to_a_flight(name: str) -> None:
    ends = []
    for case in CASES[: len(MODELS)]:
        plant = plant_of(name, case)
        plant.y[:] = moving(plant, (9.2, 0.0, 0.5), (5.0, 5.0))
        plant.advance(SLACK, air())
        ends.append(plant.y[7:10].copy())
    for i, one in enumerate(ends):
        for other in ends[:i]:
            assert np.linalg.norm(one - other) > 1e-4


@every_case
def test_the_world_tells_the_loads_of_the_wings_whatever_bears_them(case: Case) -> None:
    world = SimulatedWorld(simulate("arizona_100cm", case), Scenario())
    plant = world.plant
    evaluated(plant, tumbling(plant, 4))
    told = np.array(world.truth_loads()[1:7])
    assert told == pytest.approx(plant.part_loads().sum(axis=0))
    assert np.max(np.abs(told)) > 0.1


@every_case
def test_tail_and_fuselage_are_the_plants_where_the_model_has_them_not(case: Case) -> None:
    plant, model = plant_of("robo_raven_ii_d", case), MODELS[case.model]
    evaluated(plant, tumbling(plant, 4))
    assert (np.max(np.abs(plant.scratch.plate_load)) > 0.1) == (not model.with_tail)
    drag = plant.scratch.body_load - plant.scratch.wings.loads.body.sum(axis=0)
    assert (drag[:3] @ plant.scratch.wings.motion.body[:3] < -0.1) == (not model.with_fuselage)


@every_case
@pytest.mark.parametrize("fuselage", [False, True])
@pytest.mark.parametrize("tail", [False, True])
def test_nothing_that_a_model_has_in_its_loads_is_counted_twice(case: Case, fuselage: bool, tail: bool) -> None:
    plant = Plant(simulate("arizona_100cm", case))
    model = MODELS[case.model]._replace(with_fuselage=fuselage, with_tail=tail)
    plant.parameters = plant_parameters(plant.vehicle, plant.mechanism._replace(model=model))
    evaluated(plant, tumbling(plant, 4))
    assert np.any(plant.scratch.plate_load) != tail
    told = plant.scratch.wings.loads.body.sum(axis=0)
    assert np.array_equal(plant.scratch.body_load, told) == fuselage


def test_table_1_of_the_slow_hawk_has_its_fuselage_but_not_its_tail() -> None:
    """Grauer Eq. 13: the tail's loads were taken out before the regression; the fuselage had none to take out."""
    plant = Plant(with_model(load_vehicle("slow_hawk"), "regression"))
    assert plant.vehicle.fuselage.drag_area > 0.0
    evaluated(plant, moving(plant, (9.2, 0.0, 0.5), (5.0, 5.0)))
    assert plant.scratch.body_load == pytest.approx(plant.part_loads().sum(axis=0), rel=1e-12)
    assert np.any(plant.scratch.plate_load)

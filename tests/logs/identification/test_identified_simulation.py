"""The loop closes: what was identified is written, flown by the physics, and identified again from that flight."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from linear_ornithopter import AIRCRAFT, Flight, fly

from avionics.vehicles import load_vehicle as load_flight_vehicle
from logs.identification.data.flight import Aircraft, FlightData
from logs.identification.estimators.flight_modes import identify_modes
from logs.identification.models.modes import ModesResult
from logs.identification.report.model_file import Base, Log, linear_model, write_model
from logs.identification.results import Array, Estimate
from sim_bridge.flight.tuning.cascade import design, parts_of
from sim_bridge.flight.tuning.proof import fly_quality
from sim_bridge.flight_mechanics.orbit import Orbit, trim
from sim_bridge.flight_mechanics.stroke_map import INTERVALS, StrokeMap
from sim_bridge.tuning.margins import LIMITS
from sim_bridge.tuning.model import LinearModel, load_model
from sim_bridge.vehicles import SimulatedVehicle, load_vehicle
from wingbeat.errors import InputError

NAME = "robo_raven_ii_d"
LOG = Log("flight.mcap", "0f" * 32, 1.225)
KEPT = Path(__file__).parents[2] / "data" / "models" / f"{NAME}.toml"
CALM, SETTLE, STEP = 1.0, 1.2, 0.2
"""s; before a manoeuvre, at its ends, and of one side of its doublet"""


class Cycle(NamedTuple):
    """The first half of the loop."""

    first: ModesResult
    """of the flight that the model was written from"""
    model: LinearModel
    world: SimulatedVehicle


def base() -> Base:
    return Base(load_vehicle(NAME), load_flight_vehicle(NAME))


def manoeuvre(stroke: StrokeMap, orbit: Orbit, size: float, phase: float) -> Array:
    """A doublet from the trim, so many strokes later.

    Rows (N, 7) of what was added to the elevator, pitch rate, specific forces, pitch, airspeed, achieved elevator.
    """
    stroke.unpack(orbit.state, orbit.inputs)
    step, tail = 1.0 / (orbit.inputs.frequency * INTERVALS), stroke.plant.layout.elevator
    count = round((CALM + 2 * SETTLE + 2 * STEP) * orbit.inputs.frequency) * INTERVALS
    rows = np.zeros((count, 7))
    for i in range(count):
        since = i * step - CALM - SETTLE - phase / orbit.inputs.frequency
        added = size * (1.0 if 0.0 <= since < STEP else -1.0 if STEP <= since < 2 * STEP else 0.0)
        controls = stroke.controls(i % INTERVALS, orbit.inputs)
        u, w, q, pitch = stroke.pack()[:4]
        before = stroke.plant.y[tail]
        means = stroke.plant.advance(controls._replace(elevator=orbit.inputs.elevator + added), stroke.around)
        achieved = (before + stroke.plant.y[tail]) / 2
        rows[i] = added, q, means.specific_force_x, means.specific_force_z, pitch, np.hypot(u, w), achieved
    # The specific force is a mean over the interval that begins with the row.
    rows[1:, 2:4] = (rows[1:, 2:4] + rows[:-1, 2:4]) / 2
    return rows


def simulated_open_loop(world: SimulatedVehicle, orbit: Orbit, seed: int) -> FlightData:
    """Eight doublets, each from the trim at a phase of the stroke of its own, with the noise of sensors."""
    stroke, rng = StrokeMap(world), np.random.default_rng(seed)
    sizes = (0.08, -0.08, 0.1, -0.1, 0.06, -0.06, 0.08, -0.08)
    pieces = [manoeuvre(stroke, orbit, size, 3 * i / len(sizes) % 1) for i, size in enumerate(sizes)]
    step, rows = 1.0 / (orbit.inputs.frequency * INTERVALS), np.vstack(pieces)
    count, calm = len(rows), round(CALM / step)
    active = np.concatenate([np.where(np.arange(len(piece)) >= calm, 1.0, 0.0) for piece in pieces])
    number = np.concatenate([np.full(len(piece), float(i)) for i, piece in enumerate(pieces)])
    noise = rng.normal(size=(4, count))
    added, q, a_x, a_z, pitch, airspeed, achieved = rows.T
    return FlightData(
        step * np.arange(count), q + 0.01 * noise[0], a_x + 0.25 * noise[1], a_z + 0.25 * noise[2], pitch,
        airspeed + 0.1 * noise[3], np.full(count, orbit.means.climb_rate), achieved,
        np.arange(count) / INTERVALS, active, number, added, np.zeros(count),
    )  # fmt: skip


def aircraft_of(world: SimulatedVehicle) -> Aircraft:
    """Place of the IMU; the flight tells the achieved elevator, which lags no more.

    The world's servo is of second order: taken for a first-order lag it costs 3 % of the damping.
    """
    x, _, z = world.fuselage.imu_position
    centre = world.sections["derivatives"].center
    return Aircraft(x - centre[0], z - centre[2], 0.0)


@pytest.fixture(scope="module")
def first() -> ModesResult:
    return identify_modes(fly(Flight(seed=3)), AIRCRAFT)


@pytest.fixture(scope="module")
def cycle(first: ModesResult, tmp_path_factory: pytest.TempPathFactory) -> Cycle:
    """The base's own lateral motion and drive are given: finding them takes longer than all else here."""
    folder, own = tmp_path_factory.mktemp("cycle"), load_model(KEPT)
    with pytest.MonkeyPatch.context() as patch:
        whole = linear_model(first, LOG)._replace(lateral=own.lateral, drive=own.drive)
        patch.setattr("logs.identification.report.model_file.linear_model", lambda *_: whole)
        write_model(folder / "bird.toml", first, LOG, base())
    return Cycle(first, load_model(folder / "bird.toml"), load_vehicle(str(folder / "bird" / "world.toml")))


def both(result: ModesResult) -> tuple[Estimate, Estimate]:
    frequency, damping = result.modes[0].frequency, result.modes[0].damping
    assert frequency is not None and damping is not None
    return frequency, damping


@pytest.mark.validate
def test_the_flight_of_the_model_is_identified_as_the_model(cycle: Cycle) -> None:
    """What was written is the truth of the second flight: inside the second flight's own intervals."""
    model, world = cycle.model, cycle.world
    climb_rate = model.airspeed * np.sin(model.pitch - model.from_log().angle_of_attack)
    orbit = trim(world, model.airspeed, climb_rate)
    second = identify_modes(simulated_open_loop(world, orbit, 1), aircraft_of(world))
    for written, found in zip(both(cycle.first), both(second), strict=True):
        assert found.contains(written.value), f"{found} does not contain {written.value}"
        assert found.high - found.low < 0.1 * found.value
    written_values = {value.name: value.value for value in cycle.model.from_log().values}
    for one in second.modes[0].derivatives:
        if one.name in ("Z_w", "M_w", "M_q", "M_delta"):
            # Not each inside 95 %: the chance that all four are is 81 %.
            assert abs(one.value - written_values[one.name]) < 1.6 * (one.high - one.low) / 2, one


def test_the_model_keeps_estimates_and_log_and_names_the_folder_beside_it(cycle: Cycle) -> None:
    found = cycle.model.from_log()
    assert (found.log, found.sha256, found.density) == (LOG.name, LOG.sha256, LOG.density)
    assert Path(cycle.model.vehicle).name == "bird"
    first = {e.name: e for e in cycle.first.modes[0].derivatives}
    kept = {value.name: value for value in found.values}
    assert set(first) < set(kept) and "short_period_frequency" in kept
    assert kept["M_w"].standard_error == pytest.approx(first["M_w"].standard_error, rel=1e-6)


def test_the_pitch_loop_is_designed_from_the_file_within_its_margins(cycle: Cycle) -> None:
    alone = cycle.model._replace(lateral=None, drive=None)
    assert [part.name for part in parts_of(alone)] == ["pitch"]
    found = design(alone, load_flight_vehicle(NAME))
    assert [loop.name for loop in found.after] == ["pitch"]
    assert all(loop.margins.keeps(LIMITS) for loop in found.after)


@pytest.mark.validate
def test_the_flight_code_flies_the_identified_world(cycle: Cycle) -> None:
    """Take-off to the second hold, closed loop in gusts, with gains designed on the written model."""
    vehicle = load_flight_vehicle(NAME)
    found = design(cycle.model, vehicle)
    assert all(loop.margins.keeps(LIMITS) for loop in found.after)
    flight = fly_quality(cycle.world, vehicle, found.gains)
    assert flight.completed_legs == 2 and not flight.touched
    assert flight.altitude_rms < 2.0
    assert flight.pitch_rms < 0.15


def test_nothing_is_overwritten_and_nothing_half_written(first: ModesResult, tmp_path: Path) -> None:
    (tmp_path / "bird").mkdir()
    with pytest.raises(InputError, match=r"bird exists: it is not overwritten$"):
        write_model(tmp_path / "bird.toml", first, LOG, base())
    assert not (tmp_path / "bird.toml").exists()
    with pytest.raises(InputError, match=r"^--model .*: the name of a model ends in .toml$"):
        write_model(tmp_path / "bird.json", first, LOG, None)
    with pytest.raises(InputError, match=r"there is no folder"):
        write_model(tmp_path / "nowhere" / "bird.toml", first, LOG, None)


def test_without_bodies_the_model_is_written_alone_and_it_is_said(first: ModesResult, tmp_path: Path) -> None:
    written = write_model(tmp_path / "alone.toml", first, LOG, None)
    assert written.paths == (tmp_path / "alone.toml",)
    assert written.notes == (
        "no world to fly in: nothing tells the bodies of the vehicle (--vehicle does)",
        "not identified, so not in the model: lateral and drive",
    )
    assert load_model(written.paths[0]).vehicle == ""


def test_a_flight_without_a_whole_model_writes_none(first: ModesResult, tmp_path: Path) -> None:
    bare = first._replace(modes=tuple(mode._replace(short_period=None) for mode in first.modes))
    with pytest.raises(InputError, match=r"^no model is written: no method gives all longitudinal derivatives"):
        write_model(tmp_path / "none.toml", bare, LOG, None)
    assert list(tmp_path.iterdir()) == []

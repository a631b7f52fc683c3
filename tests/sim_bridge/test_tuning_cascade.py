"""Designed loops: their margins by other means, the flight code's own loops flown on the linear model, their file."""

from __future__ import annotations

import math
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from tuning_bench import OMEGA, VEHICLES, Sampled, designed, grows, loops, model, nearest, vehicle

from avionics.gains import FlightGains
from avionics.stabilization import pitch, roll
from avionics.vehicles import load_vehicle as load_flight_vehicle
from sim_bridge.flight.tuning import pitch as pitch_part
from sim_bridge.flight.tuning import tail_check
from sim_bridge.flight.tuning.aircraft import Aircraft
from sim_bridge.flight.tuning.cascade import PARTS, design
from sim_bridge.flight.tuning.vehicle_file import places, tuned_text, write
from sim_bridge.tuning.loop import _closed, _sample, loop_bandwidth
from sim_bridge.tuning.margins import LIMITS
from wingbeat.errors import InputError

BOTH = pytest.mark.parametrize("name", [VEHICLES[0], pytest.param(VEHICLES[1], marks=pytest.mark.validate)])
"""a design takes some seconds: that of the second vehicle is for the long studies"""
TRIM = 1e-3
"""rad; of a disturbance small enough for nothing to saturate"""


@BOTH
def test_every_designed_loop_keeps_its_margins_by_the_frequency_response_alone(name: str) -> None:
    found = {loop: nearest(response) for loop, response in loops(name, designed(name).gains).items()}
    assert set(found) == {"pitch", "roll", "climb", "altitude", "heading"}
    for loop, margins in found.items():
        assert margins.gain_db >= 6.0, loop
        assert margins.phase_deg >= 45.0, loop


@BOTH
def test_the_margins_told_are_those_of_the_frequency_response(name: str) -> None:
    """Before and after: Padé's delays and python-control's crossings against exact delays and a fine grid."""
    for told, gains in ((designed(name).before, vehicle(name).gains), (designed(name).after, designed(name).gains)):
        responses = loops(name, gains)
        for loop in told:
            found = nearest(responses[loop.name])
            assert loop.margins.gain_db == pytest.approx(found.gain_db, abs=0.05), loop.name
            assert math.degrees(loop.margins.phase) == pytest.approx(found.phase_deg, abs=0.3), loop.name


@pytest.mark.validate
@pytest.mark.parametrize("answer", [0.03, -0.02])
def test_a_pitch_that_answers_climb_errors_is_part_of_the_climb_loop(answer: float) -> None:
    name = VEHICLES[0]
    gains = vehicle(name).gains
    nosed = vehicle(name)._replace(gains=gains._replace(altitude=gains.altitude._replace(pitch_error=answer)))
    told, found = design(model(name), nosed), designed(name)
    for loops_told, used in ((told.before, nosed.gains), (told.after, told.gains)):
        responses = loops(name, used)
        for loop in loops_told:
            if loop.name in ("climb", "altitude"):
                assert loop.margins.gain_db == pytest.approx(nearest(responses[loop.name]).gain_db, abs=0.05)
    assert told.gains.altitude.pitch_error == answer
    assert told.values["altitude.throttle_integral"] != found.values["altitude.throttle_integral"]


@BOTH
def test_nothing_but_the_cascade_is_changed(name: str) -> None:
    found, file = designed(name), vehicle(name).gains
    changed = {
        f"{section}.{key}"
        for section in file._fields
        for key in getattr(file, section)._fields
        if getattr(getattr(file, section), key) != getattr(getattr(found.gains, section), key)
    }
    keys = {key for part in PARTS for key in part.keys} | set(tail_check.KEYS)
    assert changed <= keys
    values = designed(name).values
    assert set(values) == keys
    assert all(getattr(getattr(found.gains, key.split(".")[0]), key.split(".")[1]) == values[key] for key in values)


@BOTH
def test_the_tail_check_expects_a_part_of_the_elevator_of_the_model(name: str) -> None:
    check, m = designed(name).gains.tail_check, model(name)
    assert 0.0 < check.effect * m.airspeed**2 < 0.25 * abs(m.elevator[2])
    assert check.damping == pytest.approx(-m.a[2, 2], rel=0.01)
    assert check.threshold == vehicle(name).gains.tail_check.threshold


def test_tune_designs_for_the_control_law_that_flies() -> None:
    """GIVEN a vehicle with I-PD WHEN it is tuned THEN its own gains follow the setpoint faster than those for PID.

    The closed loop of I-PD is that of PID behind the filter 1 / (1 + s P/I).
    """
    name = VEHICLES[0]
    gains, m = vehicle(name).gains, model(name)._replace(drive=None, lateral=None)
    i_pd = vehicle(name)._replace(gains=gains._replace(pitch=gains.pitch._replace(law="i_pd")))
    found, other = design(m, i_pd), designed(name).gains.pitch._replace(law="i_pd")
    assert found.gains.pitch.law == "i_pd" and found.after[0].margins.keeps(LIMITS)
    with_pid_gains = Aircraft(m, vehicle(name).airframe, gains._replace(pitch=other))
    process = pitch_part.process(with_pid_gains)
    assert found.after[0].bandwidth > 1.1 * loop_bandwidth(process, pitch_part.terms(with_pid_gains))
    terms = pitch_part.terms(with_pid_gains)
    pid = _closed(_sample(process._replace(setpoint_weight=1.0)), terms)[1]
    weighted = _closed(_sample(process), terms)[1]
    filtered = pid / (1.0 + 1j * _sample(process).omega * terms.proportional / terms.integral)
    np.testing.assert_allclose(weighted, filtered, rtol=1e-9)


@pytest.mark.validate
def test_a_slower_pitch_law_needs_less_of_the_pitch_in_the_climb_loop() -> None:
    """GIVEN I-PD and the answer of the pitch to climb errors that suits PID THEN tune says what to change."""
    name = VEHICLES[0]
    gains = vehicle(name).gains
    gains = gains._replace(pitch=gains.pitch._replace(law="i_pd"))
    with pytest.raises(InputError, match=r"^climb: .*; try altitude.pitch_error below 0.08 rad s/m, down to 0$"):
        design(model(name), vehicle(name)._replace(gains=gains))
    calm = gains._replace(altitude=gains.altitude._replace(pitch_error=0.0))
    found = design(model(name), vehicle(name)._replace(gains=calm))
    assert [loop.name for loop in found.after] == [part.name for part in PARTS]
    assert all(loop.margins.stable for loop in found.after)


def test_a_key_that_the_file_leaves_to_its_default_is_added(tmp_path: Path) -> None:
    name = VEHICLES[0]
    lines = vehicle(name).file.text.splitlines(keepends=True)
    at = lines.index("[pitch]\n")
    at += next(i for i, line in enumerate(lines[at:]) if line.startswith("airspeed = "))
    bare = lines[:at] + lines[at + 1 :]
    path = tmp_path / "avionics.toml"
    path.write_text("".join(bare), encoding="utf-8")
    text = tuned_text(load_flight_vehicle(path), designed(name))
    path.write_text(text, encoding="utf-8")
    assert load_flight_vehicle(path).gains == designed(name).gains


@BOTH
def test_a_loop_is_no_faster_than_the_flapping_and_the_loops_inside_it_allow(name: str) -> None:
    loop = {one.name: one for one in designed(name).after}
    flapping = 2.0 * math.pi * model(name).frequency
    assert max(loop["pitch"].margins.crossover, loop["roll"].margins.crossover) <= flapping / 3.0 * 1.01
    assert loop["altitude"].margins.crossover <= loop["climb"].bandwidth / 4.0 * 1.01
    assert loop["heading"].margins.crossover <= loop["roll"].bandwidth / 4.0 * 1.01
    gains = designed(name).gains.altitude
    assert gains.proportional * max(gains.climb_max, gains.sink_max) <= gains.climb_rate_limit


@BOTH
def test_a_designed_loop_is_as_fast_as_any_scaled_within_the_limits(name: str) -> None:
    """With P, I and D all larger by a fifth the pitch loop breaks a limit: the search left nothing there."""
    gains = designed(name).gains.pitch
    scaled = designed(name).gains._replace(
        pitch=gains._replace(
            proportional=1.2 * gains.proportional, integral=1.2 * gains.integral, damping=1.2 * gains.damping
        )
    )
    response = loops(name, scaled)["pitch"]
    crossing = np.flatnonzero(np.diff(np.sign(np.abs(response) - 1.0)))
    too_fast = OMEGA[crossing[-1]] > 2.0 * math.pi * model(name).frequency / 3.0
    margins = nearest(response)
    near = np.min(np.abs(1.0 + response)) < 1.0 / LIMITS.sensitivity
    assert too_fast or near or margins.gain_db < 6.0 or margins.phase_deg < 45.0


def pitch_grows(name: str, gains: FlightGains, factor: float = 1.0, late: float = 0.0) -> bool:
    """Fly the flight code's pitch loop on A and B, its elevator multiplied about the trim."""
    m, trim = model(name), gains.pitch.elevator_trim
    axis = Sampled(m.a, m.elevator, vehicle(name).airframe.tail_time_constant, 0.005 + late)
    state = pitch.initial(gains.pitch)
    axis.x[3] = TRIM

    def fly(time: float) -> float:
        nonlocal state
        measured = pitch.Measured(float(axis.x[3]), float(axis.x[2]), m.frequency, airspeed=m.airspeed)
        state, status = pitch.step(gains.pitch, state, round(time * 1e6), 0.01, 0.0, measured)
        assert not status.saturated
        axis.advance(factor * (status.elevator - trim), 0.01)
        return float(axis.x[3])

    return grows(fly)


def roll_grows(name: str, gains: FlightGains, factor: float = 1.0, late: float = 0.0) -> bool:
    """Fly the flight code's roll loop on A and B, its command multiplied."""
    m = model(name)
    assert m.lateral is not None
    b = m.lateral.rudder * gains.tail.rudder_share
    axis = Sampled(m.lateral.a, b, vehicle(name).airframe.tail_time_constant, 0.005 + late)
    state = roll.State()
    axis.x[3] = TRIM

    def fly(time: float) -> float:
        nonlocal state
        measured = roll.Measured(float(axis.x[3]), float(axis.x[1]), m.airspeed)
        state, status = roll.step(gains.roll, state, round(time * 1e6), 0.01, 0.0, measured)
        assert not status.saturated
        axis.advance(factor * status.roll_command, 0.01)
        return float(axis.x[3])

    return grows(fly)


@pytest.mark.parametrize("recording", [pitch_grows, roll_grows])
@BOTH
def test_the_flight_code_stands_the_gain_it_was_designed_for_and_no_more(name: str, recording) -> None:  # type: ignore[no-untyped-def]
    gains = designed(name).gains
    loop = next(one for one in designed(name).after if one.name == recording.__name__.partition("_")[0])
    most = 10.0 ** (loop.margins.gain_db / 20.0)
    assert not recording(name, gains, 1.0)
    assert not recording(name, gains, 1.9)
    assert not recording(name, gains, 0.96 * most)
    assert recording(name, gains, 1.04 * most)
    assert recording(name, gains, 2.5 * most)


@pytest.mark.parametrize("recording", [pitch_grows, roll_grows])
@BOTH
def test_the_flight_code_stands_the_delay_its_phase_margin_says(name: str, recording) -> None:  # type: ignore[no-untyped-def]
    gains = designed(name).gains
    loop = next(one for one in designed(name).after if one.name == recording.__name__.partition("_")[0])
    most = loop.margins.phase / loop.margins.crossover
    assert not recording(name, gains, late=0.93 * most)
    assert recording(name, gains, late=1.07 * most)


def test_a_model_without_drive_and_lateral_motion_tunes_the_pitch_loop_alone() -> None:
    name = VEHICLES[0]
    bare = model(name)._replace(drive=None, lateral=None)
    found = design(bare, vehicle(name))
    assert [loop.name for loop in found.after] == ["pitch"]
    # The same loop with a state fewer: rounding alone moves the search between neighbours on its grid.
    assert found.after[0].gains == pytest.approx(designed(name).after[0].gains, rel=0.05)
    assert found.after[0].margins.keeps(LIMITS)
    assert found.gains.roll == vehicle(name).gains.roll


def test_an_elevator_that_does_nothing_is_refused_by_the_loop_it_is_in() -> None:
    name = VEHICLES[0]
    limp = model(name)._replace(elevator=1e-6 * model(name).elevator)
    with pytest.raises(InputError, match="pitch: no gains"):
        design(limp, vehicle(name))


@BOTH
def test_the_written_file_loads_and_holds_the_designed_gains(name: str, tmp_path: Path) -> None:
    where = places(tmp_path / "my_bird")
    write(where, vehicle(name), designed(name), "# the world\n")
    loaded = load_flight_vehicle(where.avionics)
    assert loaded.gains == designed(name).gains
    assert loaded.airframe == vehicle(name).airframe
    assert where.world is not None and where.world.read_text() == "# the world\n"
    for loop in designed(name).after:
        for key in loop.gains:
            source = loaded.file.sources[key]
            assert source.kind == "identified"
            assert f"tuned by wingbeat tune on {name}" in source.text
            assert f"GM {loop.margins.gain_db:.1f} dB, PM {math.degrees(loop.margins.phase):.0f} deg" in source.text


def test_every_other_line_and_comment_is_kept() -> None:
    name = VEHICLES[0]
    old = vehicle(name).file.text.replace("[pitch]\n", "[pitch]  # mine\n# a word\n")
    remarked = vehicle(name)._replace(file=vehicle(name).file._replace(text=old))
    new = tuned_text(remarked, designed(name)).splitlines()
    assert len(new) == len(old.splitlines())
    changed = [(a, b) for a, b in zip(old.splitlines(), new, strict=True) if a != b]
    assert len(changed) == len(designed(name).values)
    assert all(a.split(" = ")[0] == b.split(" = ")[0] and "wingbeat tune" in b for a, b in changed)


def test_tuned_gain_in_another_layout_or_missing_is_written() -> None:
    """GIVEN a quoted key, a gain as a section and a gain that the file leaves out THEN all are in the tuned file."""
    name = VEHICLES[0]
    head, _, rest = vehicle(name).file.text.partition("[pitch]\nproportional")
    integral, damping = (re.search(rf"(?m)^{gain} = (.*)\n", rest) for gain in ("integral", "damping"))
    assert integral is not None and damping is not None
    rest = rest.replace(integral[0], "", 1).replace(damping[0], "", 1)
    own_section = "\n[pitch.integral]  # a remark\n" + integral[1].strip("{ }").replace(", ", "\n", 2) + "\n"
    text = head + "[pitch]\n'proportional'" + rest + own_section
    odd = vehicle(name)._replace(file=vehicle(name).file._replace(text=text))
    tuned = tuned_text(odd, designed(name))
    assert "[pitch.integral]  # a remark\n" in tuned and "'proportional' = " in tuned
    for key, value in designed(name).values.items():
        loop, gain = key.split(".")
        assert tomllib.loads(tuned)[loop][gain]["value"] == value
    assert tomllib.loads(tuned)["pitch"]["damping"]["unit"] == "s"


def test_existing_files_are_never_touched(tmp_path: Path) -> None:
    for taken in ("avionics.toml", "world.toml"):
        folder = tmp_path / taken.partition(".")[0]
        folder.mkdir()
        (folder / taken).write_text("mine")
        with pytest.raises(InputError, match="exists already and is not overwritten"):
            places(folder)
        assert (folder / taken).read_text() == "mine"
    with pytest.raises(InputError, match="exists already"):
        places(tmp_path / "world" / "world.toml")
    (tmp_path / "plain").write_text("mine")
    with pytest.raises(InputError, match="is a file"):
        places(tmp_path / "plain")

"""Recorded wing motion in an air stream: files, forces, range of the models, and the command."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

import wingbeat
from groundstation.command import tunnel as command
from groundstation.command.main import main
from sim_bridge.aerodynamics.strip_theory import StripTheory
from sim_bridge.flight_mechanics.prescribed import Harmonics, JointAngles, series
from sim_bridge.flight_mechanics.recorded_motion import RecordedMotion, load_motion
from sim_bridge.flight_mechanics.similarity import range_excesses, similarity_numbers
from sim_bridge.flight_mechanics.tunnel import (
    AirStream,
    TunnelForces,
    TunnelWing,
    WingFile,
    load_wings,
    strips_of_pair,
    tunnel_forces,
    wings_of_vehicle,
)
from sim_bridge.validation import yeo
from sim_bridge.validation.insect_motion import FOLDER
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import load_vehicle
from wingbeat.errors import InputError

Capture = pytest.CaptureFixture[str]
FLY_WINGS, FLY_MOTION = FOLDER / "fruit_fly_wings.toml", FOLDER / "fruit_fly_motion.toml"
STROKE, FEATHERING = Harmonics(0.1, (0.9,), (0.05,)), Harmonics(-0.1, (0.2,), (-0.7, 0.0, 0.1))
FREQUENCY = 25.0
STREAM = AirStream(2.0)


def write_table(path: Path, phases: Floats, clock: str = "phase", scale: float = 1.0, prefix: str = "") -> Path:
    """Samples of a stroke with a measured lift, feathering in degrees."""
    angles = [series(one, phases, FREQUENCY)[0] for one in (STROKE, FEATHERING)]
    columns = (phases * scale, angles[0], np.degrees(angles[1]), np.cos(phases))
    rows = [",".join(repr(float(cell)) for cell in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([f"{clock},{prefix}stroke,{prefix}feathering_deg,lift", *rows]), encoding="utf-8")
    return path


def moth_forces(path: Path, frequency: float | None = FREQUENCY, stream: AirStream = STREAM) -> TunnelForces:
    wings = wings_of_vehicle(load_vehicle("hawkmoth"))
    return tunnel_forces(wings, load_motion(path, ["wing"], frequency), "quasi_steady", stream)


def test_fitted_series_reproduces_the_angles_and_rates(tmp_path: Path) -> None:
    motion = load_motion(write_table(tmp_path / "a.csv", np.arange(40) / 40), ["wing"], FREQUENCY)
    for harmonics, found in ((STROKE, motion.angles["wing"].stroke), (FEATHERING, motion.angles["wing"].feathering)):
        exact = series(harmonics, np.arange(200) / 200, FREQUENCY)
        assert found == pytest.approx(exact, abs=1e-9 * float(np.max(np.abs(exact))))


def test_phase_time_and_several_strokes_give_the_same_forces(tmp_path: Path) -> None:
    one = moth_forces(write_table(tmp_path / "a.csv", np.arange(60) / 60, prefix="wing."))
    several = moth_forces(write_table(tmp_path / "b.csv", np.arange(200) / 60, "time", 1.0 / FREQUENCY))
    assert several.lift == pytest.approx(one.lift, abs=1e-9)
    assert several.thrust == pytest.approx(one.thrust, abs=1e-9)


def test_a_record_without_frequency_has_the_forces_of_its_instants(tmp_path: Path) -> None:
    """GIVEN a finely sampled stroke WHEN it is a record of time THEN its inner forces are those of the series."""
    phases = np.arange(400) / 200
    record = moth_forces(write_table(tmp_path / "a.csv", phases, "time", 1.0 / FREQUENCY), None)
    stroke = moth_forces(write_table(tmp_path / "b.csv", np.arange(60) / 60))
    inner = slice(100, 300)
    found, exact = record.lift[inner], np.roll(stroke.lift, -100)
    assert found == pytest.approx(exact, abs=0.01 * float(np.max(np.abs(exact))))
    assert record.numbers["wing"].advance_ratio == pytest.approx(stroke.numbers["wing"].advance_ratio, rel=0.02)


def test_forces_grow_with_density_and_turn_with_the_body(tmp_path: Path) -> None:
    """GIVEN the flow relative to the body unchanged WHEN the body pitches THEN the force turns with it."""
    path = write_table(tmp_path / "a.csv", np.arange(60) / 60)
    level = moth_forces(path)
    assert moth_forces(path, stream=STREAM._replace(density=2.45)).lift == pytest.approx(2.0 * level.lift)
    angle = 0.3
    climbing = moth_forces(path, stream=AirStream(2.0, 2.0 * math.sin(angle), angle))
    turned = level.lift * math.cos(angle) + level.thrust * math.sin(angle)
    assert climbing.lift == pytest.approx(turned, abs=1e-12)


def test_single_wings_add_up_to_the_pair(tmp_path: Path) -> None:
    text = FLY_WINGS.read_text(encoding="utf-8")
    path = tmp_path / "one.toml"
    single = text[: text.index("[quasi_steady]")].replace("[wings.wing]", '[wings.right]\nside = "right"')
    left = single[single.index("[wings.right]") :].replace("right", "left")
    path.write_text(single + left + text[text.index("[quasi_steady]") :], encoding="utf-8")
    motion = load_motion(FLY_MOTION, ["wing"])
    pair = tunnel_forces(load_wings(FLY_WINGS), motion, "quasi_steady", STREAM)
    both = motion._replace(angles=dict.fromkeys(("left", "right"), motion.angles["wing"]))
    singles = tunnel_forces(load_wings(path), both, "quasi_steady", STREAM)
    assert singles.lift == pytest.approx(pair.lift, rel=1e-9)
    assert singles.pitch_moment == pytest.approx(pair.pitch_moment, abs=1e-15)
    assert singles.by_wing["left"] == pytest.approx(singles.by_wing["right"])


def test_yeo_wing_has_the_lift_of_the_validation() -> None:
    """GIVEN the measured motion and outline WHEN the tunnel computes the lift THEN it is that of the reference."""
    phases, still = np.arange(200) / 200, np.zeros((3, 200))
    flap = series(Harmonics(0.0354, (0.0, -0.0322), (0.3793, 0.0, -0.0035)), phases, yeo.FREQUENCY)
    leading, trailing = yeo.edges(np.linspace(0.0, yeo.SEMISPAN, 61))
    chords = tuple((leading - trailing).tolist())
    wing = TunnelWing(yeo.SEMISPAN, 0.072, math.pi / 2, chords=chords, axis=0.5, strips=yeo.STRIPS)
    settings = StripTheory(0.0, 1.0, yeo.STALL_ANGLE, 1.0, "fixed")
    angles = {"wing": JointAngles(flap, still, still, still)}
    period = 1.0 / yeo.FREQUENCY
    motion = RecordedMotion(phases * period, period, yeo.FREQUENCY, True, angles, {}, np.zeros(0), "yeo")
    file = WingFile("yeo", {"wing": wing}, {"strip_theory": settings}, "yeo")
    found = tunnel_forces(file, motion, "strip_theory", AirStream(yeo.AIRSPEED)).lift
    reference = yeo.modelled_lift(yeo.section("fixed"), 200)
    assert yeo.rms(found - reference) < 0.002 * yeo.rms(reference)


def test_models_of_a_whole_vehicle_take_one_pair_and_wakes_enough_steps(tmp_path: Path) -> None:
    motion = load_motion(write_table(tmp_path / "a.csv", np.arange(40) / 40), ["wing"], FREQUENCY)
    with pytest.raises(InputError, match=r"rate = 200 Hz is less than 20 steps of the wake per stroke of 25 Hz"):
        tunnel_forces(wings_of_vehicle(load_vehicle("arizona_100cm")), motion, "vortex_lattice", STREAM)
    hawk = wings_of_vehicle(load_vehicle("slow_hawk"))
    pairs = motion._replace(angles=dict.fromkeys(("fore", "hind"), motion.angles["wing"]))
    two = hawk._replace(wings=dict.fromkeys(("fore", "hind"), hawk.wings["wing"]))
    with pytest.raises(InputError, match="it takes one pair of wings"):
        tunnel_forces(two, pairs, "regression", STREAM)


def test_similarity_numbers_follow_their_definitions() -> None:
    strips = strips_of_pair(load_wings(FLY_WINGS).wings["wing"])
    area, reach, tip = 2.0 * 2.905e-6, 3e-3, 2.0 * 1.5 * 240.0 * 3e-3
    found = similarity_numbers(strips, 1.0, 1.5, 240.0)
    assert found.advance_ratio == pytest.approx(1.0 / tip)
    assert found.reynolds == pytest.approx((tip + 1.0) * area / (2.0 * reach) / 1.46e-5, rel=2e-3)
    assert found.aspect_ratio == pytest.approx((2.0 * reach) ** 2 / area, rel=2e-3)
    assert found.reduced_frequency == pytest.approx(math.pi * 240.0 * area / (2.0 * reach), rel=2e-3)
    hover = similarity_numbers(strips, 0.0, 1.5, 240.0)
    assert hover.advance_ratio == 0.0 and math.isinf(hover.reduced_frequency)
    gliding = similarity_numbers(strips, 1.0, 0.0, 0.0)
    assert math.isinf(gliding.advance_ratio) and gliding.reduced_frequency == 0.0


def test_every_range_has_a_source_and_a_known_quantity() -> None:
    from sim_bridge.aerodynamics.models import MODELS

    numbers = similarity_numbers(strips_of_pair(load_wings(FLY_WINGS).wings["wing"]), 0.0, 1.5, 240.0)
    for model in MODELS.values():
        assert all(one.low < one.high and len(one.source) > 10 for one in model.ranges)
        for excess in range_excesses(model, numbers):
            assert getattr(numbers, excess.quantity) == excess.value != excess.limit
    assert {one.quantity for one in range_excesses(MODELS["quasi_steady"], numbers)} == {"reynolds"}


def test_the_command_prints_writes_and_warns(tmp_path: Path, capsys: Capture) -> None:
    table, page = tmp_path / "forces.csv", tmp_path / "forces.html"
    path = write_table(tmp_path / "a.csv", np.arange(60) / 60)
    words = ["tunnel", str(path), "--vehicle", "hawkmoth", "--airspeed", "2", "--frequency", "25"]
    assert main([*words, "--out", str(table), "--report", str(page), "--json"]) == 0
    said = capsys.readouterr()
    told = json.loads(said.out)
    assert set(told) == {name for key in command.JSON_KEYS for name in re.split(r", ", key)}
    written = np.genfromtxt(table, delimiter=",", names=True)
    forces = moth_forces(path)
    assert written["lift"] == pytest.approx(forces.lift, rel=1e-6, abs=1e-12)
    assert told["mean"]["lift"] == pytest.approx(float(np.mean(forces.lift)))
    assert told["findings"] == [] and "measured" in page.read_text(encoding="utf-8")
    assert main([*words, "--out", str(table)]) == 2
    assert "it is not overwritten" in capsys.readouterr().err


def test_the_command_warns_outside_the_range(capsys: Capture) -> None:
    words = ["--wing", str(FLY_WINGS), "--aerodynamics", "quasi_steady", "--airspeed", "0"]
    assert main(["tunnel", str(FLY_MOTION), *words]) == 0
    said = capsys.readouterr()
    assert "warning: quasi_steady: Reynolds number 250 is outside" in said.err and "measured mean" in said.out


def test_the_public_function_gives_the_forces() -> None:
    found = wingbeat.tunnel(FLY_MOTION, wing=FLY_WINGS, aerodynamics="quasi_steady", airspeed=0.0)
    assert len(found.lift) == len(found.time) == 200 and float(np.mean(found.lift)) > 0.0


@pytest.mark.parametrize(
    ("text", "words", "part"),
    [
        ("phase,stroke\n0,1\n", [], "1 rows: at least 8 are needed"),
        ("phase,strok\n" + "0.1,1\n" * 9, [], "phase does not increase"),
        ("phase,strok\n" + "".join(f"{i / 9},1\n" for i in range(9)), [], "unknown column 'strok'"),
        ("phase,stroke\n" + "".join(f"{i / 9},x\n" for i in range(9)), [], "'x' is not a number"),
        ("phase,stroke\n" + "".join(f"{i / 9},1\n" for i in range(9)), [], "needs the flapping frequency"),
        ("phase,twist\n" + "".join(f"{i / 9},1\n" for i in range(9)), [], "no column wing.stroke"),
        ("phase,stroke\n" + "".join(f"{i / 9},1\n" for i in range(9)), ["--frequency", "0"], "0 is not above 0"),
        ("phase,stroke\n" + "".join(f"{i / 9},{4 * i}\n" for i in range(9)), [], "the column is stroke_deg"),
        ("phase,stroke_deg\n" + "".join(f"{i / 9},{40 * i}\n" for i in range(9)), [], "more than half a turn"),
        (
            "time,stroke\n" + "".join(f"{i / 100},{math.sin(0.06 * math.pi * i)}\n" for i in range(101)),
            ["--frequency", "5"],
            "does not repeat itself at 5 Hz: its harmonics leave 100 % of the variance",
        ),
        ("stroke\n" + "1\n" * 9, [], "needs one column time (s) or phase"),
        ("time,stroke\n" + "".join(f"{i},1\n" for i in range(9)), ["--aerodynamics", "magic"], "magic"),
        ("time,stroke\n" + "".join(f"{i},1\n" for i in range(9)), ["--aerodynamics", "derivatives"], "no section"),
        ("time,stroke\n" + "".join(f"{i},1\n" for i in range(9)), ["--wing", "w.toml"], "not allowed with"),
    ],
)
def test_bad_input_is_one_line(text: str, words: list[str], part: str, tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text, encoding="utf-8")
    assert main(["tunnel", str(path), "--vehicle", "hawkmoth", *words]) == 2
    said = capsys.readouterr()
    assert said.out == "" and part in said.err and said.err.count("\n") == 1


def test_fourier_file_rejects_a_second_frequency() -> None:
    with pytest.raises(InputError, match="states frequency and harmonics itself"):
        load_motion(FLY_MOTION, ["wing"], 3.0)


def test_motion_of_another_wing_is_rejected() -> None:
    with pytest.raises(InputError, match=r"has no motion of fore, hind; it has wing"):
        tunnel_forces(
            load_wings(FOLDER / "dragonfly_wings.toml"), load_motion(FLY_MOTION, ["wing"]), "quasi_steady", STREAM
        )


def test_measured_forces_of_several_strokes_are_folded_to_one(tmp_path: Path) -> None:
    """GIVEN two and a half strokes of a measured force THEN whole strokes are kept, in the order of their phase."""
    phase = np.arange(0.0, 2.5, 0.02)
    rows = [f"{p},{0.5 * math.cos(2.0 * math.pi * p)},{1.0 + math.sin(2.0 * math.pi * p)}" for p in phase]
    path = tmp_path / "run.csv"
    path.write_text("phase,wing.stroke,lift\n" + "\n".join(rows) + "\n")
    motion = load_motion(path, ["wing"], 4.0)
    assert len(motion.measured["lift"]) == 100 and np.all(np.diff(motion.measured_time) >= 0.0)
    assert motion.measured["lift"].mean() == pytest.approx(1.0, abs=1e-6)


def test_two_columns_of_one_name_are_an_error_with_the_line(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("phase,wing.stroke,wing.stroke\n" + "".join(f"{0.1 * k},0,0\n" for k in range(12)))
    with pytest.raises(InputError, match=r"two columns are called 'wing\.stroke'"):
        load_motion(path, ["wing"], 4.0)
    path.write_text("# measured\n\nphase,wing.stroke\n" + "".join(f"{0.1 * k},0\n" for k in range(12)) + "1.2,x\n")
    with pytest.raises(InputError, match=r"row 16, wing\.stroke: 'x' is not a number"):
        load_motion(path, ["wing"], 4.0)

"""``wingbeat trim`` and ``wingbeat linearize``: what they print, what they refuse."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from groundstation.command import fly, linearize, trim
from groundstation.command.main import main

Capture = pytest.CaptureFixture[str]
BIRD = "arizona_100cm"


def documented(keys: dict[str, str]) -> set[str]:
    return {name for key in keys for name in re.split(r", ", key)}


def test_a_trim_is_told_to_people(capsys: Capture) -> None:
    assert main(["trim", BIRD, "--airspeed", "9", "--climb", "0.5"]) == 0
    said = capsys.readouterr()
    assert "9.00 m/s, climbing +0.50 m/s" in said.out and said.err == ""
    for word in ("throttle", "elevator", "angle of attack", "W electrical", "cost of transport", "heaves"):
        assert word in said.out


def test_a_trim_is_told_to_programs(capsys: Capture) -> None:
    assert main(["trim", BIRD, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert set(told) == documented(trim.JSON_KEYS)
    assert (told["vehicle"], told["airspeed"], told["climb_rate"]) == (BIRD, 8.0, 0.0)
    assert told["inputs"]["amplitude"] is None and 0.0 < told["inputs"]["throttle"] < 1.0
    for section in ("means", "excursions", "figures"):
        assert all(name in trim.JSON_KEYS[section] for name in told[section])


@pytest.mark.parametrize("name", ["hawkmoth", "entomopter"])
def test_what_a_vehicle_without_a_drive_would_draw_is_not_told_as_nothing(name: str, capsys: Capture) -> None:
    assert main(["trim", name]) == 0
    said = capsys.readouterr().out
    assert re.search(r"power +not modelled: ", said) and " 0 W" not in said and "economy" not in said
    assert main(["trim", name, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["means"]["current"] is told["means"]["electrical_power"] is told["figures"]["endurance"] is None
    assert told["figures"]["cost_of_transport"] is None and told["figures"]["strouhal"] > 0.0


def test_another_aerodynamic_model_trims_elsewhere(capsys: Capture) -> None:
    found = []
    for words in ([], ["--aerodynamics", "quasi_steady"]):
        assert main(["trim", BIRD, "--json", *words]) == 0
        found.append(json.loads(capsys.readouterr().out))
    assert [told["aerodynamics"] for told in found] == ["strip_theory", "quasi_steady"]
    outside = [[(one["code"], one["limit"]) for one in told["findings"]] for told in found]
    assert outside == [[], [("outside_range", 1.0), ("outside_range", 2e4)]]
    assert found[1]["inputs"]["frequency"] > 1.5 * found[0]["inputs"]["frequency"]


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (["trim"], "the following arguments are required: VEHICLE"),
        (["trim", "no_such_bird"], "unknown vehicle 'no_such_bird'"),
        (["trim", BIRD, "--airspeed", "0"], "0 is not above 0"),
        (["trim", BIRD, "--airspeed", "16"], "no trim at 16 m/s climbing 0 m/s: it needs a stroke of 7.9"),
        (["trim", BIRD, "--aerodynamics", "magic"], "magic"),
        (["trim", BIRD, "--aerodynamics", "vortex_lattice"], "thousands of states: use strip_theory"),
        (["trim", "hawkmoth", "--aerodynamics", "vortex_lattice"], "hawkmoth has no section [vortex_lattice]"),
        (["tune", BIRD, "--aerodynamics", "vortex_lattice"], "no trim or linear model with vortex_lattice"),
        (["fly", "--vehicle", "slow_hawk", "--aerodynamics", "vortex_lattice"], "slow_hawk has no flight-computer"),
        (["linearize", BIRD, "--aerodynamics", "vortex_lattice"], "no trim or linear model with vortex_lattice"),
        (["linearize", BIRD, "--climb", "nan"], "nan is not a finite number"),
        (["linearize", BIRD, "--airspeed", "3", "--climb", "-5"], "3 m/s does not climb -5 m/s"),
    ],
)
def test_what_cannot_be_trimmed_is_one_line(words: list[str], part: str, capsys: Capture) -> None:
    assert main(words) == 2
    said = capsys.readouterr()
    assert said.out == "" and part in said.err
    assert said.err.startswith("wingbeat: ") and said.err.count("\n") == 1


@pytest.mark.validate
def test_where_flight_ends_does_not_depend_on_how_far_beyond_it_the_question_lies(capsys: Capture) -> None:
    told = set()
    for airspeed in ("12", "70"):  # at the one the search begins well, at the other it comes to no numbers
        assert main(["trim", "robo_raven_ii_d", "--airspeed", airspeed]) == 2
        line = capsys.readouterr().err
        assert line.startswith(f"wingbeat: robo_raven_ii_d: no trim at {airspeed} m/s climbing 0 m/s: ")
        told.add(line.partition(" m/s: ")[2])
    (reason,) = told
    limit = re.search(r"(?:above|already at) ([\d.]+) m/s", reason)
    assert limit is not None and "cruise" not in reason
    near = float(limit[1]) - 0.1
    assert main(["trim", "robo_raven_ii_d", "--airspeed", f"{near:g}", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["inputs"]["amplitude"] < 0.9


@pytest.mark.validate
def test_a_linear_model_is_told_to_programs(capsys: Capture) -> None:
    assert main(["linearize", BIRD, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert set(told) == documented(linearize.JSON_KEYS)
    names = {mode["name"]: mode for mode in told["floquet"]}
    assert {"phugoid", "short period", "dutch roll", "spiral", "roll subsidence"} <= set(names)
    assert all(key in linearize.MODE_KEYS or key in linearize.JSON_KEYS["floquet"] for key in told["floquet"][0])
    a = np.array(told["averaged"]["a"])
    ours = [complex(*mode["eigenvalue"]) for mode in told["averaged"]["modes"]]
    assert sum(2.0 * root.real for root in ours) == pytest.approx(np.trace(a))
    swing = told["averaged"]["modes"][-1]["natural_frequency"]
    assert swing == pytest.approx(names["short period"]["natural_frequency"], rel=0.1)


def test_a_linear_model_is_told_to_people(capsys: Capture) -> None:
    assert main(["linearize", BIRD]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    for word in (
        "dutch roll",
        "spiral",
        "rate of theta",
        "half in",
        "double in",
        "unexplained",
        "stroke map's modes",
    ):
        assert word in said.out


def test_a_flight_outside_the_range_of_the_model_is_warned() -> None:
    """GIVEN a model of insect wings WHEN a bird is to fly with it THEN value and limit are in the plan's notes."""
    plans = [
        fly.check(fly.build_parser().parse_args(["--aerodynamics", model]))
        for model in ("strip_theory", "quasi_steady")
    ]
    assert [[(one.code, one.limit) for one in plan.findings] for plan in plans] == [
        [],
        [("outside_range", 1.0), ("outside_range", 2e4)],
    ]
    assert not any("outside the range" in note for note in plans[0].notes)
    assert [note.startswith("warning: quasi_steady: ") for note in plans[1].notes] == [True, True]

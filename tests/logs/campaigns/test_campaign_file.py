"""A campaign's file: which flights it means, and what is refused in a line before anything flies."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from short_campaigns import campaign_of

from logs.campaigns.campaign import flight_values, load_campaign
from logs.campaigns.prepared import prepare
from sim_bridge.vehicles import load_vehicle
from sim_bridge.vibration.flight import vibration_factor
from wingbeat.api.flights import prepared_flight
from wingbeat.errors import InputError

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"
MISSIONS = Path(__file__).parents[3] / "avionics" / "missions"
SWEEP = """
seed = 11
flights = 3
[flight]
turbulence = "light"
[grid]
"wind.speed" = [0, 2.5]
faults = ["", "gps_lost@30-40 pitot_blocked@35"]
[draw]
"gains.pitch.damping" = { uniform = [0.1, 0.2] }
vehicle.bodies.fuselage.mass = { normal = [0.29, 0.01], within = [0.28, 0.3] }
"""


def test_every_point_of_the_grid_is_flown_with_the_same_draws(tmp_path: Path) -> None:
    campaign = campaign_of(tmp_path, SWEEP)
    flights = [campaign.values(number) for number in range(1, campaign.size + 1)]
    assert campaign.size == 2 * 2 * 3
    assert [flight["seed"] for flight in flights] == [11, 12, 13] * 4
    assert [flight["wind.speed"] for flight in flights] == [0] * 6 + [2.5] * 6
    assert [bool(flight["faults"]) for flight in flights] == ([False] * 3 + [True] * 3) * 2
    drawn = [flight["gains.pitch.damping"] for flight in flights]
    assert drawn[:3] * 4 == drawn and len(set(drawn)) == 3
    assert all(0.1 <= value <= 0.2 for value in drawn)
    assert all(0.28 <= flight["vehicle.bodies.fuselage.mass"] <= 0.3 for flight in flights)


def test_what_is_drawn_depends_on_nothing_but_seed_flight_and_key(tmp_path: Path) -> None:
    one = campaign_of(tmp_path, SWEEP)
    more = campaign_of(
        tmp_path, SWEEP.replace("flights = 3", "flights = 30") + '"throw.speed" = {uniform = [1, 2]}\n'
    )
    key = "gains.pitch.damping"
    assert [one.values(n)[key] for n in (1, 2, 3)] == [more.values(n)[key] for n in (1, 2, 3)]
    other = campaign_of(tmp_path, SWEEP.replace("seed = 11", "seed = 12"))
    assert other.values(1)[key] != one.values(1)[key]
    assert one.digest() != other.digest()


def test_values_reach_vehicle_gains_wind_throw_and_faults(tmp_path: Path) -> None:
    campaign = campaign_of(
        tmp_path,
        """
        [flight]
        "wind.speed" = 1.5
        "wind.from_deg" = 90
        "throw.bank_deg" = 10
        "throw.speed" = 0.9
        "sensors.corner" = 1
        "scale.gains.pitch.damping" = 2.0
        "scale.vehicle.bodies.right_wing.center" = 1.1
        "vehicle.fuselage.imu_position[0]" = 0.025
        "gains.pitch.integral" = 0.011
        "fault.gps_lost.at" = 20
        "fault.gps_lost.lasting" = 5.5
        """,
    )
    plain = campaign_of(tmp_path, "flights = 2\n")
    flight, usual = prepare(campaign.stock, campaign.values(1)), prepare(plain.stock, plain.values(1))
    assert flight.scenario.wind_speed == 1.5 and flight.scenario.wind_from == pytest.approx(math.pi / 2)
    assert flight.scenario.throw == pytest.approx((0.9, 0.0, math.radians(10)))
    assert flight.scenario.sensor_corner == 1.0
    assert flight.scenario.faults == (("gps_lost", 20.0, 25.5),)
    assert flight.vehicle.fuselage.imu_position[0] == 0.025
    wing, before = flight.vehicle.bodies["right_wing"].center, usual.vehicle.bodies["right_wing"].center
    assert wing == pytest.approx([1.1 * number for number in before])
    assert flight.computer.gains.pitch.damping == pytest.approx(2 * usual.computer.gains.pitch.damping, rel=1e-6)
    assert flight.computer.gains.pitch.integral == pytest.approx(0.011, rel=1e-6)
    assert "by a campaign" in flight.vehicle.text and flight.vehicle.path == usual.vehicle.path


@pytest.mark.parametrize(("line", "factor"), [("", 1.0), ("vibration = 0\n", 0.0), ("vibration = 0.5\n", 0.5)])
def test_vehicles_vibrate_by_default(line: str, factor: float, tmp_path: Path) -> None:
    """GIVEN a vehicle with a section [vibration] THEN it vibrates once as the file has it unless the key is set."""
    campaign = campaign_of(tmp_path, f"flights = 1\n[flight]\n{line}")
    assert prepare(campaign.stock, campaign.values(1)).scenario.vibration == factor


def test_vibration_is_that_of_the_vehicle() -> None:
    """GIVEN vehicles with and without the section THEN the default is 1 and 0, and API and campaign agree."""
    with_it, without = load_vehicle("robo_raven_ii_d"), load_vehicle("slow_hawk")
    assert (vibration_factor(with_it, None), vibration_factor(without, None)) == (1.0, 0.0)
    assert prepared_flight("robo_raven_ii_d", "circuit").scenario.vibration == 1.0
    assert prepared_flight("robo_raven_ii_d", "circuit", vibration=0.0).scenario.vibration == 0.0
    with pytest.raises(InputError, match="vibration"):
        vibration_factor(without, 1.0)


def test_files_are_found_beside_the_campaign_and_their_words_count(tmp_path: Path) -> None:
    mission = tmp_path / "mine.toml"
    mission.write_text((MISSIONS / "circuit.toml").read_text().replace("Circuit", "Mine"))
    before = campaign_of(tmp_path, '[grid]\nmission = ["mine.toml", "circuit"]\n')
    assert prepare(before.stock, before.values(1)).plan == prepare(before.stock, before.values(2)).plan
    mission.write_text(mission.read_text().replace("altitude = 40", "altitude = 30"))
    after = load_campaign(before.path)
    assert prepare(after.stock, after.values(1)).plan != prepare(after.stock, after.values(2)).plan
    assert after.digest() != before.digest()


def test_the_example_means_what_its_comments_say() -> None:
    campaign = load_campaign(EXAMPLES / "gusts.toml")
    assert campaign.size == 60
    assert [campaign.values(n)["scale.gains.pitch.damping"] for n in (1, 30, 31)] == [1.0, 1.0, 2.0]


REFUSED = {
    "nothing": ("# later\n", "the file is empty"),
    "no section": ("[grids]\nx = [1]", "unknown key grids"),
    "a typing error": ('[grid]\n"wind.sped" = [1]', "unknown key wind.sped (meant 'wind.speed'?)"),
    "no distribution": ('flights = 2\n[draw]\n"wind.speed" = { unifrom = [0, 1] }', "must be one of uniform"),
    "an empty grid": ('[grid]\n"wind.speed" = []', "grid.wind.speed must be a list of one value or more"),
    "no list": ('[grid]\n"wind.speed" = 3', "grid.wind.speed must be a list"),
    "a draw without a number": ('[draw]\n"wind.speed" = { uniform = [0, 1] }', "[draw] needs flights = N"),
    "no flights": ("flights = 0", "flights = 0 must be 1 or more"),
    "twice": ('[flight]\n"wind.from" = 1\n[grid]\n"wind.from_deg" = [2]', "wind.from is set 2 times"),
    "ends the wrong way": ('flights = 2\n[draw]\n"wind.speed" = { uniform = [3, 1] }', "the first must be below"),
    "nothing within": (
        'flights = 2\n[draw]\n"wind.speed" = { normal = [2, 0.01], within = [8, 9] }', "no part of the distribution",
    ),
    "a wind of no sense": ('[grid]\n"wind.speed" = [1, -2]', "wind.speed = -2 must be 0 m/s or more"),
    "degrees for an angle": ('[grid]\n"wind.from" = [90]', "rad; wind.from_deg is in degrees"),
    "text for a number": ('[grid]\n"wind.speed" = ["strong"]', "must be a number (0 m/s or more), not 'strong'"),
    "no gain": ('[grid]\n"gains.pitch.kp" = [1]', "gains.pitch.kp: the flight computer has no such gain; pitch has"),
    "a gain beyond its range": ('[grid]\n"gains.pitch.damping" = [1e9]', "gains.pitch.damping"),
    "no vehicle's value": ('[grid]\n"vehicle.body.mass" = [1]', "has no value body.mass"),
    "an impossible mass": ('[grid]\n"vehicle.bodies.fuselage.mass" = [0.3, -1]', "bodies.fuselage.mass = -1"),
    "a mass drawn from the impossible": (
        'flights = 9\n[draw]\n"vehicle.bodies.fuselage.mass" = { uniform = [-1, 1] }', "bodies.fuselage.mass = -1",
    ),
    "no vehicle": ('[grid]\nvehicle = ["swan"]', "swan"),
    "a vehicle that nobody flies": ('[flight]\nvehicle = "hawkmoth"', "has no flight-computer file"),
    "no mission": ('[flight]\nmission = "moon"', "moon"),
    "no turbulence": ('[grid]\nturbulence = ["none", "wild"]', "wild"),
    "a value that all have": (
        '[flight]\nturbulence = "lite"\n[grid]\n"wind.speed" = [1, 2]', 'turbulence "lite" is unknown',
    ),
    "one value of a grid": (
        '[flight]\nduration = 20\n[grid]\nfaults = ["gps_lost@30", ""]', "faults = gps_lost@30: ",
    ),
    "no model": ('[grid]\naerodynamics = ["magic"]', "magic"),
    "no fault": ('[flight]\n"fault.rain.at" = 3', "no fault rain"),
    "a fault without a beginning": ('[flight]\n"fault.gps_lost.lasting" = 3', "needs fault.gps_lost.at"),
    "a fault too late": ('[flight]\nduration = 20\nfaults = "gps_lost@30"', "the flight ends at 20 s"),
    "a scale of nothing": ('[flight]\n"scale.wind.speed" = 2', "unknown key scale.wind.speed"),
    "too many": ('flights = 99999999', "1000000 are the most"),
    "no landing": ("[landing]\nspeed = 3", "unknown key landing.speed"),
    "a name of no file": ('name = "a/b"', "must be of letters"),
    "no TOML": ("name = ", "not valid TOML"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_flown_is_refused_in_one_line(tmp_path: Path, case: str) -> None:
    text, words = REFUSED[case]
    with pytest.raises(InputError) as refused:
        campaign_of(tmp_path, text)
    assert words in str(refused.value) and "\n" not in str(refused.value)
    assert str(refused.value).startswith(str(tmp_path / "short.toml"))


def test_what_all_flights_have_is_not_blamed_on_a_grid(tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        campaign_of(tmp_path, REFUSED["a value that all have"][0])
    assert "wind" not in str(refused.value)


def test_a_flight_that_is_not_there_and_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="flights 1 to 2, not 3"):
        flight_values(campaign_of(tmp_path, "flights = 2"), 3)
    with pytest.raises(InputError, match="cannot read campaign"):
        load_campaign(tmp_path / "none.toml")

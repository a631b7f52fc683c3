"""The public Python API: names, flights, simulation, steady flight, Gymnasium environment."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import wingbeat
from avionics.messages import ActuatorCommand
from sim_bridge import topics as truth
from sim_bridge.tuning.model import load_model
from wingbeat.errors import InputError

VEHICLE = "robo_raven_ii_d"
MODEL = Path(__file__).parents[1] / "data" / "models" / f"{VEHICLE}.toml"
SHORT = 16.0
"""s; of a flight that is in the air from about 9 s on"""


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> wingbeat.Flight:
    return wingbeat.fly(duration=SHORT, seed=3, log=tmp_path_factory.mktemp("api") / "flight.mcap")


def test_import_loads_nothing_else() -> None:
    code = "import sys, wingbeat; print([m for m in ('numpy', 'avionics', 'logs', 'sim_bridge') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_every_public_name_is_there_documented_and_typed() -> None:
    stub = Path(wingbeat.__file__).with_suffix(".pyi").read_text()
    for name in wingbeat.__all__:
        assert getattr(wingbeat, name).__doc__, name
        assert f'"{name}"' in stub, name


def test_unknown_name_lists_the_public_ones() -> None:
    with pytest.raises(AttributeError, match="linearize"):
        wingbeat.linearise  # type: ignore[attr-defined]  # noqa: B018


def test_flight_has_summary_topics_and_columns(flight: wingbeat.Flight) -> None:
    assert flight.summary.airtime is not None
    assert 5.0 < flight.summary.airtime < SHORT - 8.0
    assert "/main/wing" in flight.topics
    frame = flight["/main/wing"].to_pandas()
    assert frame.index.name == "time" and len(frame) == len(flight["/main/wing"].time)
    assert np.allclose(frame["phase"], flight.log["/main/wing"]["phase"])
    assert (
        "in the air" in repr(flight)
        and "/main/wing" in repr(flight.log)
        and "phase (rad)" in repr(flight["/main/wing"])
    )


def test_flight_refuses_an_existing_log(flight: wingbeat.Flight) -> None:
    with pytest.raises(InputError, match="exists"):
        wingbeat.fly(duration=SHORT, log=flight.path)


def test_flight_plots(flight: wingbeat.Flight) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    figure = flight.plot()
    assert figure.axes[0].get_ylabel() == "altitude (m)"
    assert all(axes.lines for axes in figure.axes)


def test_simulation_is_the_flight(flight: wingbeat.Flight) -> None:
    """GIVEN the same inputs WHEN stepped THEN the true states are those of the recorded flight, bit for bit."""
    sim = wingbeat.Simulation(duration=SHORT, seed=3)
    sim.run()
    simulated, recorded = sim[truth.STATE.name], flight[truth.STATE.name]
    for name in ("north", "down", "quaternion_y", "pitch_rate"):
        assert np.array_equal(simulated[name], recorded[name]), name
    assert simulated.units["pitch_rate"] == "rad/s"


def test_own_command_moves_the_aircraft() -> None:
    def nose_up(sim: wingbeat.Simulation) -> ActuatorCommand | None:
        return sim.command._replace(elevator=sim.command.elevator + 0.1) if sim.time > 12.0 else None

    plain, changed = wingbeat.Simulation(duration=13.0), wingbeat.Simulation(duration=13.0)
    plain.run()
    changed.run(controller=nose_up)
    pitch_rate = changed[truth.STATE.name]["pitch_rate"] - plain[truth.STATE.name]["pitch_rate"]
    late = plain[truth.STATE.name].time > 12.0
    assert np.all(pitch_rate[~late] == 0.0)
    assert pitch_rate[late][24] > 0.1


def test_gust_is_in_the_air_and_must_be_finite() -> None:
    sim = wingbeat.Simulation(duration=13.0)
    sim.run(until=12.0)
    sim.gust = (0.0, 0.0, -2.0)
    sim.run()
    assert sim.state.wind_down == pytest.approx(-2.0)
    with pytest.raises(InputError, match="finite"):
        sim.gust = (float("nan"), 0.0, 0.0)


def test_linear_motion_has_the_trim_and_the_short_period() -> None:
    steady = wingbeat.trim(VEHICLE, 7.0)
    assert steady.orbit.means.airspeed == pytest.approx(7.0, abs=1e-5)
    motion = wingbeat.linearize(steady)
    system = motion.longitudinal()
    assert system.state_labels == ["u", "w", "q", "theta"] and system.input_labels == ["elevator"]
    assert np.allclose(system.A, motion.model.a)
    assert motion.lateral().input_labels == ["rudder"]


def test_vehicles_are_listed_and_loaded() -> None:
    assert VEHICLE in wingbeat.vehicle_names()
    assert wingbeat.load_vehicle(VEHICLE).mass == pytest.approx(0.29, abs=0.15)
    with pytest.raises(InputError, match="unknown vehicle"):
        wingbeat.load_vehicle("robo_raven")
    with pytest.raises(InputError, match="a factor, 0 for none, not 'none'"):
        wingbeat.fly(vibration="none")  # type: ignore[arg-type]


def test_campaign_returns_a_row_per_flight(tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text(
        'name = "c"\nflights = 1\nseed = 1\n[flight]\nvehicle = "robo_raven_ii_d"\nmission = "circuit"\n'
        'duration = 12.0\n[grid]\n"wind.speed" = [0.0, 1.0]\n'
    )
    table = wingbeat.campaign(tmp_path / "c.toml")
    assert list(table["wind.speed"]) == [0.0, 1.0]
    assert not table["failed"].any()


@pytest.mark.validate
def test_gymnasium_environment_passes_the_checker() -> None:
    gymnasium = pytest.importorskip("gymnasium")
    from gymnasium.utils.env_checker import check_env

    env = gymnasium.make("wingbeat.gym:wingbeat/Flapping-v0", time_limit=2.0, handover=0.5)
    check_env(env.unwrapped, skip_render_check=True)
    seen, info = env.reset(seed=5)
    again, _ = env.reset(seed=5)
    assert np.array_equal(seen, again) and info["altitude_target"] > 0.0


def test_gymnasium_elevator_stick_pitches_up() -> None:
    gymnasium = pytest.importorskip("gymnasium")
    env = gymnasium.make("wingbeat.gym:wingbeat/Flapping-v0", time_limit=2.0)
    rates = []
    for stick in (-0.5, 0.5):
        env.reset(seed=5)
        seen = [env.step(np.array([stick, 0.0, 0.0, 0.5], np.float32))[0] for _ in range(20)]
        rates.append(np.mean([one[7] for one in seen]))
    assert rates[1] > rates[0] + 0.2


@pytest.fixture(scope="module")
def mission(standard_flight: Path) -> wingbeat.Flight:
    """The flight of README.md, with its doublets."""
    return wingbeat.Flight(wingbeat.open_log(standard_flight))


@pytest.fixture(scope="module")
def identified(mission: wingbeat.Flight) -> wingbeat.Identification:
    return wingbeat.identify(mission)


def test_identification_of_a_flight_covers_the_truth(identified: wingbeat.Identification) -> None:
    torque = identified["servo torque"].estimate("K_tau")
    assert torque is not None and torque.contains(identified.truths["K_tau"])
    frame = identified.to_pandas()
    known = frame[frame["true"].notna() & (frame["result"] == "output error")]
    assert {"short_period_frequency", "short_period_damping"} <= set(known["name"])
    assert ((known["low"] <= known["true"]) & (known["true"] <= known["high"])).all()
    assert "servo torque: K_tau" in repr(identified)
    assert identified["free response"].withheld or identified["free response"].derived


def test_identified_model_has_the_identified_mode(identified: wingbeat.Identification) -> None:
    """The longitudinal state space has the eigenvalues of the derived short period."""
    system = identified.to_control("output error")
    assert system.state_labels == ["u", "w", "q", "theta"] and system.input_labels == ["elevator"]
    frequency = identified["output error"].estimate("short_period_frequency")
    assert frequency is not None
    assert np.max(np.abs(np.linalg.eigvals(system.A))) == pytest.approx(frequency.value, rel=0.02)
    with pytest.raises(InputError, match="no linear model"):
        identified.to_control("spectre")


def test_identification_writes_its_page_and_plots(identified: wingbeat.Identification, tmp_path: Path) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    page = identified.report(tmp_path / "page.html")
    assert "<html" in page.read_text()[:400].lower()
    with pytest.raises(InputError, match="exists"):
        identified.report(page)
    figure = identified.plot("output error")
    assert len(figure.axes) >= 2 and figure.axes[0].lines
    with pytest.raises(InputError, match="no modeled outputs"):
        identified.plot("servo torque")


def test_table_gives_its_model() -> None:
    examples = Path(__file__).parents[2] / "docs" / "examples"
    found = wingbeat.identify(examples / "short_period.csv", map=examples / "short_period.toml")
    fit = found["output error, short period"]
    system = found.to_control()
    assert system.state_labels == ["alpha", "q"] and system.input_labels == ["delta_e"]
    assert system.A[1, 0] == pytest.approx(fit.value("M_alpha"))
    assert system.A[0, 0] == pytest.approx(fit.value("Z_alpha"))


def test_lateral_table_gives_its_model(tmp_path: Path) -> None:
    """GIVEN a lateral motion by aileron and rudder WHEN fitted THEN the state space has its derivatives and names."""
    time = 0.02 * np.arange(1500)
    aileron, rudder = 0.05 * np.sign(np.sin(2.0 * time)), 0.08 * np.sign(np.sin(0.9 * time + 1.0))
    a = np.array([[-0.5, 0.06, -0.98, 0.49], [-8.0, -6.0, 1.5, 0.0], [6.0, -0.4, -1.2, 0.0], [0.0, 1.0, 0.06, 0.0]])
    b = np.array([[0.0, 0.1], [20.0, 1.0], [0.5, -8.0], [0.0, 0.0]])
    state, rows = np.zeros(4), []
    for k in range(len(time)):
        rows.append([time[k], *state, aileron[k], rudder[k]])
        for _ in range(20):
            state = state + 0.001 * (a @ state + b @ np.array([aileron[k], rudder[k]]))
    noise = np.random.default_rng(1).normal(0.0, 0.002, (len(rows), 4))
    table = np.array(rows)
    table[:, 1:5] += noise
    names = ("beta", "p", "r", "phi", "delta_a", "delta_r")
    np.savetxt(tmp_path / "run.csv", table, delimiter=",", header=f"t,{','.join(names)}", comments="")
    units = {"beta": "rad", "p": "rad/s", "r": "rad/s", "phi": "rad", "delta_a": "rad", "delta_r": "rad"}
    signals = "\n".join(f'{name} = {{ column = "{name}", unit = "{unit}" }}' for name, unit in units.items())
    (tmp_path / "map.toml").write_text(
        f'[time]\ncolumn = "t"\n[signals]\n{signals}\n[constants]\nV = 20.0\ntheta = 0.06\nalpha = 0.06\n'
        '[[aero.output_error]]\nmodel = "lateral"\ninputs = ["delta_a", "delta_r"]\n'
        'zoh_inputs = ["delta_a", "delta_r"]\n'
        'outputs = ["beta", "p", "r", "phi"]\n'
    )
    found = wingbeat.identify(tmp_path / "run.csv", "aero", map=tmp_path / "map.toml")
    system = found.to_control()
    assert set(system.state_labels) == {"beta", "p", "r", "phi"} and system.input_labels == ["delta_a", "delta_r"]
    order = [system.state_labels.index(name) for name in ("beta", "p", "r", "phi")]
    assert system.A[np.ix_(order, order)][1, 0] == pytest.approx(-8.0, rel=0.1)
    assert system.B[order][1, 0] == pytest.approx(20.0, rel=0.1)


def test_tuning_keeps_its_margins_and_is_written(tmp_path: Path) -> None:
    tuning = wingbeat.tune(wingbeat.LinearMotion(load_model(MODEL)), fly=False)
    table = tuning.to_pandas()
    after = table.xs("after", level="gains")
    assert (after["gain_margin"] >= 5.99).all() and (after["phase_margin"] >= 44.9).all()
    folder = tuning.write(tmp_path / "tuned")
    gains = wingbeat.load_vehicle(folder).computer.gains
    assert gains.pitch.proportional == tuning.gains["pitch.proportional"]
    assert "pitch" in repr(tuning)


@pytest.mark.validate
def test_tuning_on_a_model_needs_its_vehicle() -> None:
    motion = wingbeat.linearize(VEHICLE)
    same = wingbeat.tune(motion, fly=False).gains
    assert same == wingbeat.tune(VEHICLE, fly=False).gains
    nameless = wingbeat.LinearMotion(motion.model._replace(vehicle=""))
    with pytest.raises(InputError, match="names no vehicle"):
        wingbeat.tune(nameless, fly=False)

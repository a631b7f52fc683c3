"""`wingbeat log vibration`: spectrum of a known signal, and the round trip of a fit through a flight's sensors."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import wingbeat
from groundstation.command.main import dispatch
from logs.vibration.analysis import AXES, analyze, clipped
from logs.vibration.fit import fit, modeled_density
from logs.vibration.flight import mount_advice
from sim_bridge.observation import Observation
from sim_bridge.sensors.noise import sensor_seed
from sim_bridge.vehicles import load_vehicle
from sim_bridge.vehicles.vibration import ModeSpec, VibrationSpec
from sim_bridge.vibration.airframe import AirframeVibration
from wingbeat.errors import InputError

STROKE, RATE = 3.8, 203.0
ROOT = Path(__file__).parents[2]
MEASURED = Path(os.environ.get("WINGBEAT_SHARED", ROOT.parent / "shared")) / "data" / "real_bird" / "imu_flight.csv"


def flapping(
    spec: VibrationSpec, modes: dict[str, ModeSpec], seconds: float = 20.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return time and IMU (n, 6) of an airframe whose vertical force has its upward peak in the mid-downstroke."""
    vibration = AirframeVibration(spec, modes, sensor_seed(2, 10), 1.0 / RATE, 1e3)
    time = np.arange(1, int(seconds * RATE) + 1) / RATE
    rows = []
    for t in time:
        phase = 2.0 * math.pi * STROKE * t
        force = (0.0, 0.0, -9.8 - 14.0 * math.sin(phase))
        rest = Observation(
            0, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), force, *[(0.0, 0.0, 0.0)] * 3, *[0.0] * 12
        )  # fmt: skip
        seen = vibration.shake(rest, -math.sqrt(2.0) * 8.0 * math.sin(phase))
        rows.append((*seen.omega_frd, *seen.specific_force_frd))
    return time, np.array(rows)


MODES = {
    "low": ModeSpec(30.0, 0.06, (1.0, 0.2, 0.5), (5.0, 3.0, 0.5), buffet=1.0),
    "high": ModeSpec(80.0, 0.05, (0.3, 1.0, 0.8), (1.0, 0.0, 2.0), buffet=2.0),
    "impact": ModeSpec(62.0, 0.08, (0.2, 0.9, 1.0), (30.0, 2.0, 8.0), kick=0.03),
}
SPEC = VibrationSpec(reference_rate=8.0, kick_phases=(0.56,), kick_jitter=0.003)


def test_spectrum_of_a_known_signal() -> None:
    """GIVEN strokes of 3.8 Hz and impacts at 0.56 WHEN analyzed THEN all are found."""
    found = analyze(*flapping(SPEC, MODES))
    assert found.stroke_frequency == pytest.approx(STROKE, abs=0.005)
    assert found.harmonics[0, 5] == pytest.approx(14.0, rel=0.02)
    assert found.ringing == pytest.approx(62.0, abs=4.0)
    loudest = int((found.by_phase[:, 0]).argmax())
    assert loudest / 16.0 == pytest.approx((0.56 - 0.25), abs=0.1)
    assert not found.clipped.any()


def test_jitter_of_time_stamps_is_no_low_pass() -> None:
    """GIVEN time stamps rounded to a millisecond WHEN analyzed THEN the broadband level is that of exact ones."""
    time, imu = flapping(SPEC, MODES)
    exact, rounded = analyze(time, imu), analyze(np.round(time, 3), imu)
    assert rounded.broadband == pytest.approx(exact.broadband, rel=0.01)


def test_fit_has_the_spectrum_of_the_flight() -> None:
    """GIVEN a vibrating flight WHEN it is fitted and flown again THEN every band above 20 Hz agrees within 3 dB."""
    measured = analyze(*flapping(SPEC, MODES))
    fitted = fit(measured, 8.0)
    assert fitted.spec.kick_phases[0] == pytest.approx(0.56, abs=0.07)
    again = analyze(*flapping(fitted.spec, fitted.modes))
    strong = measured.band_rms[2:] > 0.02 * measured.band_rms[2:].max(axis=0)
    difference = 20.0 * np.log10(again.band_rms[2:] / measured.band_rms[2:])[strong]
    assert np.abs(difference).max() < 3.0
    assert np.median(np.abs(difference)) < 1.5


def test_buffeting_by_the_airspeed_is_no_part_of_the_fitted_levels() -> None:
    """GIVEN a spectrum with buffeting by the airspeed of a quarter of the rest THEN levels 1.25 times lower."""
    measured = analyze(*flapping(SPEC, MODES))
    alone, parted = fit(measured, 8.0), fit(measured, 8.0, flow=0.25)
    for name, mode in alone.modes.items():
        assert parted.modes[name].buffet == pytest.approx(mode.buffet / 1.25, abs=1e-4)
        assert parted.modes[name].kick == mode.kick


def test_density_of_fitted_modes_is_that_of_the_flight() -> None:
    """GIVEN fitted modes WHEN their density is computed THEN its RMS in each band is the measured one."""
    measured = analyze(*flapping(SPEC, MODES))
    density = modeled_density(fit(measured, 8.0), measured)
    spacing = measured.frequency[1]
    for band, (low, high) in enumerate(measured.bands[2:], 2):
        inside = (measured.frequency >= low) & (measured.frequency < high)
        rms = np.sqrt(density[inside].sum(axis=0) * spacing)
        strong = measured.band_rms[band] > 0.1 * measured.band_rms[2:].max(axis=0)
        assert np.abs(20.0 * np.log10(rms / measured.band_rms[band]))[strong].max() < 3.0


def test_a_repeated_largest_value_is_no_clipping() -> None:
    """GIVEN a periodic signal of a coarse sensor, and one that is limited WHEN looked at THEN the second is found."""
    time = np.arange(0.0, 20.0, 0.005)
    noise = np.random.default_rng(1).normal(0.0, 0.1, len(time))
    coarse = 0.038 * np.round((-9.8 + 14.0 * np.sin(2.0 * np.pi * 4.0 * time) + noise) / 0.038)
    assert len(clipped(coarse)) == 0
    limited = np.minimum(coarse, 0.038 * 80)
    assert len(clipped(limited)) == np.count_nonzero(limited == limited.max())


def test_too_few_strokes_and_no_strokes_are_rejected() -> None:
    """GIVEN one second of flapping, or an IMU at rest WHEN analyzed THEN one line says so."""
    time, imu = flapping(SPEC, MODES, 1.0)
    with pytest.raises(InputError, match="strokes are too few"):
        analyze(time, imu)
    with pytest.raises(InputError, match="no stroke"):
        analyze(time, np.zeros_like(imu))
    time = np.arange(0.0, 10.0, 0.005)
    bench = np.random.default_rng(1).normal(0.0, 0.02, (len(time), 6))
    bench[:, 5] += 0.05 * np.sin(2.0 * np.pi * 13.0 * time) - 9.8
    with pytest.raises(InputError, match=r"strongest line, 13 Hz, has 0.05 m/s\^2"):
        analyze(time, bench)


def test_tone_without_impacts_is_the_strongest_line_and_what_a_mount_leaves_of_it() -> None:
    """GIVEN a stroke at 4 Hz and a tone at 87 Hz WHEN analyzed THEN no impacts, 87 Hz, and its transmissibility."""
    time = np.arange(0.0, 20.0, 0.0025)
    imu = np.random.default_rng(2).normal(0.0, 0.01, (len(time), 6))
    imu[:, 5] += 12.0 * np.sin(2.0 * np.pi * 4.0 * time) + 3.0 * np.sin(2.0 * np.pi * 87.0 * time) - 9.8
    found = analyze(time, imu)
    assert not found.impacts
    assert found.ringing == pytest.approx(87.0, abs=1.0)
    advice = mount_advice(found)
    assert advice.value == pytest.approx(16.0, abs=0.1)  # four times the stroke: the softest that is tried
    ratio, damping = 87.0 / 16.0, 2.0 * 0.2 * 87.0 / 16.0
    share = math.hypot(1.0, damping) / math.hypot(1.0 - ratio**2, damping)
    assert f"leaves {100.0 * share:.0f} %" in advice.text


def test_vibration_near_the_stroke_is_not_isolated() -> None:
    """GIVEN a stroke at 10 Hz and a tone at 33 Hz WHEN analyzed THEN no mount is advised."""
    time = np.arange(0.0, 20.0, 0.0025)
    imu = np.random.default_rng(3).normal(0.0, 0.01, (len(time), 6))
    imu[:, 5] += 12.0 * np.sin(2.0 * np.pi * 10.0 * time) + 3.0 * np.sin(2.0 * np.pi * 33.0 * time) - 9.8
    assert math.isnan(mount_advice(analyze(time, imu)).value)


def test_command_analyzes_and_fits(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN a flight with vibration WHEN the command runs with --fit THEN JSON and a vehicle."""
    flight = wingbeat.fly("robo_raven_ii_d", vibration=1.0, duration=25.0, log=tmp_path / "flight.mcap")
    out = tmp_path / "my_raven"
    command = ["log", "vibration", str(flight.path), "--fit", "robo_raven_ii_d", "--out", str(out), "--json"]
    page = tmp_path / "vibration.html"
    command += ["--report", str(page)]
    assert dispatch(command) == 0
    document = json.loads(capsys.readouterr().out)
    assert set(document["axes"]) == set(AXES)
    assert document["stroke_frequency"] == pytest.approx(4.0, abs=0.15)
    flown, quiet = (document["axes"]["accel_y"][key] for key in ("broadband", "quiet"))
    assert flown > 4.0 * quiet
    vehicle = load_vehicle(str(out / "world.toml"))
    assert vehicle.name == "my_raven"
    assert vehicle.modes
    assert "fitted modes" in page.read_text(encoding="utf-8")
    page.unlink()
    own = load_vehicle("robo_raven_ii_d").sections["vibration"]
    assert vehicle.sections["vibration"].washout_difference == own.washout_difference
    assert (out / "avionics.toml").is_file()
    with pytest.raises(InputError, match="exists"):
        dispatch(command)


@pytest.mark.skipif(not MEASURED.exists(), reason="needs the recordings of a real ornithopter (WINGBEAT_SHARED)")
def test_measured_ornithopter() -> None:
    """GIVEN a measured flight WHEN fitted and simulated THEN its bands above 20 Hz: 3 dB median, 8 dB worst."""
    rows = np.loadtxt(MEASURED, delimiter=",", skiprows=1)
    measured = analyze(rows[:, 0], rows[:, 1:7])
    assert measured.stroke_frequency == pytest.approx(3.807, abs=0.02)
    assert measured.broadband == pytest.approx([0.1418, 0.0251, 0.0408, 1.513, 1.7, 2.673], rel=0.01)
    assert measured.ringing == pytest.approx(65.0, abs=3.0)
    fitted = fit(measured, 8.0)
    again = analyze(*flapping(fitted.spec, fitted.modes))
    difference = np.abs(20.0 * np.log10(again.band_rms[2:] / measured.band_rms[2:]))
    assert np.median(difference) < 3.0
    assert difference.max() < 8.0

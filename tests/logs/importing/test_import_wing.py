"""Wing strokes of other programs' logs, from whatever shows them."""

from __future__ import annotations

import numpy as np
import pytest

from avionics import topics
from logs.importing.counterparts import checked
from logs.importing.source import ImportedTopic, Series
from logs.importing.wing import WingSource, wing_topic
from wingbeat.errors import InputError

TIME_US = np.arange(0, 20_000_000, 5_000, dtype=np.int64)
TIME = TIME_US * 1e-6
FREQUENCY = 3.8 + 0.02 * TIME
STROKES = 3.8 * TIME + 0.01 * TIME**2


def imu() -> ImportedTopic:
    """Return an IMU in flapping flight."""
    noise = np.random.default_rng(1).normal(0.0, 1.0, (6, len(TIME)))
    columns = dict(zip(("accel_x", "accel_y", "gyro_x", "gyro_y", "gyro_z"), noise, strict=False))
    columns["accel_z"] = -9.8 - 14.0 * np.sin(2.0 * np.pi * STROKES) + noise[5]
    return checked(topics.IMU, Series("sensor_combined", TIME_US, {}, {}), columns)


def frequency_error(made: ImportedTopic) -> float:
    """Return the largest error of the frequency in Hz away from the ends."""
    inside = (made.series.time_us > 3_000_000) & (made.series.time_us < 17_000_000)
    time = made.series.time_us[inside] * 1e-6
    return float(np.abs(made.series.columns["frequency"][inside] - (3.8 + 0.02 * time)).max())


@pytest.mark.parametrize(
    ("name", "columns", "choice", "limit"),
    [
        ("wing_phase", {"phase_rad": 2.0 * np.pi * (STROKES % 1.0)}, WingSource(), 0.01),
        ("wing_phase", {"phase": STROKES % 1.0, "valid": np.ones(len(TIME), np.uint8)}, WingSource(), 0.01),
        ("wing_phase", {"phase_deg": 360.0 * (STROKES % 1.0)}, WingSource(), 0.01),
        ("shaft_phase", {"phase": 2.0 * np.pi * (8.0 * STROKES % 1.0)}, WingSource("shaft_phase", gear=8.0), 0.01),
        ("encoder", {"count": np.floor(STROKES * 4096) % 4096}, WingSource("encoder", 4096), 0.1),
        ("flap_frequency", {"frequency_hz": FREQUENCY}, WingSource(), 0.01),
        ("encoder_count", {"count": np.rint(STROKES * 32768) % 65536}, WingSource("encoder_count", 4096, 8.0), 0.05),
        ("rpm", {"rpm_estimate": FREQUENCY * 60.0 * 8.0}, WingSource("rpm", gear=8.0), 0.01),
    ],
    ids=["phase", "turns", "degrees", "shaft phase", "single-turn encoder", "frequency", "counter that wraps", "rpm"],
)  # fmt: skip
def test_strokes_from_a_topic(name: str, columns: dict[str, np.ndarray], choice: WingSource, limit: float) -> None:
    """GIVEN a topic of the wing WHEN imported THEN frequency, strokes and the text name it."""
    found = wing_topic({name: Series(name, TIME_US, columns, {})}, None, choice)
    assert found is not None
    made, text = found
    assert frequency_error(made) < limit and name in text
    assert made.series.columns["strokes"].max() == pytest.approx(STROKES[-1], abs=1.0)
    assert np.isnan(made.series.columns["angle_left"]).all()


def test_strokes_from_pulses() -> None:
    """GIVEN one Hall event per stroke WHEN imported THEN the frequency follows."""
    pulses = np.interp(np.arange(0.0, STROKES[-1]), STROKES, TIME)
    series = Series("hall_event", np.rint(pulses * 1e6).astype(np.int64), {"edge": np.ones(len(pulses))}, {})
    found = wing_topic({"hall_event": series}, None, WingSource())
    assert found is not None and frequency_error(found[0]) < 0.05


def test_strokes_from_the_acceleration_if_nothing_else_is_valid() -> None:
    """GIVEN a wing phase that was never valid WHEN imported THEN the acceleration's fundamental is taken."""
    phase = {"phase": STROKES % 1.0, "valid": np.zeros(len(TIME), np.uint8)}
    found = wing_topic({"wing_phase": Series("wing_phase", TIME_US, phase, {})}, imu(), WingSource())
    assert found is not None
    made, text = found
    assert "acceleration" in text and frequency_error(made) < 0.06
    assert made.series.columns["flapping"].mean() > 0.95


def test_no_strokes_without_flapping_and_one_line_for_a_wrong_choice() -> None:
    """GIVEN a glider, or a topic that does not exist WHEN imported THEN nothing, or one line."""
    glide = imu()
    glide = glide._replace(
        series=glide.series._replace(columns={**glide.series.columns, "accel_z": -9.8 + 0.0 * TIME})
    )
    assert wing_topic({}, glide, WingSource()) is None
    with pytest.raises(InputError, match="there is no topic rpm2"):
        wing_topic({"rpm": Series("rpm", TIME_US, {"rpm": FREQUENCY}, {})}, None, WingSource("rpm2"))
    with pytest.raises(InputError, match="no column"):
        wing_topic({"x": Series("x", TIME_US, {"y": FREQUENCY}, {})}, None, WingSource("x"))

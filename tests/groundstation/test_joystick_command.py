"""``wingbeat gcs URL joystick``: options, lines, screen, orders of the buttons, loss of the device."""

from __future__ import annotations

import asyncio
import io
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fake_joystick import CENTERED, RADIO, SETTINGS, FakeBackend, FakeDevice
from lossy_vehicle import LossyVehicle, on_the_air
from ports import free_port
from textual.pilot import Pilot

from avionics.link.dialect import mavlink
from groundstation.command import gcs_joystick
from groundstation.command.main import main
from groundstation.joystick.actions import Action, ActionKind, Assignments
from groundstation.joystick.control import DeviceState, ManualControl
from groundstation.joystick.device import DeviceInfo
from groundstation.joystick.settings import Settings
from groundstation.joystick.settings_text import save_settings
from groundstation.link.connection import Connection
from groundstation.link.station import Station
from groundstation.screen.joystick_monitor import JoystickMonitor
from groundstation.views.joystick import centered_bar

Capture = pytest.CaptureFixture[str]
PAD = DeviceInfo("Pad", "0" * 31 + "1", 4, 10)
BUTTONS = {
    0: Action(ActionKind.ARM),
    1: Action(ActionKind.MODE, "LOITER"),
    2: Action(ActionKind.MODE, "DANCE"),
    3: Action(ActionKind.DISARM),
    4: Action(ActionKind.RETURN),
    5: Action(ActionKind.LAND),
    6: Action(ActionKind.KILL),
    7: Action(ActionKind.NONE),
}
WITH_BUTTONS = SETTINGS._replace(assignments=Assignments(BUTTONS))


@pytest.fixture
def device() -> FakeDevice:
    return FakeDevice()


@pytest.fixture
def backend(device: FakeDevice, monkeypatch: pytest.MonkeyPatch) -> FakeBackend:
    """A computer with one transmitter."""
    backend = FakeBackend(device)
    monkeypatch.setattr(gcs_joystick, "open_backend", lambda: backend)
    return backend


@pytest.fixture
def config(tmp_path: Path) -> str:
    """A settings file of the transmitter."""
    path = tmp_path / "joystick.toml"
    save_settings(path, [WITH_BUTTONS])
    return str(path)


def joystick(url: str, *words: str) -> int:
    return main(["gcs", url, "--no-record", "joystick", *words])


def refuse(words: tuple[str, ...], capsys: Capture) -> str:
    """Run a command line that is refused before a vehicle is contacted; return its line."""
    assert joystick("udpout:127.0.0.1:9", *words) == 2
    captured = capsys.readouterr()
    assert captured.out == "" and captured.err.count("\n") == 1
    return captured.err


# --- options --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("words", [("--list",), ("--calibrate",), ()])
def test_without_pygame_one_line_says_how_to_install_it(
    words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capsys: Capture, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "pygame", None)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    line = refuse(words, capsys)
    assert "the joystick needs pygame-ce, which is not installed" in line and "-m pip install" in line


def test_list_shows_every_device(backend: FakeBackend, config: str, capsys: Capture) -> None:
    backend.connected.append(FakeDevice(PAD))
    assert joystick("udpout:127.0.0.1:9", "--list", "--config", config) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1].split() == ["0", *RADIO.name.split(), RADIO.guid, "8", "24", "yes"]
    assert lines[2].split() == ["1", "Pad", PAD.guid, "4", "10", "none"]
    assert joystick("udpout:127.0.0.1:9", "--list", "--config", config, "--json") == 0
    devices = json.loads(capsys.readouterr().out)["devices"]
    assert [(one["number"], one["name"], one["settings"]) for one in devices] == [
        (0, RADIO.name, True),
        (1, "Pad", False),
    ]
    assert backend.closed


def test_list_and_calibrate_need_no_url(backend: FakeBackend, config: str, capsys: Capture) -> None:
    """GIVEN no URL WHEN devices are listed THEN they are; flying without one is refused in one line."""
    assert main(["gcs", "--timeout", "3", "joystick", "--config", config, "--list", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["devices"]
    assert main(["gcs", "joystick", "--config", config]) == 2
    assert "needs the URL of a vehicle" in capsys.readouterr().err


def test_list_without_a_device(backend: FakeBackend, config: str, capsys: Capture) -> None:
    backend.connected.clear()
    assert joystick("udpout:127.0.0.1:9", "--list", "--config", config) == 0
    assert capsys.readouterr().out.startswith("no joystick is connected")
    assert refuse(("--config", config), capsys).startswith("wingbeat: no joystick is connected")


def test_device_is_chosen_by_number_name_or_guid(backend: FakeBackend, config: str, capsys: Capture) -> None:
    backend.connected += [FakeDevice(PAD), FakeDevice(PAD._replace(name="Pad Pro", guid="2" * 32))]
    for choice in ("1", PAD.guid):
        line = refuse(("--config", config, "--device", choice), capsys)
        assert f"joystick Pad has no settings in {config}: calibrate it with wingbeat gcs" in line
    assert "joystick Pad Pro has no settings" in refuse(("--config", config, "--device", "pad pro"), capsys)
    for choice, count in (("pad", 2), ("wheel", 0)):
        line = refuse(("--config", config, "--device", choice), capsys)
        assert f"--device {choice} matches {count} of them; choose with --device: 0 {RADIO.name}, 1 Pad," in line


def test_several_devices_without_settings_have_to_be_chosen(
    backend: FakeBackend, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    backend.connected.append(FakeDevice(PAD))
    assert "several joysticks are connected; choose with --device" in refuse((), capsys)


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (("--list", "--calibrate"), "--list and --calibrate exclude each other"),
        (("--calibrate", "--json"), "--calibrate is a dialog on the terminal"),
        (("--rate", "0.5"), "0.5 is outside 1 to 100 Hz"),
        (("--rate", "fast"), "fast is not a number"),
        (("--config", "no_such.toml"), "cannot read joystick settings no_such.toml: there is no such file"),
    ],
)
@pytest.mark.usefixtures("backend")
def test_bad_options_are_one_line(words: tuple[str, ...], problem: str, capsys: Capture) -> None:
    assert problem in refuse(words, capsys)


def test_calibration_ends_with_its_input(
    backend: FakeBackend, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    file = tmp_path / "joystick.toml"
    assert joystick("udpout:127.0.0.1:9", "--calibrate", "--config", str(file)) == 2
    assert "the input ended before the calibration was complete" in capsys.readouterr().err
    assert not file.exists() and backend.closed


def test_calibration_writes_the_settings(
    backend: FakeBackend, config: str, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    calibrated = SETTINGS._replace(yaw=None)
    monkeypatch.setattr(gcs_joystick, "calibrate", lambda device, terminal, previous: calibrated)
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    assert joystick("udpout:127.0.0.1:9", "--calibrate", "--config", config) == 0
    assert f"settings of {RADIO.name} written to {config} (before: {config}.bak)" in capsys.readouterr().out
    assert gcs_joystick.load_settings(Path(config)) == (calibrated,)


# --- flights --------------------------------------------------------------------------------------------


class Recorder(LossyVehicle):
    """Keeps the sticks that it receives."""

    def __init__(self) -> None:
        super().__init__()
        self.sticks: list[tuple[int, ...]] = []
        self.stations: set[int] = set()

    def _manual_control(self, message: Any) -> list[Any]:
        self.sticks.append((message.target, message.x, message.y, message.z, message.r))
        return []

    def _heartbeat(self, message: Any) -> list[Any]:
        self.stations.add(message.type)
        return []


def test_sticks_are_sent_as_a_ground_station(
    backend: FakeBackend, device: FakeDevice, config: str, capsys: Capture
) -> None:
    device.axes[:4] = [0.5, -1.0, 0.5, 0.25]
    vehicle = Recorder()
    with on_the_air(vehicle) as url:
        assert joystick(url, "--config", config, "--duration", "0.5", "--rate", "40") == 0
    assert set(vehicle.sticks) == {(1, 1000, 500, 750, 250)}
    assert vehicle.stations == {mavlink.MAV_TYPE_GCS}
    lines = capsys.readouterr().out.splitlines()
    assert "roll 50 %  pitch -100 %  yaw 25 %  throttle 75 %" in lines[0] and "disarmed" in lines[0]


def test_json_is_an_object_a_line(backend: FakeBackend, config: str, capsys: Capture) -> None:
    with on_the_air(Recorder()) as url:
        assert joystick(url, "--config", config, "--duration", "0.3", "--json") == 0
    record = json.loads(capsys.readouterr().out)
    assert record["device"] == RADIO.name and record["state"] == "active" and record["armed"] is False
    assert record["sticks"] == {"roll": 0.0, "pitch": 0.0, "yaw": 0.0, "throttle": 0.0}


def test_no_vehicle_is_one_line(backend: FakeBackend, config: str, capsys: Capture) -> None:
    url = f"udpout:127.0.0.1:{free_port()}"
    assert main(["gcs", url, "--timeout", "0.2", "--no-record", "joystick", "--config", config]) == 2
    assert "no vehicle on" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("button", "mode", "armed", "note"),
    [
        (0, 65536, True, "armed"),
        (1, 4 << 16 | 3 << 24, False, "mode LOITER"),
        (2, 65536, False, "the vehicle has no mode 'DANCE'; it has"),
        (4, 4 << 16 | 5 << 24, False, "returning"),
        (5, 4 << 16 | 6 << 24, False, "landing"),
    ],
)
def test_button_is_an_order(button: int, mode: int, armed: bool, note: str, device: FakeDevice) -> None:
    vehicle = Recorder()
    with on_the_air(vehicle) as url:
        assert press(url, device, button).startswith(note)
    assert (vehicle.custom_mode, vehicle.armed) == (mode, armed)


def test_arming_is_denied_above_zero_throttle(device: FakeDevice) -> None:
    device.axes[2] = -0.5
    vehicle = Recorder()
    with on_the_air(vehicle) as url:
        assert press(url, device, 0) == "not armed: the throttle is not at zero"
    assert not vehicle.armed


def press(url: str, device: FakeDevice, button: int) -> str:
    """Press a button once a vehicle is connected; return the note of what became of it, within ten seconds."""
    connection = Connection(url, stays=True)
    try:
        station = Station(connection)
        control = ManualControl(station, FakeBackend(device), device, WITH_BUTTONS)
        deadline = connection.now() + 10.0
        while not station.picture().notes:
            assert connection.now() < deadline
            control.poll()
            if connection.state.system is not None:
                device.pressed.add(button)
            connection.wait()
        return station.picture().notes[0].text
    finally:
        connection.close()


class Bench:
    """A `ManualControl` on a link without a vehicle, with a clock of the test."""

    def __init__(self, device: FakeDevice, settings: Settings = WITH_BUTTONS) -> None:
        self.time = 0.0
        self.sent: list[Any] = []
        clock = lambda: self.time  # noqa: E731
        self.connection = Connection(f"udpout:127.0.0.1:{free_port()}", stays=True, clock=clock)
        self.connection.overhear(lambda arrival: None, self._keep)
        self.control = ManualControl(Station(self.connection, clock), FakeBackend(device), device, settings)

    def _keep(self, message: Any) -> None:
        if message.get_type() == "MANUAL_CONTROL":
            self.sent.append(message)

    def run(self, duration: float) -> int:
        """Poll every 10 ms; return the number of messages sent."""
        before = len(self.sent)
        for _ in range(round(100 * duration)):
            self.time += 0.01
            self.control.poll()
        return len(self.sent) - before

    def notes(self) -> list[str]:
        return [note.text for note in self.control.station.picture().notes]


@pytest.fixture
def bench(device: FakeDevice) -> Iterator[Bench]:
    bench = Bench(device)
    yield bench
    bench.connection.close()


def test_sticks_are_sent_at_their_rate(bench: Bench) -> None:
    assert bench.run(4.0) == pytest.approx(100, abs=1)


def test_lost_device_stops_the_sticks_until_it_returns(bench: Bench, device: FakeDevice) -> None:
    """GIVEN an active device WHEN it is disconnected THEN nothing is sent, neither a last nor a centered stick."""
    bench.run(1.0)
    device.connected = False
    assert bench.run(5.0) == 0
    status = bench.control.status
    assert (status.state, status.sticks) == (DeviceState.DISCONNECTED, None)
    device.connected = True
    device.pressed = {0}
    assert bench.run(2.0) >= 35
    assert bench.control.status.state is DeviceState.ACTIVE
    name = RADIO.name
    assert bench.notes() == [f"joystick {name} disconnected: no sticks are sent", f"joystick {name} reconnected"]


def test_device_of_another_model_does_not_take_over(bench: Bench, device: FakeDevice) -> None:
    device.connected = False
    bench.run(0.1)
    device.info, device.connected = PAD, True
    assert bench.run(2.0) == 0


def test_nothing_is_sent_before_the_throttle_is_known(bench: Bench, device: FakeDevice) -> None:
    """Some systems report 0, half throttle, for an axis that has not moved yet."""
    device.axes = [0.0] * len(CENTERED)
    assert bench.run(1.0) == 0 and bench.control.status.state is DeviceState.WAITING
    device.axes[2] = -0.9
    assert bench.run(1.0) > 20 and bench.sent[0].z == 50


def test_orders_without_a_vehicle_are_noted(bench: Bench, device: FakeDevice) -> None:
    bench.run(0.1)
    device.pressed = {3, 7}
    bench.run(0.1)
    assert bench.notes() == ["disarm: no vehicle on the link"]


@pytest.mark.parametrize("value", [-1.0, -0.5, 0.0, 0.5, 1.0])
def test_bar_grows_from_the_middle(value: float) -> None:
    bar = centered_bar(value, 21)
    assert len(bar) == 21 and bar[10] == "┼"
    assert (bar[:10].count("━"), bar[11:].count("━")) == (round(max(-value, 0.0) * 10), round(max(value, 0.0) * 10))


@pytest.mark.parametrize("size", [(120, 40), (80, 24)])
def test_screen_shows_sticks_mode_and_device(size: tuple[int, int], device: FakeDevice) -> None:
    device.axes[0] = 0.6

    async def until(pilot: Pilot[None], *texts: str) -> None:
        """Wait until all texts are on the screen, for ten seconds at most."""
        for _ in range(500):
            await pilot.pause(0.02)
            strips = pilot.app.screen._compositor.render_strips()
            shown = "\n".join("".join(part.text for part in strip) for strip in strips)
            if all(text in shown for text in texts):
                return
        raise AssertionError(f"{texts} not in\n{shown}")

    async def run(url: str) -> None:
        connection = Connection(url, stays=True)
        control = ManualControl(Station(connection), FakeBackend(device), device, WITH_BUTTONS)
        try:
            async with JoystickMonitor(control).run_test(size=size) as pilot:
                await until(pilot, "roll", "60 %", "sticks are sent", "disarmed", "MANUAL", "% lost", "Quit")
                device.connected = False
                await until(pilot, "disconnected: no sticks are sent")
        finally:
            connection.close()

    with on_the_air(Recorder()) as url:
        asyncio.run(run(url))

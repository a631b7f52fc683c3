"""``wingbeat gcs URL joystick``: fly with a joystick, a gamepad or an RC transmitter on USB."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from groundstation.command import options
from groundstation.command.gcs_monitor import run_screen
from groundstation.command.gcs_session import Session, Verb
from groundstation.joystick.control import DEFAULT_RATE, ManualControl
from groundstation.joystick.device import Device, DeviceBackend, DeviceInfo
from groundstation.joystick.dialog import StandardTerminal, calibrate
from groundstation.joystick.pygame_device import PygameBackend
from groundstation.joystick.settings import Settings, check_capabilities, default_path, find_settings, load_settings
from groundstation.joystick.settings_text import merge, save_settings
from groundstation.link.station import Station
from groundstation.views import joystick as views
from groundstation.views.json_document import print_document
from groundstation.views.terminal import open_console
from wingbeat.errors import InputError

VERB = "joystick"
MAX_RATE = 100.0
"""Hz; of MANUAL_CONTROL: link and screen are polled at this rate"""
JSON_KEYS = {
    VERB: "one object a line: time, device, state, sticks {roll, pitch, yaw, throttle} (-1 to 1, 0 to 1; null"
    " while none are sent), sent, mode, armed, silence (s); --list: devices, list of {number, name, guid, axes,"
    " buttons, settings (whether it has some)}",
}


class Setup(NamedTuple):
    """An open device with its settings."""

    backend: DeviceBackend
    device: Device
    settings: Settings


def add_verbs(verbs: Any) -> None:
    """Add the verb."""
    parser = verbs.add_parser(VERB, help="fly with a joystick, gamepad or RC transmitter on USB")
    parser.add_argument("--list", action="store_true", help="list the connected devices; no vehicle is needed")
    parser.add_argument(
        "--calibrate", action="store_true", help="calibrate a device, assign sticks and buttons; no vehicle is needed"
    )
    parser.add_argument("--device", metavar="N|NAME|GUID", help="device to use, as --list shows it")
    parser.add_argument(
        "--config", type=Path, metavar="FILE", help=f"settings file (default: {default_path().name} of the user)"
    )
    parser.add_argument(
        "--rate",
        type=_rate,
        default=DEFAULT_RATE,
        metavar="HZ",
        help=f"rate of MANUAL_CONTROL (default: {DEFAULT_RATE:g})",
    )
    parser.add_argument(
        "--duration",
        type=options.positive,
        default=math.inf,
        metavar="S",
        help="print lines instead of the screen and end after this time",
    )


def _rate(text: str) -> float:
    value = options.positive(text)
    if not 1.0 <= value <= MAX_RATE:
        raise argparse.ArgumentTypeError(f"{text} is outside 1 to {MAX_RATE:g} Hz")
    return value


def with_url(arguments: Sequence[str]) -> list[str]:
    """Return ``arguments`` with an empty URL if ``joystick`` has none."""
    if VERB not in arguments:
        return list(arguments)
    place = arguments.index(VERB)
    has_url = any(":" in each for each in arguments[:place])
    return list(arguments) if has_url else [*arguments[:place], "", *arguments[place:]]


def is_offline(chosen: argparse.Namespace) -> bool:
    """Return whether the verb needs no vehicle."""
    return chosen.verb in VERBS and (chosen.list or chosen.calibrate)


def prepare(chosen: argparse.Namespace) -> None:
    """Read the settings and open the device before the vehicle is contacted.

    Raises:
        InputError: options that exclude each other, settings that cannot be used, pygame-ce is not installed, no
            device, or one without settings.
    """
    if chosen.verb not in VERBS:
        return
    if chosen.list and chosen.calibrate:
        raise InputError("--list and --calibrate exclude each other")
    if chosen.calibrate and chosen.json:
        raise InputError("--calibrate is a dialog on the terminal, without --json")
    creates = chosen.list or chosen.calibrate or chosen.config is None
    chosen.config = chosen.config or default_path()
    chosen.entries = load_settings(chosen.config, must_exist=not creates)
    if is_offline(chosen):
        return
    if not chosen.url:
        raise InputError("wingbeat gcs URL joystick needs the URL of a vehicle; without one: --list or --calibrate")
    backend = open_backend()
    number, info = _choose(chosen, backend.devices())
    settings = find_settings(chosen.entries, info)
    if settings is None:
        raise InputError(
            f"joystick {info.name} has no settings in {chosen.config}: calibrate it with"
            " wingbeat gcs joystick --calibrate"
        )
    check_capabilities(settings, info)
    chosen.setup = Setup(backend, _open(backend, number, info), settings)


def open_backend() -> DeviceBackend:
    """Open the access to the devices of this computer.

    Raises:
        InputError: pygame-ce is not installed.
    """
    return PygameBackend()


def _open(backend: DeviceBackend, number: int, info: DeviceInfo) -> Device:
    device = backend.open(number)
    if device is None:
        raise InputError(f"joystick {info.name} cannot be opened: it is disconnected or not readable")
    return device


def _choose(chosen: argparse.Namespace, devices: tuple[DeviceInfo, ...]) -> tuple[int, DeviceInfo]:
    """Return the device that ``--device`` names; without it the only one, or the only one that has settings.

    Raises:
        InputError: there is none, or more than one.
    """
    if not devices:
        raise InputError("no joystick is connected (or /dev/input is not readable)")
    listed = list(enumerate(devices))
    choice = chosen.device
    if choice is not None:
        matching = [(n, one) for n, one in listed if choice in (str(n), one.guid) or _is_named(one, choice)]
    else:
        configured = [(n, one) for n, one in listed if find_settings(chosen.entries, one) is not None]
        matching = configured if len(listed) > 1 and configured else listed
    if len(matching) != 1:
        names = ", ".join(f"{n} {one.name}" for n, one in listed)
        found = f"--device {choice} matches {len(matching)} of them"
        problem = "several joysticks are connected" if choice is None else found
        raise InputError(f"{problem}; choose with --device: {names}")
    return matching[0]


def _is_named(info: DeviceInfo, choice: str) -> bool:
    return len(choice) > 1 and choice.lower() in info.name.lower()


def run_offline(chosen: argparse.Namespace) -> int:
    """List the devices, or calibrate one and write its settings.

    Raises:
        InputError: no device, pygame-ce is not installed, the calibration failed, or the file cannot be written.
    """
    backend = open_backend()
    try:
        if chosen.list:
            _list(chosen, backend.devices())
        else:
            _calibrate(chosen, backend)
    finally:
        backend.close()
    return 0


def _list(chosen: argparse.Namespace, devices: tuple[DeviceInfo, ...]) -> None:
    configured = tuple(find_settings(chosen.entries, info) is not None for info in devices)
    if chosen.json:
        records = [
            {"number": number, **info._asdict(), "settings": known}
            for number, (info, known) in enumerate(zip(devices, configured, strict=True))
        ]
        print_document({"devices": records})
    elif devices:
        views.print_devices(devices, configured)
    else:
        print("no joystick is connected (or /dev/input is not readable)")


def _calibrate(chosen: argparse.Namespace, backend: DeviceBackend) -> None:
    number, info = _choose(chosen, backend.devices())
    device = _open(backend, number, info)
    settings = calibrate(device, StandardTerminal(), find_settings(chosen.entries, info))
    copy = save_settings(chosen.config, merge(chosen.entries, settings))
    print(f"settings of {info.name} written to {chosen.config}" + (f" (before: {copy})" if copy else ""))


def fly(session: Session) -> int:
    """Send the sticks and run the button actions; show a screen on a terminal, else one line or object a second."""
    setup: Setup = session.chosen.setup
    station = Station(session.connection)
    if session.recording is not None:
        recording = session.recording
        station.recording = lambda: recording.path
    control = ManualControl(station, setup.backend, setup.device, setup.settings, session.chosen.rate)
    try:
        if session.json or math.isfinite(session.chosen.duration) or not open_console().is_terminal:
            _print_lines(session, control)
            return 0
        # The import of Textual takes a third of a second.
        from groundstation.screen.joystick_monitor import JoystickMonitor

        return run_screen(JoystickMonitor(control))
    finally:
        setup.backend.close()


def _print_lines(session: Session, control: ManualControl) -> None:
    connection = session.connection
    lines = views.ControlLines(control.station, session.json, connection.now())
    end = connection.now() + session.chosen.duration
    while connection.now() < end:
        if not control.poll():
            connection.wait()
        lines.show(control.status, connection.now())


VERBS: dict[str, Verb] = {VERB: fly}

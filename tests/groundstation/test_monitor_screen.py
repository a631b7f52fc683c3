"""The live screen, driven by textual's pilot against a scripted vehicle on a UDP port."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest
from lossy_vehicle import LossyVehicle, on_the_air
from textual.pilot import Pilot
from textual.widgets import DataTable, Input, OptionList, TabbedContent

from avionics.link.dialect import mavlink
from groundstation.command.main import main
from groundstation.link.connection import Connection
from groundstation.link.station import NOTES_KEPT, Station
from groundstation.screen.dialogs import Confirmation
from groundstation.screen.monitor import Monitor
from groundstation.screen.plots_tab import MOST, Plot, PlotsTab

Script = Callable[[Pilot[None], Station, LossyVehicle], Awaitable[None]]


class Flying(LossyVehicle):
    """Says an attitude with every heartbeat, and a warning once."""

    def answers(self, message: object) -> list[object]:
        spoken = mavlink.MAVLink_attitude_message(len(self.requests) + 1, 0.2, 0.1, 1.0, 0, 0, 0)
        return [*super().answers(message), spoken, mavlink.MAVLink_statustext_message(4, b"wind is strong")]


def on_screen(script: Script, size: tuple[int, int] = (120, 36), plots: tuple[str, ...] = ()) -> LossyVehicle:
    """Run ``script`` on the screen of a station that hears a vehicle."""
    vehicle = Flying()

    async def run(url: str) -> None:
        connection = Connection(url, stays=True)
        station = Station(connection)
        app = Monitor(station, plots)
        try:
            async with app.run_test(size=size) as pilot:
                await until(pilot, lambda: connection.state.roll is not None and bool(app.query(PlotsTab)))
                await script(pilot, station, vehicle)
        finally:
            connection.close()

    with on_the_air(vehicle) as url:
        asyncio.run(run(url))
    return vehicle


async def until(pilot: Pilot[None], true: Callable[[], bool]) -> None:
    """Let the screen live until something is true, for ten seconds at most."""
    for _ in range(500):
        if true():
            return
        await pilot.pause(0.02)
    raise AssertionError(f"never came true: {true}")


def shown(pilot: Pilot[None]) -> str:
    """Everything that stands on the screen."""
    strips = pilot.app.screen._compositor.render_strips()
    return "\n".join("".join(segment.text for segment in strip) for strip in strips)


async def draw(pilot: Pilot[None]) -> str:
    app = pilot.app
    assert isinstance(app, Monitor)
    app.draw()
    await pilot.pause()
    return shown(pilot)


@pytest.mark.parametrize(
    ("size", "visible"),
    [((80, 24), False), ((120, 40), True), pytest.param((200, 60), True, marks=pytest.mark.validate)],
)
def test_a_tall_window_shows_the_track_and_the_wings(size: tuple[int, int], visible: bool) -> None:
    async def script(pilot: Pilot[None], station: Station, vehicle: LossyVehicle) -> None:
        text = await draw(pilot)
        assert ("north up" in text) is visible and ("no wing angles" in text) is visible
        lines = text.splitlines()
        assert len(lines) == size[1] and all(len(line.rstrip()) > 0.5 * size[0] for line in lines[2:-1])

    on_screen(script, size)


@pytest.mark.parametrize("size", [(80, 24), pytest.param((132, 40), marks=pytest.mark.validate), (60, 16)])
def test_the_flight_is_shown_in_any_window(size: tuple[int, int]) -> None:
    async def script(pilot: Pilot[None], station: Station, vehicle: LossyVehicle) -> None:
        text = await draw(pilot)
        assert "flapping wing 1" in text and "disarmed" in text and "airspeed" in text
        if size[0] >= 80:
            assert "wind is strong" in text and "loss" in text and "Quit" in text

    on_screen(script, size)


def test_arming_asks_first_and_only_a_yes_arms() -> None:
    async def script(pilot: Pilot[None], station: Station, vehicle: LossyVehicle) -> None:
        await pilot.press("a")
        await until(pilot, lambda: isinstance(pilot.app.screen, Confirmation))
        await pilot.press("enter", "n")
        await until(pilot, lambda: not isinstance(pilot.app.screen, Confirmation))
        assert not vehicle.armed and not station.picture().notes
        await pilot.press("a", "y")
        await until(pilot, lambda: vehicle.armed and bool(station.picture().notes))
        assert station.picture().notes[-1].text == "armed"

    on_screen(script)


def test_what_became_of_a_command_is_announced_however_many_there_were() -> None:
    async def script(pilot: Pilot[None], station: Station, vehicle: LossyVehicle) -> None:
        for number in range(NOTES_KEPT + 5):
            station.note(f"order {number}")
        await draw(pilot)
        pilot.app.clear_notifications()
        station.note("the last order", failed=True)
        await draw(pilot)
        assert [toast.message for toast in pilot.app._notifications] == ["the last order"]

    on_screen(script)


def test_killing_is_forced_and_confirmed() -> None:
    forced = []

    async def script(pilot: Pilot[None], station: Station, vehicle: LossyVehicle) -> None:
        answer = vehicle._command_long

        def remember(message: object) -> list[object]:
            forced.append((message.command, message.param1, message.param2))  # type: ignore[attr-defined]
            return answer(message)

        vehicle._command_long = remember  # type: ignore[method-assign]
        await pilot.press("K")
        await until(pilot, lambda: isinstance(pilot.app.screen, Confirmation))
        assert not [entry for entry in forced if entry[0] == mavlink.MAV_CMD_COMPONENT_ARM_DISARM]
        await pilot.press("y")
        await until(pilot, lambda: (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, 21196.0) in forced)

    on_screen(script)


def test_a_mode_is_chosen_from_the_list() -> None:
    async def script(pilot: Pilot[None], station: Station, vehicle: LossyVehicle) -> None:
        await pilot.press("m")
        await until(pilot, lambda: bool(pilot.app.screen.query(OptionList)))
        choice = pilot.app.screen.query_one(OptionList)
        names = [str(option.prompt) for option in choice.options]
        assert names[choice.highlighted or 0] == "MANUAL"
        choice.highlighted = names.index("ALTITUDE_HOLD")
        await pilot.press("enter")
        await until(pilot, lambda: vehicle.custom_mode == 2 << 16)

    on_screen(script)


@pytest.mark.parametrize(("key", "command"), [("r", "MAV_CMD_NAV_RETURN_TO_LAUNCH"), ("l", "MAV_CMD_NAV_LAND")])
def test_a_refusal_is_told_in_the_vehicles_words(key: str, command: str) -> None:
    async def script(pilot: Pilot[None], station: Station, vehicle: LossyVehicle) -> None:
        vehicle.results[getattr(mavlink, command)] = mavlink.MAV_RESULT_DENIED
        vehicle.reports = ["not in flight"]
        await pilot.press(key)
        await until(pilot, lambda: bool(station.picture().notes))
        note = station.picture().notes[-1]
        assert note.failed and " denied: " in note.text and "MAV" not in note.text
        await until(pilot, lambda: note.text in shown(pilot))

    on_screen(script)


def test_from_a_message_to_its_field_to_its_plot() -> None:
    async def script(pilot: Pilot[None], station: Station, vehicle: LossyVehicle) -> None:
        await pilot.press("2")
        kinds, fields = (pilot.app.query_one(f"#{name}", DataTable) for name in ("kinds", "fields"))
        await until(pilot, lambda: kinds.row_count > 1)
        rows = [str(kinds.get_row_at(number)[0]) for number in range(kinds.row_count)]
        assert {"ATTITUDE", "HEARTBEAT", "STATUSTEXT"} <= set(rows)
        kinds.move_cursor(row=rows.index("ATTITUDE"))
        await until(pilot, lambda: fields.row_count == 7)
        await pilot.press("enter")
        fields.move_cursor(row=2)
        await pilot.press("enter")
        await until(pilot, lambda: len(pilot.app.query(Plot)) == 1)
        assert pilot.app.query_one(TabbedContent).active == "plots"
        assert pilot.app.query_one(Plot).field.path == "ATTITUDE.pitch"
        await until(pilot, lambda: "ATTITUDE.pitch  0.1 rad" in shown(pilot))

    on_screen(script)


def test_a_field_is_named_by_hand_and_a_wrong_name_is_refused() -> None:
    async def script(pilot: Pilot[None], station: Station, vehicle: LossyVehicle) -> None:
        await pilot.press("p")
        line = pilot.app.query_one(Input)
        await until(pilot, lambda: line.has_focus)
        line.value = "attitude.pich"
        await pilot.press("enter")
        await pilot.pause()
        assert not pilot.app.query(Plot)
        for number, name in enumerate(("roll", "pitch", "yaw", "rollspeed", "yawspeed")):
            await pilot.press("p")
            line.value = f"attitude.{name}"
            await pilot.press("enter")
            expected = min(number + 1, MOST)
            await until(pilot, lambda target=expected: len(pilot.app.query(Plot)) == target)
        # Letters are typed into the line, and are keys again behind it.
        await pilot.press("x")
        await until(pilot, lambda: len(pilot.app.query(Plot)) == MOST - 1)

    on_screen(script)


def test_plots_of_the_command_line_are_there_at_once() -> None:
    async def script(pilot: Pilot[None], station: Station, vehicle: LossyVehicle) -> None:
        assert [plot.field.path for plot in pilot.app.query(Plot)] == ["ATTITUDE.roll", "ATTITUDE.yaw"]

    on_screen(script, plots=("ATTITUDE.roll", "ATTITUDE.yaw"))


def test_what_cannot_be_plotted_is_refused_before_the_screen(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["gcs", "udpout:127.0.0.1:9", "monitor", "--plot", "ATTITUDE.nothing", "--no-record"]) == 2
    assert capsys.readouterr().err.startswith("wingbeat: ATTITUDE has no field 'nothing'; it has time_boot_ms, roll")

"""A recorded flight over MAVLink, to a stock client."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
from ports import free_port
from pymavlink import mavutil
from replayed import record_flight

from avionics import topics
from groundstation.command import main
from logs.reader import open_log


def test_a_stock_client_sees_the_flight_from_where_it_was_asked_for_and_commands_nothing(
    tmp_path: Path,
) -> None:
    flown, port = record_flight(tmp_path / "flight.mcap"), free_port()
    client = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", source_system=250)
    words = ["replay", str(flown), "--mavlink", f"udpout:127.0.0.1:{port}", "--start", "12", "--speed", "2"]
    codes: list[int] = []
    playing = threading.Thread(target=lambda: codes.append(main.main(words)))
    playing.start()
    assert client.wait_heartbeat(timeout=10.0) is not None
    client.mav.heartbeat_send(6, 8, 0, 0, 4)
    client.arducopter_arm()
    attitudes, refused = [], None
    while playing.is_alive():
        message = client.recv_match(type=["ATTITUDE", "COMMAND_ACK"], blocking=True, timeout=0.2)
        if message is None:
            continue
        if message.get_type() == "COMMAND_ACK":
            refused = message
        else:
            attitudes.append(message)
    playing.join()
    client.close()
    assert codes == [0]
    assert refused is not None and refused.result != mavutil.mavlink.MAV_RESULT_ACCEPTED
    with open_log(flown) as log:
        flight = log.columns(topics.ATTITUDE)
    pitches = dict(zip((flight["time_us"] // 1000).tolist(), flight["pitch"].tolist(), strict=True))
    assert len(attitudes) > 20 and attitudes[0].time_boot_ms >= 11_900
    assert all(each.pitch == pytest.approx(pitches[each.time_boot_ms], abs=1e-6) for each in attitudes)


@pytest.mark.parametrize("extra", [["--json"], ["--set", "pitch.damping=0.1"], ["--end", "3"]])
def test_a_player_has_no_comparison(extra: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main.main(["replay", "flight.mcap", "--mavlink", "udpout:127.0.0.1:1", *extra]) == 2
    assert "do not apply to --mavlink" in capsys.readouterr().err

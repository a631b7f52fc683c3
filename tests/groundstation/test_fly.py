"""``wingbeat fly``: two processes, one log; stopped on the way; a child that dies."""

from __future__ import annotations

import hashlib
import json
import os
import resource
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from mcap.reader import make_reader

from avionics import topics
from avionics.messages import Mode
from avionics.state import zero
from avionics.vehicles import FOLDER as FLIGHT_FILES
from groundstation.command import fly as fly_command
from groundstation.command import options
from groundstation.command.children import Children
from groundstation.command.main import main
from groundstation.command.recordings import COMPUTER, WORLD, put_right
from groundstation.views.flight_report import missed_line
from logs.attached import simulated_vehicle
from logs.campaigns.campaign import load_campaign
from logs.campaigns.run import order_of
from logs.campaigns.single_flight import Recording, fly_one
from logs.info import summary
from logs.join import join
from logs.names import FAULTS
from logs.new_files import locked_name
from logs.reader import open_log
from logs.recorder import McapRecorder
from logs.scene import LOCATION, SCENE, TRANSFORMS
from sim_bridge.flight.faults import parse_fault
from sim_bridge.topics import STATE
from sim_bridge.vehicles import load_vehicle
from wingbeat.errors import InputError

WINGBEAT = (sys.executable, "-m", "groundstation.command.main")
RECORDED = ("--duration", "10.5", "--json", "--seed", "5")


def fly(folder: Path, *words: str, starter: tuple[str, ...] = ()) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*starter, *WINGBEAT, "fly", "--log", str(folder / "flight.mcap"), *words],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def wait_for(path: Path, size: int, time_limit: float = 90.0) -> None:
    deadline = time.monotonic() + time_limit
    while not (path.exists() and path.stat().st_size > size):
        assert time.monotonic() < deadline, f"{path} did not grow for {time_limit} s"
        time.sleep(0.05)


def children_of(parent: int) -> list[int]:
    stats = [entry / "stat" for entry in Path("/proc").iterdir() if entry.name.isdigit()]
    found = []
    for stat in stats:
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == parent:
            found.append(int(stat.parent.name))
    return found


def is_running(process: int) -> bool:
    """Whether any thread of it is left: its files stay locked until the last one has ended."""
    try:
        threads = [each.read_text() for each in Path(f"/proc/{process}/task").glob("*/stat")]
    except OSError:
        return True  # a thread has just ended: look again
    return any(text.rpartition(")")[2].split()[0] not in "ZX" for text in threads)


class Recorded(NamedTuple):
    """A flight that nobody but the command watched."""

    folder: Path
    code: int
    out: str
    err: str


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    folder = tmp_path_factory.mktemp("recorded")
    flight = fly(folder, *RECORDED)
    out, err = flight.communicate(timeout=180)
    return Recorded(folder, flight.returncode, out, err)


def test_a_flight_is_recorded_summed_up_and_told_as_json(recorded: Recorded) -> None:
    assert (recorded.code, recorded.err) == (0, "")
    document = json.loads(recorded.out)
    told = {
        "log",
        "vehicle",
        "aerodynamics",
        "seed",
        "wind",
        "wind_from",
        "turbulence",
        "vibration",
        "faults",
        "never_injected",
        "sticks",
        "wall_time",
        "speed",
        "incomplete",
        "findings",
    }
    keys = told | {"flight", "identified"}
    assert set(document) == keys
    assert document["aerodynamics"] == "strip_theory" and document["never_injected"] == []
    assert document["vibration"] == 1.0
    assert document["flight"]["against_truth"] is True and document["incomplete"] == []
    assert document["flight"]["launch"] > 3.0 and document["flight"]["energy"] > 0.0
    assert [path.name for path in recorded.folder.iterdir()] == ["flight.mcap"]
    with open_log(recorded.folder / "flight.mcap") as log:
        assert log.complete
        assert {"/truth/state", "/attitude/ahrs", "/system/inputs"} <= set(log.topics)
        for viewer_topic in (TRANSFORMS, SCENE, LOCATION):
            assert log.topics[viewer_topic.name].messages > 5
        assert log.metadata["wingbeat.world"]["seed"] == "5"
        assert log.metadata["wingbeat.world"]["vibration"] == "1.0"
        assert log.metadata["wingbeat.world"]["aerodynamics"] == "strip_theory"
        assert {"avionics_vehicle.toml", "world_vehicle.toml", "mission.json"} <= {a.name for a in log.attachments}
        commands = [json.loads(text.text) for text in log.texts("/system/inputs")]
    assert [(c["kind"], c["time_us"], c["source"]) for c in commands] == [
        ("ARM", 2_000_000, "script"),
        ("SET_MODE", 2_000_000, "script"),
    ]


@pytest.mark.validate
def test_a_flight_with_another_aerodynamic_model_says_so_in_its_log(tmp_path: Path) -> None:
    flight = fly(tmp_path, "--duration", "9", "--json", "--aerodynamics", "blade_element")
    out, err = flight.communicate(timeout=180)
    assert (flight.returncode, err) == (0, "")
    assert json.loads(out)["aerodynamics"] == "blade_element"
    with open_log(tmp_path / "flight.mcap") as log:
        vehicle = simulated_vehicle(log)
        # The file is attached as it is; which of its models was flown stands beside it.
        attached = log.attachment("world_vehicle.toml").decode()
    assert vehicle is not None and vehicle.aerodynamics.model == "blade_element"
    assert attached == load_vehicle("robo_raven_ii_d").text


def test_a_fault_that_came_too_late_is_named() -> None:
    faults = tuple(map(parse_fault, ("gps_lost@30", "gps_lost@30.1", "mag_disturbed@98.5-99", "link_lost@2")))
    assert options.missed(faults, end=30.0) == ("gps_lost@30.1", "mag_disturbed@98.5-99")
    assert missed_line("gps_lost@30.1", 30.0).plain.endswith(
        "gps_lost@30.1 did not occur: the flight ended at 30.0 s"
    )


def payloads(path: Path) -> dict[str, str]:
    """Digest of the bytes of every deterministic topic."""
    digests: dict[str, Any] = {}
    with open_log(path) as log:
        kept = {name for name, topic in log.topics.items() if topic.deterministic}
    with path.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages(topics=kept):
            digests.setdefault(channel.topic, hashlib.sha256()).update(message.data)
    return {name: digest.hexdigest() for name, digest in digests.items()}


def in_one_process(folder: Path, text: str) -> dict[str, str]:
    """Digests as of `payloads`, of the flight that a campaign's file means, without a socket."""
    (folder / "one.toml").write_text(text)
    fly_one(order_of(load_campaign(folder / "one.toml"), 1, Recording(folder / "one.mcap")))
    return payloads(folder / "one.mcap")


def test_the_same_flight_in_one_process_is_the_same_to_the_bit(recorded: Recorded, tmp_path: Path) -> None:
    alone = in_one_process(tmp_path, "seed = 5\n[flight]\nduration = 10.5\n")
    assert alone == payloads(recorded.folder / "flight.mcap")
    assert {topic.name for topic in (STATE, topics.IMU, topics.ACTUATORS, topics.SNAPSHOTS)} <= set(alone)
    with open_log(recorded.folder / "flight.mcap") as log:
        assert len(log.texts(topics.SNAPSHOTS)) == 2, "one of the start and one of what was flown since"


@pytest.mark.validate
def test_a_whole_flight_in_gusts_with_failures_is_the_same_to_the_bit_in_one_process(tmp_path: Path) -> None:
    """From the hand to the ground: wind, gusts, every item of the mission, failures that pass and one that stays."""
    air = ("--wind", "2", "--wind-from", "120", "--turbulence", "small_uav_light")
    faults = ("mag_disturbed@30-40", "gps_lost@62-66", "encoder_left_lost@75")
    failing = (word for fault in faults for word in ("--fault", fault))
    flight = fly(tmp_path, "--seed", "7", *air, *failing, "--json")
    out, err = flight.communicate(timeout=300)
    assert (flight.returncode, err, json.loads(out)["never_injected"]) == (0, "", [])
    with open_log(tmp_path / "flight.mcap") as log:
        assert [event.text for event in log.events()][-1] == "touchdown, disarmed"
    text = (
        "seed = 7\n[flight]\nturbulence = 'small_uav_light'\n'wind.speed' = 2.0\n'wind.from_deg' = 120.0\n"
        f"faults = '{' '.join(faults)}'\n"
    )
    assert in_one_process(tmp_path, text) == payloads(tmp_path / "flight.mcap")


STICKS = "time,arm,throttle,roll,mode\n4,1,0,0,0\n8.2,1,1,0,0\n14,1,0.6,0.3,0\n18,1,0.6,0,2\n"


@pytest.mark.validate
def test_a_transmitter_moved_by_a_table_arms_flies_hands_over_and_is_lost(tmp_path: Path) -> None:
    (tmp_path / "sticks.csv").write_text(STICKS)
    flight = fly(tmp_path, "--sticks", "sticks.csv", "--fault", "receiver_lost@22", "--duration", "25", "--json")
    out, err = flight.communicate(timeout=180)
    assert (flight.returncode, err) == (0, "")
    assert json.loads(out)["sticks"] == "sticks.csv"
    with open_log(tmp_path / "flight.mcap") as log:
        said = {event.text: event.time_us * 1e-6 for event in log.events()}
        truth, mode = log.columns("/truth/state"), log.columns("/guidance/navigation")["mode"]
        assert log.attachment("sticks.csv").decode() == STICKS
    text = 'seed = 1\n[flight]\nduration = 25.0\nsticks = "sticks.csv"\nfaults = "receiver_lost@22"\n'
    assert in_one_process(tmp_path, text) == payloads(tmp_path / "flight.mcap")
    assert said["armed"] == pytest.approx(4.0, abs=0.1)
    assert said["mode AUTO"] == pytest.approx(18.0, abs=0.1)
    assert said["failsafe: receiver lost"] == pytest.approx(22.5, abs=0.2)
    assert mode[-1] == Mode.AUTO
    assert truth["down"][0] - truth["down"][-1] > 5.0
    assert not [text for text in said if "arming denied" in text]


def test_a_table_of_sticks_that_cannot_be_flown_starts_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "sticks.csv").write_text("time,flaps\n1,0\n")
    words = ["fly", "--sticks", str(tmp_path / "sticks.csv"), "--log", str(tmp_path / "flight.mcap")]
    assert main(words) == 2
    assert "columns are time and any of roll" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["sticks.csv"]


@pytest.mark.validate
def test_the_same_seed_gives_the_same_bytes_whoever_watches(recorded: Recorded, tmp_path: Path) -> None:
    flight = fly(tmp_path, *RECORDED, "--gcs", "udpout:127.0.0.1:14999")
    assert flight.communicate(timeout=180)[1] == ""
    alone, watched = (payloads(folder / "flight.mcap") for folder in (recorded.folder, tmp_path))
    assert {"/truth/events", "/attitude/ahrs", "/truth/state", "/system/inputs", "/system/events"} <= set(alone)
    assert alone == watched


@pytest.mark.validate
def test_a_vehicle_that_does_not_arm_is_not_thrown(tmp_path: Path) -> None:
    """GIVEN a magnetometer far off WHEN arming is denied THEN it stays in the launcher's hand."""
    bird = tmp_path / "bird"
    bird.mkdir()
    world = load_vehicle("robo_raven_ii_d").text
    calibrated = "hard_iron_sigma_mg = { value = 4.0"
    assert calibrated in world
    (bird / "world.toml").write_text(world.replace(calibrated, "hard_iron_sigma_mg = { value = 400.0"))
    (bird / "avionics.toml").write_text((FLIGHT_FILES / "robo_raven_ii_d.toml").read_text())
    flight = fly(tmp_path, "--vehicle", str(bird), "--duration", "13", "--json")
    out, _ = flight.communicate(timeout=180)
    document = json.loads(out)["flight"]
    assert (flight.returncode, document["launch"], document["airtime"]) == (0, None, None)
    with open_log(tmp_path / "flight.mcap") as log:
        assert not log.columns(topics.NAVIGATION)["stage"].any(), "on the ground from first to last"


def test_ctrl_c_keeps_the_flight_so_far(tmp_path: Path) -> None:
    flight = fly(tmp_path, "--speed", "1")
    wait_for(tmp_path / "flight.world.mcap", 100_000)
    flight.send_signal(signal.SIGINT)
    _, err = flight.communicate(timeout=60)
    assert flight.returncode == 130
    assert err == f"stopped; recorded so far: {tmp_path / 'flight.mcap'}\n"
    with open_log(tmp_path / "flight.mcap") as log:
        assert log.topics["/truth/state"].messages > 0 and log.topics["/attitude/ahrs"].messages > 0


def test_a_flight_stopped_before_its_first_message_is_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = fly_command.check(fly_command.build_parser().parse_args([]))._replace(log=tmp_path / "a.mcap")
    for part in plan.parts:
        McapRecorder(part, start_epoch_ns=0).close()
    fly_command._keep(plan, {})
    assert capsys.readouterr().err == f"stopped; before the first message of the flight: {plan.log}\n"


def test_sigterm_keeps_the_flight_of_a_background_job(tmp_path: Path) -> None:
    """GIVEN a job of a script, which ignores SIGINT WHEN SIGTERM comes THEN one complete recording."""
    flight = fly(tmp_path, "--speed", "1", starter=("sh", "-c", 'trap "" INT HUP; exec "$@"', "sh"))
    wait_for(tmp_path / "flight.avionics.mcap", 100_000)
    flight.send_signal(signal.SIGTERM)
    _, err = flight.communicate(timeout=60)
    assert flight.returncode == 143
    assert err == f"stopped; recorded so far: {tmp_path / 'flight.mcap'}\n"
    assert [path.name for path in tmp_path.iterdir() if not path.name.startswith(".")] == ["flight.mcap"]
    with open_log(tmp_path / "flight.mcap") as log:
        assert log.complete and not log.damage
        assert log.topics["/truth/state"].messages > 0 and log.topics["/attitude/ahrs"].messages > 0


@pytest.mark.skipif(not Path("/proc").exists(), reason="finds the children in /proc")
def test_recover_joins_what_a_killed_flight_left(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN SIGKILL to all three processes THEN log recover repairs and joins, and a missing file names its parts."""
    flight = fly(tmp_path, "--speed", "1")
    file, parts = tmp_path / "flight.mcap", [tmp_path / f"flight{ending}" for ending in (WORLD, COMPUTER)]
    for part in parts:
        wait_for(part, 100_000)
    processes = (flight.pid, *children_of(flight.pid))
    for number in (signal.SIGSTOP, signal.SIGKILL):  # none of them may close its file when it sees another one end
        for process in processes:
            os.kill(process, number)
    flight.communicate(timeout=60)
    deadline = time.monotonic() + 60.0
    while any(is_running(process) for process in processes) and time.monotonic() < deadline:
        time.sleep(0.05)  # a process that ends holds its files for a while
    assert main(["log", "info", str(file)]) == 2
    err = capsys.readouterr().err
    assert "flight.world.mcap and flight.avionics.mcap exist: wingbeat log recover" in err and err.count("\n") == 1
    assert main(["log", "recover", str(file), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["joined"] == [str(part) for part in parts]
    assert len(document["damage"]) >= 2 and not any(part.exists() for part in parts)
    with open_log(file) as log:
        assert log.complete and not log.damage
        assert log.topics["/truth/state"].messages > 0 and log.topics["/attitude/ahrs"].messages > 0
    assert main(["log", "recover", str(tmp_path / "nothing.mcap")]) == 2
    assert "No such file" in capsys.readouterr().err


@pytest.mark.validate
@pytest.mark.skipif(not Path("/proc").exists(), reason="finds the children in /proc")
def test_a_recording_that_ended_before_the_flight_is_told_and_kept(tmp_path: Path) -> None:
    """GIVEN a disk that takes no more of the world's recording THEN the flight goes on, and says so."""
    flight = fly(tmp_path, "--json", "--duration", "5")
    wait_for(tmp_path / "flight.world.mcap", 1)
    world, _ = sorted(children_of(flight.pid))
    resource.prlimit(world, resource.RLIMIT_FSIZE, (100_000, 100_000))
    out, err = flight.communicate(timeout=60)
    part = tmp_path / "flight.world.mcap"
    assert flight.returncode == 0 and part.stat().st_size <= 100_000
    assert f"recording to {part} ended: File too large" in err and f"a recording ended early: {part}: " in err
    (kept,) = json.loads(out)["incomplete"]
    assert kept == {"path": str(part), "damage": "the file was cut off before its end"}
    with open_log(tmp_path / "flight.mcap") as log:
        assert log.columns("/attitude/ahrs").time[-1] > 4.5 > log.columns("/truth/state").time[-1]
        assert summary(log)["incomplete"] == {part.name: kept["damage"]}


@pytest.mark.validate
@pytest.mark.skipif(not Path("/proc").exists(), reason="finds the children in /proc")
def test_a_child_that_is_killed_ends_the_flight_in_one_line(tmp_path: Path) -> None:
    flight = fly(tmp_path, "--speed", "1")
    wait_for(tmp_path / "flight.world.mcap", 100_000)
    first, second = sorted(children_of(flight.pid))
    os.kill(first, signal.SIGKILL)
    _, err = flight.communicate(timeout=60)
    assert flight.returncode == 1
    assert err.count("\n") == 1 and "the world was ended by signal SIGKILL" in err
    assert "flight.world.mcap" in err and (tmp_path / "flight.world.mcap").exists()
    assert not Path(f"/proc/{second}").exists(), "the other child must not be left behind"


@pytest.mark.skipif(not Path("/proc").exists(), reason="finds the children in /proc")
def test_a_flight_whose_command_is_killed_flies_on_unwatched_no_more(tmp_path: Path) -> None:
    """GIVEN a flight WHEN its command is gone without a word THEN world and flight computer close their files."""
    flight = fly(tmp_path, "--speed", "1")
    parts = [tmp_path / f"flight.{who}.mcap" for who in ("world", "avionics")]
    for part in parts:
        wait_for(part, 20_000)
    left = children_of(flight.pid)
    flight.kill()
    flight.communicate(timeout=60)
    deadline = time.monotonic() + 30.0
    while any(Path(f"/proc/{pid}").exists() for pid in left):
        assert time.monotonic() < deadline, "a child is left"
        time.sleep(0.05)
    for part in parts:
        with open_log(part) as log:
            assert log.complete


def test_what_a_killed_flight_left_in_two_recordings_is_joined_at_the_next_start(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parts = [tmp_path / f"a{ending}" for ending in (WORLD, COMPUTER)]
    for part, topic in zip(parts, (STATE, topics.IMU), strict=True):
        with McapRecorder(part, start_epoch_ns=0) as recorder:
            for tick in range(1, 500):
                recorder.record(topic, zero(topic.message)._replace(time_us=tick * 5000))
    parts[0].write_bytes(parts[0].read_bytes()[:-300])
    put_right(tmp_path)
    assert "repaired" in capsys.readouterr().err and all(part.exists() for part in parts), "it may be about to end"
    for part in parts:
        os.utime(part, (1e9, 1e9))
    put_right(tmp_path)
    assert f"joined two recordings to {tmp_path / 'a.mcap'}" in capsys.readouterr().err
    assert [path.name for path in sorted(tmp_path.glob("*.mcap"))] == ["a.mcap"]
    with open_log(tmp_path / "a.mcap") as log:
        assert {STATE.name, topics.IMU.name} <= set(log.topics)


@pytest.mark.validate
def test_the_launcher_waits_for_arming_with_and_without_a_station(recorded: Recorded, tmp_path: Path) -> None:
    """GIVEN a silent station THEN it is the same flight, and the launcher waits for arming as without one."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", 0))
        flight = fly(tmp_path, *RECORDED, "--gcs", f"udpout:127.0.0.1:{station.getsockname()[1]}")
        _, err = flight.communicate(timeout=180)
    assert (flight.returncode, err) == (0, "")
    with_station, without = (payloads(folder / "flight.mcap") for folder in (tmp_path, recorded.folder))
    assert with_station["/truth/state"] == without["/truth/state"]
    with open_log(tmp_path / "flight.mcap") as log, open_log(recorded.folder / "flight.mcap") as plain:
        said, usual = ([one.text for one in each.events() if one.source == "world"] for each in (log, plain))
    assert said == usual == ["armed: launch in 6 s", "released by the launcher"]


def test_recordings_of_different_flights_are_never_joined(tmp_path: Path) -> None:
    """GIVEN the world of one flight beside the flight computer of another, by the same name THEN each is left."""
    parts = [tmp_path / f"a{ending}" for ending in (WORLD, COMPUTER)]
    for epoch, part in enumerate(parts):
        with McapRecorder(part, start_epoch_ns=epoch + 1) as recorder:
            recorder.record(topics.IMU, zero(topics.IMU.message)._replace(time_us=5000))
    for part in parts:
        os.utime(part, (1e9, 1e9))
    put_right(tmp_path)
    assert sorted(tmp_path.iterdir()) == sorted(parts)
    with pytest.raises(InputError, match="are not of one flight"):
        join(parts, tmp_path / "a.mcap")
    assert sorted(tmp_path.iterdir()) == sorted(parts)


def test_a_flight_whose_name_is_held_is_joined_by_its_own_command(tmp_path: Path) -> None:
    parts = [tmp_path / f"a{ending}" for ending in (WORLD, COMPUTER)]
    for part in parts:
        with McapRecorder(part, start_epoch_ns=1) as recorder:
            recorder.record(topics.IMU, zero(topics.IMU.message)._replace(time_us=5000))
        os.utime(part, (1e9, 1e9))
    with locked_name(tmp_path / "a.mcap") as ours:
        put_right(tmp_path)
        assert ours and all(part.exists() for part in parts)
    put_right(tmp_path)
    assert list(tmp_path.iterdir()) == [tmp_path / "a.mcap"]


@pytest.mark.validate
def test_two_flights_that_begin_in_the_same_second_are_two_logs(tmp_path: Path) -> None:
    """GIVEN the clock stands still WHEN two fly at once THEN each has its own recordings and its own joined log."""
    code = (
        "import sys\nfrom datetime import datetime\nfrom types import SimpleNamespace\nimport logs.names\n"
        "logs.names.datetime = SimpleNamespace(now=lambda: datetime(2026, 11, 21, 13, 15, 0))\n"
        "from groundstation.command.main import main\nsys.exit(main(sys.argv[1:]))"
    )
    words = [sys.executable, "-c", code, "fly", "--duration", "4", "--json", "--seed"]
    path = {"PYTHONPATH": str(Path(__file__).parents[2])}
    both = [
        subprocess.Popen(
            [*words, seed], cwd=tmp_path, env=os.environ | path, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        for seed in ("1", "2")
    ]
    said = [flight.communicate(timeout=180) for flight in both]
    assert [flight.returncode for flight in both] == [0, 0], said
    names = {Path(json.loads(out)["log"]).name: json.loads(out)["seed"] for out, _ in said}
    stem = "robo_raven_ii_d-20261121-131500"
    assert sorted(names) == [f"{stem}-2.mcap", f"{stem}.mcap"]
    assert sorted(path.name for path in (tmp_path / "recordings").iterdir()) == sorted(names)
    for name, seed in names.items():
        with open_log(tmp_path / "recordings" / name) as log:
            assert log.metadata["wingbeat.world"]["seed"] == str(seed) and log.complete
            assert {STATE.name, topics.IMU.name} <= set(log.topics)


def test_a_log_that_another_flight_records_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "flight.mcap"
    with locked_name(path) as ours:
        assert ours and main(["fly", "--log", str(path)]) == 2
    assert "another flight is being recorded there" in capsys.readouterr().err
    assert not any(tmp_path.iterdir())


def test_a_log_that_another_flight_leaves_before_its_name_is_ours_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "flight.mcap"

    @contextmanager
    def late(log: Path) -> Iterator[bool]:
        path.write_bytes(b"of another")
        with locked_name(log) as ours:
            yield ours

    monkeypatch.setattr("groundstation.command.fly.locked_name", late)
    monkeypatch.setattr("groundstation.command.fly._run", lambda *_: 0)
    assert main(["fly", "--log", str(path)]) == 2
    assert f"{path} exists: it is not overwritten" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [path]


def test_the_complaint_of_a_child_is_told() -> None:
    with Children() as children:
        children.start("the world", ["vehicles", "no_such_bird"])
        while children.running():
            time.sleep(0.02)
        failure = children.failure()
    assert failure is not None and failure.code == 2
    assert failure.text.startswith("the world stopped: ") and "no_such_bird" in failure.text


def test_children_that_end_well_are_no_failure() -> None:
    with Children() as children:
        children.start("one", ["--help"])
        children.start("two", ["--help"])
        while children.running():
            time.sleep(0.02)
        assert children.failure() is None


@pytest.mark.validate
def test_a_view_that_raises_costs_no_flight_and_is_in_the_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """GIVEN a view that raises THEN the flight goes on without it, and the traceback is in the log alone."""

    def broken(*args: Any) -> None:
        raise RuntimeError("no colors left")

    monkeypatch.setattr(fly_command, "_watch_lines", broken)
    log = tmp_path / "flight.mcap"
    assert main(["fly", "--duration", "3", "--log", str(log)]) == 0
    err = capsys.readouterr().err
    assert "no view for the rest of the flight: RuntimeError: no colors left" in err and "Traceback" not in err
    with open_log(log) as flight:
        assert flight.duration > 2.9
        assert "Traceback" in flight.metadata[FAULTS]["view"]

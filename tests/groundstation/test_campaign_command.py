"""``wingbeat campaign``: a table, going on after an interruption, one flight again, the report, what is refused."""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rich.console import Console

from groundstation.command import campaign, campaign_report
from groundstation.command.main import main
from groundstation.views.campaign import summary
from logs import extras
from logs.campaigns.cluster import dashboard_of, existing_cluster, flight_code, worker_memory
from logs.campaigns.outcome import Evaluation, Outcome
from logs.campaigns.run import ResourceUsage, fly_campaign
from logs.campaigns.single_flight import row_of
from logs.campaigns.table import read_table
from logs.reader import open_log
from wingbeat.errors import InputError

distributed = pytest.importorskip("distributed")
pytest.importorskip("pyarrow")

Capture = pytest.CaptureFixture[str]
WINGBEAT = (sys.executable, "-m", "groundstation.command.main")
SHORT = """
flights = 2
[flight]
duration = 0.4
[grid]
"scale.gains.pitch.damping" = [1, 2]
[draw]
"wind.speed" = { uniform = [0, 3] }
"""
LAUNCHED = SHORT.replace("0.4", "9.0").replace("[1, 2]", "[1]")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a campaign's file to be in, and a cluster in this process instead of new ones."""

    @contextlib.contextmanager
    def in_process(*arguments: Any) -> Iterator[Any]:
        with distributed.Client(processes=False, n_workers=1, threads_per_worker=1, dashboard_address=None) as client:
            yield client

    monkeypatch.setattr(campaign, "_cluster", in_process)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "short.toml").write_text(SHORT)
    return tmp_path


def document(capsys: Capture, *words: str) -> dict[str, Any]:
    assert main(list(words)) == 0
    told: dict[str, Any] = json.loads(capsys.readouterr().out)
    return told


def refused(capsys: Capture, *words: str) -> str:
    assert main(list(words)) == 2
    said = capsys.readouterr()
    assert said.out == "" and len(said.err.splitlines()) == 1
    return said.err


def test_a_campaign_is_a_table_and_the_same_command_flies_nothing_again(folder: Path, capsys: Capture) -> None:
    told = document(capsys, "campaign", "short.toml", "--json")
    assert told["table"] == "recordings/short.parquet" and told["logs"] is None
    assert (told["flights"], told["flown"], told["failed"], told["outcomes"]["not launched"]) == (4, 4, 4, 4)
    assert [path.name for path in (folder / "recordings").iterdir()] == ["short.parquet"]
    keys = {word for key in campaign.JSON_KEYS for word in key.split(", ")}
    assert set(told) <= keys
    before = (folder / "recordings/short.parquet").stat()
    again = document(capsys, "campaign", "short.toml", "--json")
    assert told["memory"]["peak"] >= told["memory"]["first_tenth"] > 50e6
    assert again == told | {"flown": 0, "wall_time": 0.0, "memory": None}
    assert (folder / "recordings/short.parquet").stat().st_mtime_ns == before.st_mtime_ns
    assert main(["campaign", "short.toml", "--json", "--logs", "all"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out) == again
    assert "recordings/short.parquet is complete: --logs has no effect" in said.err


def test_an_interrupted_campaign_goes_on_and_its_table_is_that_of_one_run(
    folder: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*arguments: Any) -> Iterator[dict[str, Any]]:
        yield from list(fly_campaign(*arguments))[:3]
        raise KeyboardInterrupt

    assert main(["campaign", "short.toml", "--out", "whole.parquet"]) == 0
    monkeypatch.setattr(campaign, "fly_campaign", interrupted)
    assert main(["campaign", "short.toml", "--out", "parts.parquet"]) == 130
    assert "stopped: 3 of 4 flights complete and stored; run the same command to resume" in capsys.readouterr().err
    assert not (folder / "parts.parquet").exists()
    assert main(["campaign", "report", "parts.parquet"]) == 0
    assert "unfinished: 3 flights of 4; resume with wingbeat campaign short.toml" in capsys.readouterr().out
    assert "unfinished: 4 flights are planned" in (folder / "parts.html").read_text()
    assert document(capsys, "campaign", "report", "parts.parquet", "--json")["planned"] == 4
    monkeypatch.setattr(campaign, "fly_campaign", fly_campaign)
    assert main(["campaign", "short.toml", "--out", "parts.parquet"]) == 0
    said = capsys.readouterr().out
    assert "resuming: 3 of 4 flights complete" in said and "1 flown in" in said
    assert (folder / "parts.parquet").read_bytes() == (folder / "whole.parquet").read_bytes()
    assert not (folder / "parts.parquet.flights").exists()


def test_an_unfinished_campaign_that_cannot_be_told_says_why(
    folder: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal = folder / "short.parquet.flights"
    journal.write_text('{"campaign": "a", "file": "short.toml"}\n')
    assert "no flight of this campaign has ended yet; resume with wingbeat campaign short.toml" in refused(
        capsys, "campaign", "report", "short.parquet"
    )
    row = json.dumps(row_of(1, Evaluation(Outcome.LANDED)))
    journal.write_text('{"campaign": "a", "file": "short.toml"}\n' + row + '\n{"fli')
    assert "holds 1 flight" in refused(capsys, "campaign", "report", "short.parquet")
    assert "short.toml, or a file that it names, has changed" in refused(
        capsys, "campaign", "report", "short.parquet"
    )
    journal.write_text('{"campaign": "a"}\n' + row + "\n")
    assert "can be resumed by the same command" in refused(capsys, "campaign", "report", "short.parquet")


def test_a_campaign_stopped_before_its_first_flight_ended_goes_on_with_its_logs(
    folder: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(*arguments: Any) -> Iterator[dict[str, Any]]:
        raise KeyboardInterrupt
        yield

    monkeypatch.setattr(campaign, "fly_campaign", stopped)
    assert main(["campaign", "short.toml", "--logs", "all"]) == 130
    monkeypatch.setattr(campaign, "fly_campaign", fly_campaign)
    assert main(["campaign", "short.toml", "--logs", "all"]) == 0
    assert len(list((folder / "recordings/short").glob("*.mcap"))) == 4


def test_logs_never_go_to_a_folder_that_was_there_before(folder: Path, capsys: Capture) -> None:
    (folder / "recordings/short").mkdir(parents=True)
    for _ in range(2):
        assert "choose another --out" in refused(capsys, "campaign", "short.toml", "--logs", "all")
    assert [path.name for path in (folder / "recordings").iterdir()] == ["short"]


def test_a_table_or_journal_of_another_campaign_is_left_alone(folder: Path, capsys: Capture) -> None:
    assert main(["campaign", "short.toml"]) == 0
    capsys.readouterr()
    table = (folder / "recordings/short.parquet").read_bytes()
    (folder / "short.toml").write_text(SHORT.replace("[0, 3]", "[0, 4]"))
    assert "belongs to another campaign" in refused(capsys, "campaign", "short.toml")
    assert (folder / "recordings/short.parquet").read_bytes() == table
    (folder / "recordings/short").mkdir()
    assert "choose another --out" in refused(capsys, "campaign", "short.toml", "--logs", "all")


@pytest.mark.validate
def test_the_report_names_the_worst_flights_and_its_commands_fly_them_again(folder: Path, capsys: Capture) -> None:
    (folder / "launched.toml").write_text(LAUNCHED)
    assert main(["campaign", "launched.toml"]) == 0
    capsys.readouterr()
    told = document(capsys, "campaign", "report", "recordings/launched.parquet", "--by", "bank", "--json")
    assert {word for key in campaign_report.JSON_KEYS for word in key.split(", ")} == set(told)
    assert told["changed"] == "" and told["page"] == "recordings/launched.html"
    assert [one["why"] for one in told["worst"]] == ["bank", "bank"]
    columns = read_table(folder / "recordings/launched.parquet").columns
    for one in told["worst"]:
        program, *words = shlex.split(one["command"])
        again = document(capsys, *words, "--json")
        row = {name: values[one["flight"] - 1] for name, values in columns.items()}
        assert program == "wingbeat" and again["values"]["wind.speed"] == row["wind.speed"]
        assert again["row"] | {"log": ""} == {name: row[name] for name in again["row"]}
        assert again["row"]["bank"] == one["value"]
        with open_log(Path(again["log"])) as log:
            assert log.duration == pytest.approx(9.0, abs=0.1)


def test_a_report_for_people(folder: Path, capsys: Capture) -> None:
    assert main(["campaign", "short.toml"]) == 0
    said = capsys.readouterr().out
    assert "4 ×  not launched within 0 s  (flight 1 and others)" in said
    assert main(["campaign", "report", "recordings/short.parquet", "--worst", "1"]) == 0
    said = capsys.readouterr().out
    assert "4 flights: 4 not launched" in said
    assert "wingbeat campaign short.toml --flight 1 --log flight-1.mcap" in said
    (folder / "short.toml").write_text(SHORT + "[landing]\nsink = 1\n")
    assert main(["campaign", "report", "recordings/short.parquet", "--out", "again.html"]) == 0
    assert "has changed" in capsys.readouterr().out
    assert sorted(path.name for path in folder.rglob("*.html")) == ["again.html", "short.html"]
    assert "exists" in refused(capsys, "campaign", "report", "recordings/short.parquet", "--out", "again.html")
    assert "metrics" in refused(capsys, "campaign", "report", "recordings/short.parquet", "--by", "beauty")


def test_one_flight_for_people(folder: Path, capsys: Capture) -> None:
    assert main(["campaign", "short.toml", "--flight", "4"]) == 0
    said = capsys.readouterr().out
    assert "not launched" in said and "scale.gains.pitch.damping" in said and "of every flight" in said
    assert "flights 1 to 4, not 5" in refused(capsys, "campaign", "short.toml", "--flight", "5")
    (folder / "mine.mcap").write_text("mine")
    assert "exists" in refused(capsys, "campaign", "short.toml", "--flight", "1", "--log", "mine.mcap")


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("--workers", "0"), "whole number from 1"),
        (("--workers", "2", "--scheduler", "tcp://127.0.0.1:1"), "exclude each other"),
        (("--log", "x.mcap"), "--log requires --flight"),
        (("--flight", "1", "--workers", "2"), "do not apply to --flight"),
        (("--out", "table.csv"), "must end in .parquet"),
        (("--logs", "some"), "invalid choice"),
    ],
)
def test_options_that_do_not_go_together_are_refused(
    folder: Path, capsys: Capture, words: tuple[str, ...], line: str
) -> None:
    assert line in refused(capsys, "campaign", "short.toml", *words)
    assert not (folder / "recordings").exists()


def test_a_folder_is_no_table(folder: Path, capsys: Capture) -> None:
    assert "is a folder: specify the table" in refused(capsys, "campaign", "report", ".")


def test_what_is_not_installed_is_named_with_the_command_that_installs_it(
    folder: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(extras, "importlib", SimpleNamespace(import_module=missing))
    said = refused(capsys, "campaign", "short.toml")
    assert "which is not installed: " in said and " -m pip install 'dask[distributed]" in said
    assert not (folder / "recordings").exists()


def test_a_scheduler_that_is_not_there_is_told_in_a_line(tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "short.toml").write_text(SHORT)
    from logs.campaigns import cluster

    before, cluster.CONNECTING = cluster.CONNECTING, 0.5
    try:
        said = refused(
            capsys, "campaign", str(tmp_path / "short.toml"), "--out", str(tmp_path / "t.parquet"),
            "--scheduler", "tcp://127.0.0.1:9",
        )  # fmt: skip
    finally:
        cluster.CONNECTING = before
    assert "no Dask scheduler at tcp://127.0.0.1:9" in said


@pytest.mark.parametrize(
    ("worker", "why"),
    [
        (flight_code, ""),
        (lambda: "0" * 64, "tcp://w:1 has another version of Wingbeat's sources"),
        (lambda: importlib.import_module("nothing_of_this_name"), "a worker of tcp://s:2 cannot fly: ModuleNotFound"),
    ],
    ids=["ours", "other sources", "nothing installed"],
)
def test_a_worker_flies_with_our_sources_or_not_at_all(
    worker: Callable[[], Any], why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Cluster:
        def __init__(self, address: str, timeout: float) -> None:
            self.closed = False

        def wait_for_workers(self, number: int, timeout: float) -> None:
            """All are there."""

        def run(self, function: Callable[[], str]) -> dict[str, Any]:
            assert function is flight_code
            return {"tcp://w:1": worker()}

        def close(self, timeout: float) -> None:
            self.closed = True

    monkeypatch.setattr(distributed, "Client", Cluster)
    with contextlib.ExitStack() as stack:
        if not why:
            client = stack.enter_context(existing_cluster("tcp://s:2"))
            assert not client.closed
            return
        with pytest.raises(InputError, match=why):
            stack.enter_context(existing_cluster("tcp://s:2"))


LONGER = 'flights = 6\n[flight]\nduration = 20.0\n[draw]\n"wind.speed" = { uniform = [0, 2] }\n'


def workers_of(parent: int) -> list[int]:
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            if int(stat.read_text().rpartition(")")[2].split()[1]) == parent:
                words = (stat.parent / "cmdline").read_bytes()
                if b"spawn_main" in words:
                    found.append(int(stat.parent.name))
    return found


def fly_until(process: subprocess.Popen[bytes], journal: Path, flights: int) -> None:
    deadline = time.monotonic() + 120.0
    while not journal.exists() or len(journal.read_bytes().splitlines()) <= flights:
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.05)


@pytest.mark.validate
@pytest.mark.skipif(not Path("/proc").exists(), reason="finds the workers in /proc")
def test_a_campaign_that_is_killed_goes_on_with_other_workers_to_the_same_bytes(tmp_path: Path) -> None:
    (tmp_path / "longer.toml").write_text(LONGER)
    command = [*WINGBEAT, "campaign", "longer.toml", "--logs", "all"]
    subprocess.run([*command, "--workers", "2", "--out", "whole.parquet"], cwd=tmp_path, check=True)
    command += ["--out", "parts.parquet"]
    journal = tmp_path / "parts.parquet.flights"
    for flights, by in ((1, signal.SIGINT), (2, signal.SIGKILL)):
        process = subprocess.Popen([*command, "--workers", "1"], cwd=tmp_path)
        fly_until(process, journal, flights)
        left = workers_of(process.pid)
        process.send_signal(by)
        assert process.wait(30.0) == (130 if by == signal.SIGINT else -by)
        time.sleep(3.0)
        assert left and not [pid for pid in left if Path(f"/proc/{pid}").exists()]
    subprocess.run([*command, "--workers", "2"], cwd=tmp_path, check=True)
    assert (tmp_path / "parts.parquet").read_bytes() == (tmp_path / "whole.parquet").read_bytes()
    names = [f"flight-{number:05d}.mcap" for number in range(1, 7)]
    assert sorted(path.name for path in (tmp_path / "parts").iterdir()) == names


@pytest.mark.validate
@pytest.mark.skipif(not Path("/proc").exists(), reason="finds the workers in /proc")
def test_a_worker_that_is_killed_costs_its_flight_alone(tmp_path: Path) -> None:
    (tmp_path / "longer.toml").write_text(LONGER)
    command = [*WINGBEAT, "campaign", "longer.toml", "--workers", "1", "--json"]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE)
    fly_until(process, tmp_path / "recordings" / "longer.parquet.flights", 2)
    (worker,) = workers_of(process.pid)
    os.kill(worker, signal.SIGKILL)
    out, _ = process.communicate(timeout=120.0)
    outcomes = json.loads(out)["outcomes"]
    assert (outcomes["killed"], outcomes["airborne"], process.returncode) == (1, 5, 0)


@pytest.mark.validate
def test_a_campaign_on_a_cluster_that_is_there_already(tmp_path: Path) -> None:
    (tmp_path / "longer.toml").write_text(LONGER)
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster:
        words = ["--scheduler", cluster.scheduler_address, "--json"]
        ran = subprocess.run(
            [*WINGBEAT, "campaign", "longer.toml", *words], cwd=tmp_path, check=True, capture_output=True
        )
        assert cluster.status.name == "running"
    assert json.loads(ran.stdout)["outcomes"]["airborne"] == 6


def test_dashboard_is_that_of_the_scheduler() -> None:
    """GIVEN schedulers with and without a dashboard THEN its address, or nothing."""
    link = "http://127.0.0.1:8787/status"
    for services, link_shown in (({"dashboard": 8787}, link), ({}, "")):
        client = SimpleNamespace(scheduler_info=lambda services=services: {"services": services}, dashboard_link=link)
        assert dashboard_of(client) == link_shown


def test_summary_tells_how_long_many_flights_take() -> None:
    """GIVEN 200 flights in 400 s WHEN summarized THEN 10000 take 5 h 33 min; of two flights nothing is told."""
    many, two = (
        ResourceUsage(count, 2.0 * count + 30.0, 2.0 * count, 210_000_000, 220_400_000) for count in (200, 2)
    )
    console = Console(file=io.StringIO(), width=120)
    console.print(summary("gusts", Path("gusts.parquet"), {"landed": 200}, many))
    console.print(summary("gusts", Path("gusts.parquet"), {"landed": 2}, two))
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert text.count("10000 flights take") == 1 and "2 s a flight; 10000 flights take 5 h 33 min" in text
    assert "220 MB for the largest worker; 210 MB in the first tenth" in text


def test_memory_is_that_of_the_largest_worker_and_none_of_a_lost_cluster() -> None:
    def lost() -> None:
        raise OSError("closed")

    workers = {str(size): {"metrics": {"memory": size}} for size in (3, 5, 4)}
    assert worker_memory(SimpleNamespace(scheduler_info=lambda: {"workers": workers})) == 5
    assert worker_memory(SimpleNamespace(scheduler_info=lost)) == 0


def test_memory_of_the_first_tenth_is_told_apart() -> None:
    """GIVEN 30 flights whose workers grow by 1 byte each THEN the first tenth is three flights."""
    done = ResourceUsage()
    for number in range(1, 31):
        done = done.with_flight(30, 2.0 * number, number)
    assert done == ResourceUsage(30, 0.0, 60.0, 3, 30) and done.time_of(10) == 20.0

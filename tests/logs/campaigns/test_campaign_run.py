"""A campaign on a cluster: rows by number whoever flew them, killed workers, and going on after an interruption."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from short_campaigns import HEAD, SHORT, campaign_of, cluster_in_process

from logs.campaigns.journal import Journal
from logs.campaigns.outcome import Evaluation, Outcome
from logs.campaigns.run import Logs, fly_campaign, order_of
from logs.campaigns.single_flight import row_of
from logs.campaigns.table import read_table, write_table
from wingbeat.errors import InputError

pytest.importorskip("pyarrow")

FIVE = HEAD + "flights = 5\n" + SHORT + '[draw]\n"wind.speed" = { uniform = [0, 3] }\n'


def rows_of(folder: Path, text: str, workers: int, keep: str = "none") -> dict[int, dict[str, Any]]:
    campaign = campaign_of(folder, text)
    with cluster_in_process(workers) as client:
        numbers = range(1, campaign.size + 1)
        return {row["flight"]: row for row in fly_campaign(campaign, numbers, client, Logs(keep, folder / "logs"))}


def test_the_table_is_the_same_to_the_byte_however_many_fly(tmp_path: Path) -> None:
    campaign = campaign_of(tmp_path, FIVE)
    for workers in (1, 2):
        rows = rows_of(tmp_path, FIVE, workers)
        write_table(tmp_path / f"{workers}.parquet", campaign, dict(sorted(rows.items(), reverse=workers == 2)))
    assert (tmp_path / "1.parquet").read_bytes() == (tmp_path / "2.parquet").read_bytes()
    table = read_table(tmp_path / "1.parquet")
    assert table.columns["flight"] == [1, 2, 3, 4, 5] and table.columns["seed"] == [1, 2, 3, 4, 5]
    assert table.columns["wind.speed"] == [campaign.values(number)["wind.speed"] for number in range(1, 6)]
    assert table.units["wind.speed"] == "m/s" and table.units["bank"] == "rad"
    assert table.about.digest == campaign.digest() and table.about.swept == ("wind.speed", "seed")


def test_logs_are_kept_where_they_were_asked_for(tmp_path: Path) -> None:
    (tmp_path / "logs").mkdir()
    rows = rows_of(tmp_path, HEAD + "flights = 2\n" + SHORT, 1, "failed")
    assert sorted(path.name for path in (tmp_path / "logs").iterdir()) == ["flight-00001.mcap", "flight-00002.mcap"]
    assert [rows[number]["log"] for number in (1, 2)] == ["flight-00001.mcap", "flight-00002.mcap"]


class Ended:
    """A future of a flight whose worker was killed."""

    status = "error"

    def exception(self) -> Exception:
        class KilledWorker(Exception):
            pass

        return KilledWorker("worker died")

    def done(self) -> bool:
        return True


class KillingClient:
    """A cluster whose workers die of every flight."""

    status = "running"

    def nthreads(self) -> dict[str, int]:
        return {"one": 1}

    def submit(self, *arguments: Any, **options: Any) -> Ended:
        return Ended()

    def cancel(self, futures: list[Any]) -> None:
        assert futures == []


def test_a_log_that_cannot_be_written_stops_the_campaign(tmp_path: Path) -> None:
    campaign, logs = campaign_of(tmp_path, FIVE), Logs("all", tmp_path / "short.toml")
    with (
        cluster_in_process() as client,
        pytest.raises(InputError, match="Not a directory; run the same command to resume"),
    ):
        list(fly_campaign(campaign, [1, 2], client, logs))


def test_a_killed_worker_is_a_row_and_what_it_had_recorded_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(distributed, "wait", lambda futures, **options: None)
    (tmp_path / "flight-00002.mcap.part").write_bytes(b"torn")
    campaign = campaign_of(tmp_path, FIVE)
    rows = list(fly_campaign(campaign, [1, 2], KillingClient(), Logs("all", tmp_path)))
    assert [(row["flight"], row["outcome"], row["failed"]) for row in rows] == [
        (1, "killed", True),
        (2, "killed", True),
    ]
    assert [row["log"] for row in rows] == ["", "flight-00002.mcap"]
    assert (tmp_path / "flight-00002.mcap").read_bytes() == b"torn"


def test_a_journal_keeps_rows_and_forgets_a_torn_last_line(tmp_path: Path) -> None:
    path = tmp_path / "table.parquet.flights"
    rows = {number: row_of(number, Evaluation(Outcome.LANDED)) | {"highest": 0.1 + 0.2} for number in (1, 2, 3)}
    with Journal(path, "abc") as journal:
        journal.add(rows[2])
        journal.add(rows[1])
        with pytest.raises(InputError, match="in use by another command of this campaign"):
            Journal(path, "abc")
    whole = path.read_bytes()
    path.write_bytes(whole + b'{"flight": 3, "ba')
    with Journal(path, "abc") as journal:
        assert journal.rows == {2: rows[2], 1: rows[1]}
        journal.add(rows[3])
    assert path.read_bytes() == whole + json.dumps(rows[3]).encode() + b"\n"


OTHERS = (
    b'{"campaign": "other"}\n{"flight": 1}\n',
    b"no journal\n",
    b"[1]\n",
    b'{"flight": 1}\n',
    b"\xff\xfe\n",
    b'{"campaign": "abc"}\n{"height": 1}\n',
    b'{"campaign": "abc"}\n{"flight": []}\n',
    b'{"campaign": "abc"}\n{"flight": 1}\n',
    b'{"campaign": ["abc"]}\n' + json.dumps(row_of(1, Evaluation(Outcome.LANDED))).encode() + b"\n",
    b'{"campaign": "abc"}\n'
    + json.dumps(row_of(1, Evaluation(Outcome.LANDED)) | {"highest": "far"}).encode()
    + b"\n",
    b'{"campaign": "abc"}\n' + b"[" * 5000 + b"]" * 5000 + b"\n",
    b'{"campaign": "abc"}\n{"flight": ' + b"9" * 5000 + b"}\n",
)


@pytest.mark.parametrize("content", OTHERS)
def test_a_journal_of_something_else_is_refused_and_left_alone(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "table.parquet.flights"
    path.write_bytes(content)
    with pytest.raises(InputError, match="choose another --out"):
        Journal(path, "abc")
    assert path.read_bytes() == content


def test_a_journal_without_flights_is_in_nobodys_way(tmp_path: Path) -> None:
    path = tmp_path / "table.parquet.flights"
    with Journal(path, "other"):
        pass
    with Journal(path, "abc") as journal:
        assert journal.rows == {}
        journal.add({"flight": 1})
    assert path.read_text() == json.dumps({"campaign": "abc"}) + "\n" + json.dumps({"flight": 1}) + "\n"


def test_a_table_is_never_overwritten_and_another_file_is_none(tmp_path: Path) -> None:
    campaign = campaign_of(tmp_path, FIVE)
    with pytest.raises(InputError, match="there is no such file"):
        read_table(tmp_path / "table.parquet")
    (tmp_path / "table.parquet").write_text("mine")
    with pytest.raises(InputError, match="exists"):
        write_table(tmp_path / "table.parquet", campaign, {})
    with pytest.raises(InputError, match="cannot read"):
        read_table(tmp_path / "table.parquet")
    import pyarrow
    import pyarrow.parquet

    pyarrow.parquet.write_table(pyarrow.table({"flight": [1]}), tmp_path / "other.parquet")
    with pytest.raises(InputError, match="not a campaign table"):
        read_table(tmp_path / "other.parquet")


def test_an_order_holds_all_that_a_worker_on_another_machine_needs(tmp_path: Path) -> None:
    import pickle

    order = order_of(campaign_of(tmp_path, FIVE), 3)
    assert pickle.loads(pickle.dumps(order)) == order

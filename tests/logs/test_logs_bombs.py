"""Small files that declare or contain far more than they are: memory stays bounded, and what is whole is read."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from foxglove_schemas_protobuf.Log_pb2 import Log as FoxgloveLog
from mcap.writer import CompressionType, Writer

from groundstation.command.main import main
from logs.chunks import MAX_CHUNK_SIZE
from logs.index import MAX_DEFINITION_BYTES
from logs.reader import open_log

MAGIC = b"\x89MCAP0\r\n"
EPOCH = 10**18
GIB = 1 << 30
COMPRESS: dict[str, Callable[[bytes], bytes]] = {
    "zstd": lambda data: zstandard.ZstdCompressor().compress(data),
    "zstd without size": lambda data: zstandard.ZstdCompressor(write_content_size=False).compress(data),
    "lz4": lz4.frame.compress,
}
INFO = """
import resource, subprocess, sys
done = subprocess.run([sys.executable, "-m", "groundstation.command.main", "log", "info", sys.argv[1]])
print("peak", resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss // 1024, "code", done.returncode)
"""


def record(opcode: int, body: bytes) -> bytes:
    return bytes([opcode]) + struct.pack("<Q", len(body)) + body


def text(content: bytes) -> bytes:
    return struct.pack("<I", len(content)) + content


def chunk(compression: str, content: bytes, declared: int | None = None) -> bytes:
    packed = COMPRESS[compression](content)
    size = len(content) if declared is None else declared
    head = struct.pack("<QQQI", 0, 1, size, 0) + text(compression.split()[0].encode())
    return record(6, head + struct.pack("<Q", len(packed)) + packed)


def schema(number: int, data: bytes) -> bytes:
    return record(3, struct.pack("<H", number) + text(b"s") + text(b"jsonschema") + text(data))


def message(data: bytes, time: int = EPOCH) -> bytes:
    return record(5, struct.pack("<HIQQ", 1, 0, time, time) + data)


CHANNEL = schema(1, b"{}") + record(4, struct.pack("<HH", 1, 1) + text(b"/a") + text(b"json") + struct.pack("<I", 0))
GOOD = CHANNEL + b"".join(message(b'{"x":%d}' % i, EPOCH + i) for i in range(5))


def write(path: Path, *records: bytes) -> Path:
    end = record(15, bytes(4)) + record(2, struct.pack("<QQI", 0, 0, 0))
    path.write_bytes(MAGIC + record(1, text(b"") + text(b"test")) + b"".join(records) + end + MAGIC)
    return path


def peak_of_info(path: Path) -> int:
    """Largest resident memory of ``wingbeat log info``, MB."""
    done = subprocess.run([sys.executable, "-c", INFO, str(path)], capture_output=True, text=True, check=True)
    _, peak, _, code = done.stdout.splitlines()[-1].split()
    assert code == "0", done.stderr
    return int(peak)


@pytest.mark.parametrize(
    "compression",
    [pytest.param(name, marks=() if name == "zstd" else pytest.mark.validate) for name in COMPRESS],
)
def test_chunk_is_not_decompressed_beyond_its_declared_size(tmp_path: Path, compression: str) -> None:
    path = write(tmp_path / "a.mcap", chunk(compression, bytes(GIB), 1000), chunk("zstd", GOOD))
    assert path.stat().st_size < 10e6
    assert peak_of_info(path) < 250
    with open_log(path) as log:
        assert log.topics["/a"].messages == 5
        assert len(log.damage) == 1 and log.damage[0].startswith("chunk at byte")


@pytest.mark.parametrize("compression", ["zstd", pytest.param("lz4", marks=pytest.mark.validate)])
def test_large_honest_chunks_are_read_one_at_a_time(tmp_path: Path, compression: str) -> None:
    content = CHANNEL + message(bytes(240 << 20))
    path = write(tmp_path / "a.mcap", *[chunk(compression, content)] * 2)
    assert peak_of_info(path) < 400


def test_many_definitions_stay_bounded(tmp_path: Path) -> None:
    content = b"".join(schema(number, bytes(4000)) for number in range(1, 20_000))
    assert len(content) > MAX_DEFINITION_BYTES
    path = write(tmp_path / "a.mcap", chunk("zstd", content), chunk("zstd", GOOD))
    assert peak_of_info(path) < 400


@pytest.mark.validate
def test_repeated_records_stay_bounded(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap", chunk("zstd", CHANNEL + message(b"{}") * 1_200_000), chunk("lz4", GOOD))
    assert peak_of_info(path) < 400
    with open_log(path) as log:
        assert log.topics["/a"].messages == 5
        assert "records" in log.damage[0]


def test_event_texts_stay_bounded(tmp_path: Path) -> None:
    kind = record(3, struct.pack("<H", 1) + text(b"foxglove.Log") + text(b"protobuf") + text(b""))
    channel = record(4, struct.pack("<HH", 1, 1) + text(b"/e") + text(b"protobuf") + struct.pack("<I", 0))
    event = FoxgloveLog(message="\N{GRINNING FACE}" + "e" * 1_000_000).SerializeToString()
    path = write(tmp_path / "a.mcap", chunk("zstd", kind + channel + message(event) * 100))
    assert peak_of_info(path) < 250
    with open_log(path) as log:
        events = log.events()
        assert 0 < len(events) < 20
        assert all(event.text.endswith("e… (1000001 characters)") and len(event.text) < 5000 for event in events)
        assert log.undecodable["/e"] == 100 - len(events)


FOREIGN = [
    b'{"x":1}',
    b'{"dropped":"abc"}',
    b'{"dropped":[1,2]}',
    b'{"dropped":1e999}',
    b'{"dropped":' + b"9" * 4000 + b"}",
]


@pytest.mark.parametrize("content", FOREIGN, ids=range(len(FOREIGN)))
@pytest.mark.parametrize("topic", [b"/system/recorder", b"/truth/state", b"/main/navigation"])
def test_foreign_topics_with_our_names_are_not_ours(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], topic: bytes, content: bytes
) -> None:
    channel = record(4, struct.pack("<HH", 1, 1) + text(topic) + text(b"json") + struct.pack("<I", 0))
    path = write(tmp_path / "a.mcap", chunk("zstd", schema(1, b"{}") + channel + message(content)))
    assert main(["log", "info", str(path)]) == 0
    assert topic.decode() in capsys.readouterr().out


def test_many_channels_are_read_in_linear_time(tmp_path: Path) -> None:
    channels = [
        record(4, struct.pack("<HH", n, 1) + text(b"/%d" % n) + text(b"json") + struct.pack("<I", 0))
        for n in range(1, 40_000)
    ]
    with open_log(write(tmp_path / "a.mcap", chunk("zstd", schema(1, b"{}") + b"".join(channels)))) as log:
        assert len(log.topics) == 39_999


def test_line_feeds_of_foreign_text_stay_in_their_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    channel = record(4, struct.pack("<HH", 1, 1) + text(b"/e\nFORGED") + text(b"json") + struct.pack("<I", 0))
    path = write(tmp_path / "a.mcap", chunk("zstd", schema(1, b"{}") + channel + message(b"{}")))
    assert main(["log", "info", str(path)]) == 0
    assert not any(line.startswith("FORGED") for line in capsys.readouterr().out.splitlines())


def test_oversized_chunk_is_read_when_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content = CHANNEL + message(b'{"x":1,"y":"' + b"y" * 3000 + b'"}')
    path = write(tmp_path / "a.mcap", chunk("lz4", content), chunk("lz4", GOOD))
    with open_log(path, max_chunk_size=1000) as log:
        assert log.topics["/a"].messages == 5
        assert "--max-chunk-size" in log.damage[0]
    with open_log(path) as log:
        assert log.topics["/a"].messages == 6 and not log.damage
    assert MAX_CHUNK_SIZE == 256 << 20
    assert main(["log", "info", str(path), "--json", "--max-chunk-size", "0.001"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["messages"] == 5 and len(document["damage"]) == 1


@pytest.fixture
def one_bad_message(tmp_path: Path) -> Path:
    path = tmp_path / "bad.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start("", "test")
        kind = writer.register_schema("thing", "jsonschema", b"{}")
        odd, good = (writer.register_channel(topic, "json", kind) for topic in ("/odd", "/good"))
        for i in range(50):
            writer.add_message(odd, EPOCH + i, b'{"x":%d}' % i, EPOCH + i)
            writer.add_message(good, EPOCH + i, b'{"z":%d}' % i, EPOCH + i)
        writer.add_message(odd, EPOCH + 50, b'{"x":', EPOCH + 50)
        writer.finish()
    return path


def test_undecodable_message_costs_itself_alone(
    one_bad_message: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with open_log(one_bad_message) as log:
        assert log.columns("/odd")["x"].tolist() == list(range(50))
        assert len(log.columns("/good").time) == 50
        assert log.undecodable == {"/odd": 1}
    assert main(["log", "export", str(one_bad_message), "--to", str(tmp_path / "a.npz")]) == 0
    assert "omitted: /odd: 1 message that cannot be decoded" in capsys.readouterr().err


def test_parquet_of_empty_lists_is_read_back(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    path = tmp_path / "lists.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("", "test")
        channel = writer.register_channel("/l", "json", writer.register_schema("thing", "jsonschema", b"{}"))
        for i in range(3):
            writer.add_message(
                channel, EPOCH + i, b'{"none":[],"two":[1,2],"ragged":[%s]}' % (b"1," * i + b"1"), EPOCH
            )
        writer.finish()
    assert main(["log", "export", str(path), "--to", str(tmp_path / "out"), "--format", "parquet"]) == 0
    table = parquet.read_table(tmp_path / "out" / "l.parquet")
    assert table["none"].to_pylist() == [[], [], []]
    assert table["two"].to_pylist() == [[1, 2]] * 3

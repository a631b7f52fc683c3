"""How fast logs are written and read, beside the `mcap` package's own writer and reader (``make bench``)."""

from __future__ import annotations

import gc
import json
import random
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory
from pyulog import ULog
from rows import Row, leave, peer

from avionics import topics
from logs.importing.log_import import Choice, import_log
from logs.join import join
from logs.layout import layout_of
from logs.poses import Frames, Pose
from logs.reader import open_log
from logs.recorder import AT_ONCE, IN_FLIGHT, McapRecorder, Writing
from sim_bridge import topics as truth_topics
from wingbeat.message import Event, Text
from wingbeat.topic import Topic

sys.path.insert(0, str(Path(__file__).parents[1] / "logs" / "importing"))

from foreign_logs import ulog

Result = TypeVar("Result")
Messages = list[tuple[Topic, Any]]

WRITTEN_PER_SECOND = 300_000.0
LONGEST_STALL = 5e-3
"""s"""
READ_PER_SECOND = 1_500_000.0
TIMES_THE_PLAIN_READER = 30.0
TIMES_THE_DATA = 5.0
"""bytes of memory for a byte of columns"""
SHARE_OF_ONE_TOPIC = 0.2

FIXED = tuple(t for t in topics.TOPICS + truth_topics.TOPICS if t.message not in (Event, Text) and t.rate)
RATE = sum(topic.rate for topic in FIXED)
"""messages/s; of a flight"""
FLIGHT_S = 2e6 / RATE
ROUND_S, ROUNDS = 30.0, 8
"""s of flight that wait for the disk in the recorder's queue, should its thread not run at all"""
TICK_COST = 20e-6
"""s; time of the flight's thread for the messages of a step"""
IMPORT_S, IMPORTED_BYTES = 20.0, 100_000_000
"""s of processor time for a log of so many bytes"""
TICK_S, HASTE = 0.005, 10.0
"""s of a step of the flight; how many times faster than that it flies"""
POOL = 200


def sample(topic: Topic, source: random.Random) -> list[Any]:
    """A pool of messages with noise in every floating-point field."""
    layout = layout_of(topic.message)
    return [
        topic.message(
            *(
                (1,) * f.length if f.length else source.gauss(0, 1) if f.scalar == "double" else 1
                for f in layout.fields
            )
        )
        for _ in range(POOL)
    ]


class Flight:
    """Every topic of fixed layout at its rate, without end."""

    def __init__(self) -> None:
        source = random.Random(1)
        self._pools = {topic: sample(topic, source) for topic in FIXED}

    def part(self, start: float, end: float) -> Messages:
        """Messages from ``start`` to before ``end`` (s), in the order of their times."""
        places = [
            (round(n * 1e6 / topic.rate), topic.channel, n, topic)
            for topic in FIXED
            for n in range(round(start * topic.rate), round(end * topic.rate))
        ]
        return [
            (topic, self._pools[topic][n * 7 % POOL]._replace(time_us=time_us))
            for time_us, _, n, topic in sorted(places, key=lambda place: place[:2])
        ]


@pytest.fixture(scope="module")
def flight() -> Flight:
    return Flight()


@pytest.fixture(scope="module")
def minutes(flight: Flight) -> Messages:
    """Two minutes of a flight."""
    return flight.part(0.0, 120.0)


def send(line: str) -> None:
    sys.stdout.write(line + "\n")


def timed(run: Callable[[], Result]) -> tuple[float, Result]:
    """Seconds on the wall clock or of the processor, whichever are less, and what came of it.

    Those of the processor are the sum of all threads, and of programs that were started: as long as a file is in
    memory, and these are, a machine that does nothing else takes no longer than that on the wall clock. One that does
    much else takes any time.
    """
    wall, core = time.perf_counter(), processor_seconds()
    out = run()
    return min(time.perf_counter() - wall, processor_seconds() - core), out


def processor_seconds() -> float:
    spent = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in spent)


def quickest(run: Callable[[], Result], rounds: int = 5) -> tuple[float, Result]:
    """The shortest of some times: what else the machine does can only lengthen one."""
    return min((timed(run) for _ in range(rounds)), key=lambda pair: pair[0])


def report(what: str, count: int, elapsed: float) -> None:
    send(f"{what:44} {count / elapsed / 1e3:9.0f} k/s  {elapsed:7.3f} s")


# --- writing --------------------------------------------------------------------------------------------


@pytest.mark.bench
@pytest.mark.parametrize("writing", [AT_ONCE, Writing(IN_FLIGHT)], ids=["at once", "in flight"])
def test_messages_are_written_fast_enough_on_one_core(flight: Flight, tmp_path: Path, writing: Writing) -> None:
    """The seconds are those of the processor, of all threads together, opening and finishing the file included.

    Another program that shares a core's caches lengthens them too, so the shortest of some rounds counts.
    """
    messages = flight.part(0.0, ROUND_S)
    spent = sorted(seconds_to_write(messages, tmp_path / f"{n}.mcap", writing) for n in range(ROUNDS))
    send(f"\nwriting {len(messages)} messages on {len(FIXED)} topics, queue of {writing.queue} bytes, processor time")
    report("quickest round", len(messages), spent[0])
    report("median round", len(messages), spent[ROUNDS // 2])
    package = mcap_seconds(messages, tmp_path / "mcap")
    report("mcap package's writer, messages encoded before", len(messages), package)
    computed, theirs = (len(messages) / seconds / 1e3 for seconds in (spent[0], package))
    requested = f"at least {WRITTEN_PER_SECOND / 1e3:g}"
    what = f"writing a log, queue of {writing.queue} bytes"
    leave(Row(what, computed, theirs, "1000 messages/s", f"{peer('mcap')}, messages encoded before", requested))
    assert len(messages) / spent[0] >= WRITTEN_PER_SECOND


def seconds_to_write(messages: Messages, path: Path, writing: Writing) -> float:
    """Of the processor, in all threads."""
    start = time.process_time()
    with McapRecorder(path, start_epoch_ns=0, topics=FIXED, writing=writing) as recorder:
        for topic, message in messages:
            recorder.record(topic, message)
    spent = time.process_time() - start
    assert not recorder.refusal and not recorder.failure and not recorder.dropped
    path.unlink()
    return spent


@pytest.mark.bench
def test_recording_time_per_step(flight: Flight, tmp_path: Path) -> None:
    """GIVEN a flight WHEN recorded with a queue THEN its thread spends at most `TICK_COST` on each step."""
    messages = flight.part(0.0, 1.0)
    spent = []
    for number in range(10 * ROUNDS):
        with McapRecorder(
            tmp_path / f"{number}.mcap", start_epoch_ns=0, topics=FIXED, writing=Writing(IN_FLIGHT)
        ) as recorder:
            begin = time.thread_time()
            for topic, message in messages:
                recorder.record(topic, message)
            spent.append((time.thread_time() - begin) * TICK_S)
        assert not recorder.refusal and not recorder.failure and not recorder.dropped
    send(f"\nrecording {len(messages) * TICK_S:.1f} messages per step: {min(spent) * 1e6:.1f} us")
    requested = f"at most {TICK_COST * 1e6:g}"
    leave(Row("recording, flight's thread per step", min(spent) * 1e6, None, "us", requested=requested))
    assert min(spent) <= TICK_COST


def mcap_seconds(messages: Messages, path: Path) -> float:
    encoded = [(topic.channel, m.time_us * 1000, layout_of(type(m)).encode(m)) for topic, m in messages]
    start = time.process_time()
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=64 * 1024)
        writer.start()
        numbers = {topic.channel: writer.register_channel(topic.name, "protobuf", 0) for topic in FIXED}
        for channel, time_ns, data in encoded:
            writer.add_message(numbers[channel], time_ns, data, time_ns)
        writer.finish()
    return time.process_time() - start


@pytest.fixture
def unwatched() -> Iterator[None]:
    """What a test holds ready is no concern of the garbage collector's while it measures."""
    gc.collect()
    gc.freeze()
    yield
    gc.unfreeze()


@pytest.mark.bench
@pytest.mark.usefixtures("unwatched")
def test_no_call_of_the_recorder_makes_the_flight_wait(minutes: Messages, tmp_path: Path) -> None:
    """GIVEN a flight ten times as fast as real WHEN it is recorded as flights are THEN no call takes long.

    A flight waits for its world after every step; the recorder's thread runs meanwhile, and whenever it can. What
    the system does (another program on our core) is told apart from what we do by its own count of such switches.
    """
    calls = Calls([], [], [])
    with McapRecorder(tmp_path / "a.mcap", start_epoch_ns=0, topics=FIXED, writing=Writing(IN_FLIGHT)) as recorder:
        for step in steps(minutes):
            due = time.perf_counter() + TICK_S / HASTE
            for topic, message in step:
                calls.measure(recorder, topic, message)
            time.sleep(max(0.0, due - time.perf_counter()))
    assert not recorder.refusal and not recorder.failure and not recorder.dropped
    computed = calls.undisturbed()
    count = len(calls.wall)
    send(f"\n{count} calls of the recorder in flight; for {count - len(computed)} of them a core was taken away")
    calls.report("all calls", list(range(count)))
    calls.report("core not taken away", computed)
    assert max(calls.wall[number] for number in computed) < LONGEST_STALL


class Calls(NamedTuple):
    """Calls of the recorder, in lists of plain numbers, which the garbage collector does not look through."""

    wall: list[float]
    """s"""
    core: list[float]
    """s; that the calling thread spent on a core"""
    taken: list[int]
    """times that the system gave a core of this program to another, until the end of the call"""

    def measure(self, recorder: McapRecorder, topic: Topic, message: Any) -> None:
        core, start = time.thread_time(), time.perf_counter()
        recorder.record(topic, message)
        self.wall.append(time.perf_counter() - start)
        self.core.append(time.thread_time() - core)
        self.taken.append(resource.getrusage(resource.RUSAGE_SELF).ru_nivcsw)

    def undisturbed(self) -> list[int]:
        """Calls in which no core was taken away, nor between them and the call before."""
        return [number for number, (before, after) in enumerate(pairwise(self.taken), 1) if before == after]

    def report(self, what: str, numbers: list[int]) -> None:
        longest = sorted(numbers, key=self.wall.__getitem__)
        worst = ", ".join(f"{self.wall[n] * 1e3:.2f} ({self.core[n] * 1e3:.2f})" for n in longest[:-6:-1])
        median = self.wall[longest[len(longest) // 2]] * 1e6
        send(f"{what:20} median {median:4.1f} us, worst (and of it on a core): {worst} ms")


def steps(messages: Messages) -> Iterator[Messages]:
    """Messages of one step of the flight after the other."""
    step: Messages = []
    for topic, message in messages:
        if step and message.time_us >= step[0][1].time_us + round(TICK_S * 1e6):
            yield step
            step = []
        step.append((topic, message))
    yield step


# --- reading --------------------------------------------------------------------------------------------


class Recorded(NamedTuple):
    path: Path
    messages: int


@pytest.fixture(scope="module")
def recorded(flight: Flight, tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """Two million messages, as a flight records them: flight computer and world apart, joined when it is over."""
    folder = tmp_path_factory.mktemp("flight")
    parts = [folder / "onboard.mcap", folder / "world.mcap"]
    count, start = 0, 0.0
    with McapRecorder(parts[0], start_epoch_ns=0) as onboard, McapRecorder(parts[1], start_epoch_ns=0) as world:
        while start < FLIGHT_S:
            for topic, message in flight.part(start, start + 20.0):
                (world if topic in truth_topics.TOPICS else onboard).record(topic, message)
                count += 1
            start += 20.0
    assert not join(parts, folder / "flight.mcap")
    return Recorded(folder / "flight.mcap", count)


@pytest.mark.bench
def test_a_flight_becomes_columns_fast_enough(recorded: Recorded) -> None:
    path, count = recorded
    send(f"\n{count} messages on {len(FIXED)} topics, {path.stat().st_size / 1e6:.0f} MB, to columns")
    whole, tables = quickest(lambda: open_log(path).tables())
    report("all topics", count, whole)
    assert sum(len(table.time) for table in tables.values()) == count
    part = count // 20
    plain, _ = quickest(lambda: read_plainly(path, part), 2)
    report(f"mcap and mcap-protobuf-support, {part} of them", part, plain)
    times = count / whole / (part / plain)
    send(f"{times:.0f} times the plain reader")
    name, requested = f"{peer('mcap')}, {peer('mcap-protobuf-support')}", f"at least {READ_PER_SECOND / 1e3:g}"
    leave(
        Row("reading a log to columns", count / whole / 1e3, part / plain / 1e3, "1000 messages/s", name, requested)
    )
    assert count / whole >= READ_PER_SECOND and times >= TIMES_THE_PLAIN_READER


def read_plainly(path: Path, count: int) -> None:
    """Decode the first messages with the package's own reader."""
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for number, _ in enumerate(reader.iter_decoded_messages(), 1):
            if number == count:
                return


@pytest.mark.bench
def test_one_topic_takes_a_fifth_of_the_time(recorded: Recorded) -> None:
    """Of the time that a whole flight may take, at `READ_PER_SECOND`.

    What a chunk holds of a topic can only be had by unpacking it all: beside the time that a whole flight does take,
    which is shorter, the share of one topic is that of unpacking, and told.
    """
    path, count = recorded
    whole, _ = quickest(lambda: open_log(path).tables())
    longest = SHARE_OF_ONE_TOPIC * count / READ_PER_SECOND
    send(f"\none topic of {len(FIXED)}; {longest:.3f} s at most, all of them take {whole:.3f} s")
    for topic in topics.IMU, topics.HEALTH, truth_topics.STATE:
        one, columns = quickest(lambda topic=topic: open_log(path).columns(topic))  # type: ignore[misc]
        report(f"{topic.name}, {one / whole:.0%} of all", len(columns.time), one)
        assert one < longest


PEAK = """
import json, sys
from logs.reader import open_log

def kilobytes(what):
    with open("/proc/self/status") as file:
        return next(int(line.split()[1]) for line in file if line.startswith(what))

before = kilobytes("VmRSS")
with open_log(sys.argv[1]) as log:
    tables = log.tables()
data = sum(table.log_time_ns.nbytes + sum(values.nbytes for values in table.values()) for table in tables.values())
print(json.dumps({"peak": 1024 * (kilobytes("VmHWM") - before), "data": data}))
"""
"""The mapped file counts too. The peak is the program's own: that of `getrusage` begins with its parent's."""


@pytest.mark.bench
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="Linux tells the peak of a program's memory")
def test_memory_of_reading(recorded: Recorded) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PEAK, str(recorded.path)], capture_output=True, text=True, check=True, timeout=120
    )
    told = json.loads(done.stdout)
    send(f"\ncolumns of {told['data'] / 1e6:.0f} MB, {told['peak'] / 1e6:.0f} MB at most while they are read")
    assert told["peak"] < TIMES_THE_DATA * told["data"]


@pytest.mark.bench
def test_a_file_without_its_end_opens(recorded: Recorded, tmp_path: Path) -> None:
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(recorded.path.read_bytes()[:-10])
    elapsed, log = timed(lambda: open_log(torn))
    send("")
    report("open a file without its end", recorded.messages, elapsed)
    assert not log.complete and sum(info.messages for info in log.topics.values()) == recorded.messages


# --- importing ------------------------------------------------------------------------------------------


@pytest.mark.bench
def test_import_of_a_large_ulog(tmp_path: Path) -> None:
    """GIVEN a ULog of 100 MB WHEN imported THEN it takes at most `IMPORT_S`; pyulog only reads it."""
    source, names = np.random.default_rng(1), ("angles", "rates", "acceleration", "position", "motors", "servos")
    count = IMPORTED_BYTES // (len(names) * (13 + 4 * 12))
    times = np.arange(count) * 4000 + 1_000_000
    topics_of_log = {
        name: (times + 100 * n, {"values": source.normal(size=(count, 8)), **{
            f"value_{i}": source.normal(size=count) for i in range(4)
        }})
        for n, name in enumerate(names)
    }  # fmt: skip
    path = tmp_path / "large.ulg"
    path.write_bytes(ulog(topics_of_log))
    assert path.stat().st_size >= 0.99 * IMPORTED_BYTES
    out = tmp_path / "large.mcap"
    computed, done = quickest(lambda: (out.unlink(missing_ok=True), import_log(Choice(path, out)))[1], 2)
    theirs, read = quickest(lambda: ULog(str(path)), 2)
    assert done.messages >= count * len(names) == sum(len(each.data["timestamp"]) for each in read.data_list)
    send(f"\nimport of {path.stat().st_size / 1e6:.0f} MB: {computed:.1f} s; pyulog reads it in {theirs:.1f} s")
    requested = f"at most {IMPORT_S:g}"
    leave(Row("import of a ULog of 100 MB", computed, theirs, "s", f"{peer('pyulog')}, reading alone", requested))
    assert computed <= IMPORT_S


@pytest.mark.bench
def test_frames_per_second() -> None:
    frames = Frames((0.1, 0.0, 0.0), (-0.4, 0.0, 0.0), 0)
    pose = Pose(5, (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0), (0.1, 0.2), (0.1, 0.1), 0.1, 0.1)
    elapsed, size = timed(lambda: [len(frames.packed(pose)) for _ in range(5000)])
    send("")
    report("frame transforms", 5000, elapsed)
    assert len(set(size)) == 1

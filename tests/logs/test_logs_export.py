"""Exports come back as they were: CSV, npz, Parquet, MATLAB, data frames."""

from __future__ import annotations

import csv
import json
import sys
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer
from recorded import ALL_TOPICS, flight, record
from scipy.io import loadmat

from avionics import topics
from logs import matlab
from logs.export import FORMS, Part, export
from logs.extras import pip_install
from logs.matlab import matlab_names, write_mat
from logs.reader import Log, open_log
from wingbeat.errors import InputError

SOME = (topics.WING, topics.ADC, topics.NAVIGATION, topics.EVENTS, topics.PILOT)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Log:
    return open_log(record(tmp_path_factory.mktemp("export") / "a.mcap", flight(2.0, SOME)))


def foreign(path: Path) -> Log:
    """A file of another writer: nested JSON with texts and lists, and a topic that nobody can decode."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        one = writer.register_channel("/json", "json", 0)
        blob = writer.register_channel("/blob", "flatbuffer", 0)
        for n in range(20):
            document = {"b": {"c": n + 0.5}, "time": n, "name": f"n{n}", "list": [1] * n, "end": [n, n], "none": []}
            writer.add_message(one, n * 10**8, json.dumps(document).encode(), n)
            writer.add_message(blob, n * 10**8, b"?", n)
        writer.finish()
    return open_log(path)


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


# --- MATLAB ---------------------------------------------------------------------------------------------


def test_matlab_reads_every_topic_as_a_struct(log: Log, tmp_path: Path) -> None:
    (path,) = export(log, tmp_path / "a.mat").files
    structs = loadmat(path, squeeze_me=False, struct_as_record=True)
    for topic in SOME:
        columns, struct = log.columns(topic), structs[topic.name.strip("/").replace("/", "_")][0, 0]
        assert struct["topic"][0] == topic.name
        for name, values in columns.items():
            if values.dtype != object:
                assert np.array_equal(struct[name.replace(".", "_")].reshape(values.shape), values), name
                assert struct[name.replace(".", "_")].shape[0] == len(values)
            assert struct["units"][0, 0][name.replace(".", "_")][0] == columns.units[name]
    assert structs["main_wing"][0, 0]["units"][0, 0]["phase"][0] == "rad"
    texts = structs["system_events"][0, 0]["message"]
    assert [text[0] for text in texts[:, 0]] == [event.text for event in log.events()]


def test_names_for_matlab() -> None:
    names = matlab_names(["/main/wing", "a.b", "a_b", "end", "7up", "/", "_x", "unit", "é"], ("unit",))
    assert names == ["main_wing", "a_b", "a_b_2", "end_", "x7up", "table", "x_x", "unit_2", "x_"]
    long = matlab_names(["x" * 70, "x" * 71, "x" * 63])
    assert [len(name) for name in long] == [63, 63, 63] and len(set(long)) == 3
    every = matlab_names(topic.name for topic in ALL_TOPICS)
    assert len(set(every)) == len(ALL_TOPICS)


def test_a_field_whose_name_is_the_structs_own_is_kept(tmp_path: Path) -> None:
    columns = foreign(tmp_path / "a.mcap").columns("/json")
    columns.fields["units"] = np.arange(20)
    columns.units["units"] = "m"
    with (tmp_path / "a.mat").open("wb") as file:
        write_mat({"/json": columns}, file)
    struct = loadmat(tmp_path / "a.mat")["json"][0, 0]
    assert struct["units_2"][:, 0].tolist() == list(range(20)) and struct["units"][0, 0]["units_2"][0] == "m"
    assert struct["b_c"][3, 0] == 3.5 and struct["end_"].shape == (20, 2)
    assert struct["list"][2, 0][0] == "[1, 1]"


def test_what_is_too_large_for_matlab_says_so(log: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(matlab, "LARGEST", 10_000)
    with pytest.raises(InputError, match="a MATLAB 5 file"):
        export(log, tmp_path / "a.mat")
    assert list(tmp_path.iterdir()) == []


# --- Parquet --------------------------------------------------------------------------------------------


def test_parquet_keeps_numbers_units_and_labels(log: Log, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    files = export(log, tmp_path / "out", form="parquet").files
    assert {file.name for file in files} == {f"{t.name[1:].replace('/', '_')}.parquet" for t in SOME}
    for topic in SOME:
        table = parquet.read_table(tmp_path / "out" / f"{topic.name[1:].replace('/', '_')}.parquet")
        columns = log.columns(topic)
        assert table.schema.metadata[b"wingbeat.topic"].decode() == topic.name
        for name, values in columns.items():
            assert table.schema.field(name).metadata[b"unit"].decode() == columns.units[name]
            if values.dtype != object:
                assert np.array_equal(np.array(table[name].to_pylist()), values), name
    mode = parquet.read_schema(tmp_path / "out" / "guidance_navigation.parquet").field("mode")
    assert json.loads(mode.metadata[b"labels"])["4"] == "AUTO"


def test_parquet_of_texts_and_of_no_message(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    log = foreign(tmp_path / "a.mcap")
    part = Part(["/json"])
    table = parquet.read_table(export(log, tmp_path / "a.parquet", part).files[0])
    assert table["name"].to_pylist()[4] == "n4" and table["list"].to_pylist()[2] == "[1, 1]"
    assert table["time"].to_pylist() == pytest.approx([0.1 * n for n in range(20)])
    assert table["message_time"].to_pylist() == list(range(20))
    empty = open_log(record(tmp_path / "b.mcap", flight(0.5, (topics.ADC,))))
    (path,) = export(empty, tmp_path / "none.parquet", Part(None, 5.0)).files
    assert parquet.read_table(path).num_rows == 0 and len(parquet.read_table(path).schema) == 4


def test_without_pyarrow_parquet_is_one_line(log: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(InputError, match=r"needs pyarrow, which is not installed: \S+ -m pip install 'pyarrow[<>=]"):
        export(log, tmp_path / "a.parquet", Part(["/main/wing"]))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_parquet_of_every_topic_is_read(tmp_path: Path, library: str) -> None:
    """GIVEN topics of every layout and a foreign one with texts and empty lists
    WHEN they are exported as Parquet, some without a message
    THEN pandas and polars read every file, time first, enumerations as categories.
    """
    pytest.importorskip("pyarrow")
    read = pytest.importorskip(library).read_parquet
    log = open_log(record(tmp_path / "a.mcap", flight(0.5)))
    files = export(log, tmp_path / "all", form="parquet").files
    files += export(log, tmp_path / "late", Part(None, 0.499), "parquet").files
    files += export(foreign(tmp_path / "b.mcap"), tmp_path / "foreign", form="parquet").files
    tables = {file.stem: read(file) for file in files if file.parent.name != "late"}
    assert all(next(iter(read(file).columns)) == "time" for file in files)
    assert len(tables) == len(log.topics) + 1
    assert "ategor" in str(tables["guidance_navigation"]["mode_name"].dtype)
    assert np.array_equal(tables["json"]["time"], 0.1 * np.arange(20.0))


def test_every_form_has_time_and_enumeration_names(tmp_path: Path) -> None:
    """GIVEN modes 4 (AUTO) and 99 (no such mode) WHEN exported THEN every form has `time` and `mode_name`."""
    message = topics.NAVIGATION.message
    first = message(*([0] * len(message._fields)))._replace(time_us=1_500_000, mode=4)
    messages = [(topics.NAVIGATION, first), (topics.NAVIGATION, first._replace(time_us=2_000_000, mode=99))]
    log = open_log(record(tmp_path / "a.mcap", messages))
    (row, other) = rows_of(export(log, tmp_path / "a.csv").files[0])
    assert next(iter(row)) == "time [s]" and [row["time [s]"], other["time [s]"]] == ["1.5", "2.0"]
    assert [row["mode_name"], other["mode_name"], row["mode"]] == ["AUTO", "99", "4"]
    with np.load(export(log, tmp_path / "a.npz").files[0], allow_pickle=False) as arrays:
        assert arrays["guidance_navigation/time"].tolist() == [1.5, 2.0]
        assert arrays["guidance_navigation/mode_name"].tolist() == ["AUTO", "99"]
    struct = loadmat(export(log, tmp_path / "a.mat").files[0])["guidance_navigation"][0, 0]
    assert struct["time"][:, 0].tolist() == [1.5, 2.0] and struct["mode_name"][0, 0][0] == "AUTO"
    pytest.importorskip("pandas")
    for frame in (log.frame(topics.NAVIGATION), log.columns(topics.NAVIGATION).to_pandas()):
        assert frame.index.name == "time" and frame.index.tolist() == [1.5, 2.0]
        assert frame["mode_name"].tolist() == ["AUTO", "99"] and frame["mode_name"].dtype == "category"


# --- parts of a log, one table --------------------------------------------------------------------------


def test_a_window_of_every_topic(log: Log, tmp_path: Path) -> None:
    with np.load(export(log, tmp_path / "a.npz", Part(None, 0.5, 1.0)).files[0]) as arrays:
        assert arrays["main_wing/time_us"].tolist() == list(range(500_000, 1_000_000, 5_000))


def test_what_is_not_meant_is_refused_in_one_line(log: Log, tmp_path: Path) -> None:
    for target, part, said in (
        (tmp_path / "a.npz", Part(["/main/wing.phase"]), "/main/wing.phase: a field alone goes into one table"),
        (tmp_path / "a.xyz", Part(), r"a.xyz: no export as .xyz; there are csv"),
    ):
        with pytest.raises(InputError, match=said):
            export(log, target, part)
    assert list(tmp_path.iterdir()) == []


def test_one_table_at_one_rate(log: Log, tmp_path: Path) -> None:
    part = Part(["/main/wing.angle_left", "/guidance/navigation"], 0.5, 1.5, 100.0)
    rows = rows_of(export(log, tmp_path / "a.csv", part).files[0])
    wing = log.columns(topics.WING, 0.5, 1.5)
    assert [float(row["time [s]"]) for row in rows] == pytest.approx(wing.time[::2].tolist())
    assert [float(row["/main/wing.angle_left [rad]"]) for row in rows] == wing["angle_left"][::2].tolist()
    assert set(rows[0]) >= {"/guidance/navigation.mode", "/guidance/navigation.distance [m]"}
    with np.load(export(log, tmp_path / "a.npz", part).files[0]) as arrays:
        assert arrays["aligned/main/wing.angle_left"].tolist() == wing["angle_left"][::2].tolist()
        assert ["main/wing.angle_left", "rad"] in arrays["aligned/units"].tolist()
    struct = loadmat(export(log, tmp_path / "a.mat", part).files[0])["aligned"][0, 0]
    assert np.array_equal(struct["main_wing_angle_left"][:, 0], wing["angle_left"][::2])


def test_one_table_of_everything_leaves_out_what_is_no_series_of_numbers(log: Log, tmp_path: Path) -> None:
    rows = rows_of(export(log, tmp_path / "a.csv", Part(rate=50.0)).files[0])
    names = set(rows[0])
    assert {"/main/wing.phase [rad]", "/sensors/adc.voltage_counts_59 [counts]"} <= names
    assert not any(name.startswith("/system/events") for name in names)
    other = rows_of(export(foreign(tmp_path / "a.mcap"), tmp_path / "b.csv", Part(rate=10.0)).files[0])
    assert other[2]["/json.name"] == "n2"


def test_one_file_holds_one_table(log: Log, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is one file for 5 topics: name a folder, one topic or a rate"):
        export(log, tmp_path / "a.csv")
    (path,) = export(log, tmp_path / "a.csv", Part(["/main/wing"])).files
    assert len(rows_of(path)) == 400
    with pytest.raises(InputError, match="no export as xls; there are csv, parquet, npz, mat"):
        export(log, tmp_path / "b", form="xls")
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("form", FORMS)
def test_no_form_overwrites(log: Log, tmp_path: Path, form: str) -> None:
    if form == "parquet":
        pytest.importorskip("pyarrow")
    taken = tmp_path / f"a.{form}"
    taken.write_text("precious")
    with pytest.raises(InputError, match="exists"):
        export(log, taken, Part(["/main/wing"]))
    assert taken.read_text() == "precious" and list(tmp_path.iterdir()) == [taken]


def test_what_cannot_be_decoded_is_left_out_and_told(tmp_path: Path) -> None:
    log = foreign(tmp_path / "a.mcap")
    done = export(log, tmp_path / "out")
    assert [file.name for file in done.files] == ["json.csv"]
    assert len(done.left_out) == 1 and "/blob is encoded as flatbuffer" in done.left_out[0]
    rows = rows_of(done.files[0])
    assert (
        rows[2]["time [s]"] == "0.2"
        and rows[2]["message_time"] == "2"
        and rows[2]["b.c"] == "2.5"
        and rows[2]["list"] == "[1, 1]"
    )
    with pytest.raises(InputError, match="/blob is encoded as flatbuffer"):
        export(log, tmp_path / "b", Part(["/blob"]))


def test_a_folder_of_every_topic_shows_how_far_it_is(log: Log, tmp_path: Path) -> None:
    seen: list[tuple[float, float, str]] = []
    done = export(log, tmp_path / "out", show=lambda *progress: seen.append(progress))
    assert [what for *_, what in seen] == list(log.topics)
    assert len(done.files) == len(SOME) == int(seen[-1][1])


# --- data frames ----------------------------------------------------------------------------------------


def test_a_frame_of_pandas(log: Log) -> None:
    pytest.importorskip("pandas")
    wing, columns = log.frame(topics.WING, start=0.5, end=1.0), log.columns(topics.WING, 0.5, 1.0)
    assert wing.index.name == "time" and np.array_equal(wing.index, columns.time)
    assert np.array_equal(wing["phase"], columns["phase"]) and wing.attrs["units"]["phase"] == "rad"
    adc = log.frame("/sensors/adc")
    assert np.array_equal(adc["voltage_counts_59"], log.columns(topics.ADC)["voltage_counts"][:, 59])
    assert log.frame(topics.EVENTS)["message"].tolist() == [event.text for event in log.events()]


def test_a_frame_of_polars(log: Log, tmp_path: Path) -> None:
    pytest.importorskip("polars")
    wing, columns = log.frame(topics.WING, "polars"), log.columns(topics.WING)
    assert wing.columns == ["time", *columns] and np.array_equal(wing["time"].to_numpy(), columns.time)
    assert np.array_equal(wing["strokes"].to_numpy(), columns["strokes"])
    assert log.frame(topics.EVENTS, "polars")["message"].to_list() == [event.text for event in log.events()]
    other = foreign(tmp_path / "a.mcap").frame("/json", "polars")
    assert other["time"].to_list()[:2] == pytest.approx([0.0, 0.1]) and other["list"][2] == "[1, 1]"


def test_what_installs_a_package_is_the_pip_of_the_python_that_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "executable", str(tmp_path / ".venv" / "bin" / "python"))
    rerun, polars = (
        next(line for line in metadata.requires("wingbeat") or [] if line.startswith(name)).partition(";")[0].strip()
        for name in ("rerun-sdk", "polars")
    )
    assert ">=" in rerun and ">=" in polars
    assert pip_install(["rerun-sdk", "polars"]) == f".venv/bin/python -m pip install '{rerun}' '{polars}'"
    monkeypatch.setattr(sys, "executable", "/opt/a place/python3")
    assert pip_install(["dask"]) == "'/opt/a place/python3' -m pip install dask", "not dask[distributed]"


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_without_the_library_a_frame_is_one_line(log: Log, library: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(
        InputError, match=rf"a data frame needs {library}, which is not installed: \S+ -m pip install '?{library}\S*$"
    ):
        log.frame(topics.WING, library)


def test_frames_of_an_unknown_library(log: Log) -> None:
    with pytest.raises(InputError, match="no data frames of excel; there are those of pandas and polars"):
        log.frame(topics.WING, "excel")


# --- names that meet ------------------------------------------------------------------------------------


def meeting(path: Path) -> Log:
    """Topics whose plain names are the same, and a field that is called as the list of units is."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for value, topic in enumerate(("/a/b", "/a_b", "/a_b_2")):
            channel = writer.register_channel(topic, "json", 0)
            writer.add_message(channel, 0, json.dumps({"x": value, "units": 7}).encode(), 0)
        writer.finish()
    return open_log(path)


def test_topics_of_one_plain_name_are_all_in_the_npz(tmp_path: Path) -> None:
    log = meeting(tmp_path / "a.mcap")
    export(log, tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz", allow_pickle=False) as arrays:
        assert [arrays[f"{name}/x"].tolist() for name in ("a_b", "a_b_2", "a_b_2_2")] == [[0], [1], [2]]
        assert arrays["a_b/units_2"].tolist() == [7]
        assert ["units_2", "-"] in arrays["a_b/units"].tolist()


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_topics_of_one_plain_name_have_a_file_each(tmp_path: Path, form: str) -> None:
    if form == "parquet":
        pytest.importorskip("pyarrow")
    files = export(meeting(tmp_path / "a.mcap"), tmp_path / "out", form=form).files
    assert [path.name for path in files] == [f"{name}.{form}" for name in ("a_b", "a_b_2", "a_b_2_2")]
    assert all(path.stat().st_size for path in files)

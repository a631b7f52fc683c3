"""What all tests share."""

import gc
import os
import tempfile
import time
from collections.abc import Generator
from pathlib import Path

import pytest
from hypothesis import settings

# No test reads or writes the parameters that a user keeps.
STATE = tempfile.TemporaryDirectory(prefix="wingbeat-state-", ignore_cleanup_errors=True)
os.environ["WINGBEAT_STATE"] = STATE.name

# The clients that tests build from pymavlink speak MAVLink 2, whichever file imports it first.
os.environ["MAVLINK20"] = "1"

# Matrices here are small: the threads that would share one spin while they wait for each other, which takes several
# times the processor time of the work, from the other workers. Processes that tests start inherit it.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# A machine that is busy with something else makes a test late, not wrong. `make validate` draws ten times as many
# examples of each property (`--hypothesis-profile=thorough`).
settings.register_profile("quick", deadline=None, max_examples=25)
settings.register_profile("thorough", deadline=None, max_examples=250)
settings.load_profile("quick")

LONG = (
    "tests/wingbeat/test_api.py",
    "tests/wingbeat/test_gym_vector.py",
    "tests/logs/identification/test_aided_fit.py",
    "tests/groundstation/test_fly.py",
    "tests/logs/identification/test_tables_identified.py",
    "tests/logs/identification/test_identification_short_period.py",
    "tests/sitl/",
    "tests/clients/",
    "tests/sim_bridge/test_aerodynamics.py",
    "tests/sim_bridge/test_validation.py",
    "tests/sim_bridge/test_compiled_cache.py",
    "tests/groundstation/test_lattice_pictures.py",
    "tests/replay/test_replay_flight.py",
    "tests/test_words.py",
    "tests/sim_bridge/test_tuning_cascade.py",
    "tests/sim_bridge/test_trim.py",
    "tests/avionics/test_autopilot_flights.py",
    "tests/avionics/test_piloting.py",
)
"""by what their tests and the kernels that they compile take, the longest first"""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--bench-table", metavar="FILE", help="replace the table of benchmarks in this file")


def pytest_unconfigure() -> None:
    """A worker ends without Python's own tidying."""
    STATE.cleanup()


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Next to nothing becomes garbage while tests are collected: to look for it takes a seventh of that time."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Long files first where workers share the tests, so that none is left alone with one at the end."""
    if hasattr(config, "workerinput"):
        items.sort(
            key=lambda item: next((n for n, path in enumerate(LONG) if item.nodeid.startswith(path)), len(LONG))
        )


def pytest_collection_finish() -> None:
    """Modules and tests stay to the end: the collector need not look through them again during every flight."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(10_000, 20, 20)


@pytest.fixture(scope="session")
def standard_flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the recording of ``wingbeat fly`` with seed 1, flown once for all workers; tests do not change it."""
    import wingbeat

    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    log, flying = folder / "standard_flight.mcap", folder / "standard_flight.flying"
    try:
        flying.touch(exist_ok=False)
    except FileExistsError:
        deadline = time.monotonic() + 300.0
        while not log.exists():
            assert time.monotonic() < deadline, "the worker that flies it has failed"
            time.sleep(0.1)
    else:
        wingbeat.fly(seed=1, log=folder / "standard_flight.part.mcap").log.close()
        (folder / "standard_flight.part.mcap").rename(log)
    return log

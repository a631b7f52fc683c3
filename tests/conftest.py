"""What all tests share."""

import gc
import os
import tempfile

import pytest
from hypothesis import settings

# No test reads or writes the parameters that a user keeps.
os.environ["WINGBEAT_STATE"] = tempfile.mkdtemp(prefix="wingbeat-state-")

# The clients that tests build from pymavlink speak MAVLink 2, whichever file imports it first.
os.environ["MAVLINK20"] = "1"

# Matrices here are small: the threads that would share one spin while they wait for each other, which takes several
# times the processor time of the work, from the other workers. Processes that tests start inherit it.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# A machine that is busy with something else makes a test late, not wrong.
settings.register_profile("unhurried", deadline=None)
settings.load_profile("unhurried")

LONG = (
    "tests/sitl/",
    "tests/groundstation/test_fly.py",
    "tests/sim_bridge/test_tuning_cascade.py",
    "tests/sim_bridge/test_trim.py",
    "tests/avionics/test_autopilot_flights.py",
    "tests/avionics/test_piloting.py",
)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--bench-table", metavar="FILE", help="replace the table of benchmarks in this file")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Long files first where workers share the tests, so that none is left alone with one at the end."""
    if hasattr(config, "workerinput"):
        items.sort(key=lambda item: not item.nodeid.startswith(LONG))


def pytest_collection_finish() -> None:
    """Modules and tests stay to the end: the collector need not look through them again during every flight."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(10_000, 20, 20)

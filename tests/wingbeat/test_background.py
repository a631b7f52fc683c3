"""Computation beside the caller: in a forked process, or in a thread where none may be forked."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys

import pytest

from wingbeat import background
from wingbeat.background import run_in_background
from wingbeat.errors import InputError

FORK = pytest.mark.skipif(sys.platform != "linux", reason="processes are forked on Linux alone")


@pytest.fixture(params=[pytest.param(2, marks=FORK), 1], ids=["process", "thread"])
def cores(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    """Two cores, of which a forked process gets one, or one."""
    monkeypatch.setattr(background, "available_cores", lambda: request.param)
    return int(request.param)


def test_it_goes_on_while_other_work_is_done(cores: int) -> None:
    other = multiprocessing.Event()
    result = run_in_background(lambda: (other.wait(10.0), os.getpid()))
    other.set()
    waited, place = result()
    assert waited
    assert (place != os.getpid()) == (cores > 1)
    assert result()[1] == place


def test_what_it_raises_is_raised_where_its_result_is_asked_for(cores: int) -> None:
    def refuse() -> int:
        raise InputError("no flight")

    result = run_in_background(refuse)
    with pytest.raises(InputError, match="no flight"):
        result()


@FORK
@pytest.mark.parametrize("by", [signal.SIGKILL, signal.SIGINT])
def test_a_killed_process_is_made_up_for(
    by: signal.Signals, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(background, "available_cores", lambda: 2)
    caller = os.getpid()

    def work() -> str:
        if os.getpid() != caller:
            os.kill(os.getpid(), by)
        return "done"

    assert run_in_background(work)() == "done"
    assert capfd.readouterr() == ("", "")


@FORK
def test_a_process_that_does_not_answer_is_made_up_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(background, "available_cores", lambda: 2)
    monkeypatch.setattr(background, "PATIENCE", 0.05)
    caller, never = os.getpid(), multiprocessing.Event()
    assert run_in_background(lambda: os.getpid() == caller or never.wait(60.0))()

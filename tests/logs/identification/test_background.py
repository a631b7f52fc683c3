"""Computation in a background thread."""

from __future__ import annotations

import threading

import pytest

from logs.identification.report.background import run_in_background
from wingbeat.errors import InputError


def test_it_goes_on_while_other_work_is_done() -> None:
    other = threading.Event()
    result = run_in_background(lambda: other.wait(10.0) and threading.current_thread().name)
    other.set()
    assert result() == "background"
    assert result() == "background"


def test_what_it_raises_is_raised_where_its_result_is_asked_for() -> None:
    def refuse() -> int:
        raise InputError("no flight")

    result = run_in_background(refuse)
    with pytest.raises(InputError, match="no flight"):
        result()

"""Work that goes on beside other work."""

from __future__ import annotations

import threading

import pytest

from logs.identification.report.background import begun
from wingbeat.errors import InputError


def test_it_goes_on_while_other_work_is_done() -> None:
    other = threading.Event()
    result = begun(lambda: other.wait(10.0) and threading.current_thread().name)
    other.set()
    assert result() == "beside"
    assert result() == "beside"


def test_what_it_raises_is_raised_where_its_result_is_asked_for() -> None:
    def refuse() -> int:
        raise InputError("no flight")

    result = begun(refuse)
    with pytest.raises(InputError, match="no flight"):
        result()

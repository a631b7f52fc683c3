"""The flight code as Python and compiled, the same flights in turn."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest
from rows import Row, leave

from tests.built_wheel import ROOT, build_wheel, install_wheel, run_installed

MEASURE = """
import json, sys
from pathlib import Path
sys.path += json.loads(sys.argv[1])
import numpy as np
import test_flight_speed as speed
flight = speed.Parts()
ticks = np.min([flight.again() for _ in range(speed.AGAIN)], axis=0)
log = Path(sys.argv[2])
log.mkdir()
found = {"mean": ticks.mean(), "median": np.median(ticks)}
found |= {"logging": speed.PART / speed.quickest(log), "no log": speed.PART / speed.quickest(None)}
print(json.dumps(found))
"""
TURNS = 2
FASTER = 1.25
"""-; asked: mean tick of Python over that of compiled code"""


@pytest.mark.bench
def test_compiled_flight_code_beside_python(tmp_path: Path) -> None:
    (tmp_path / "wheel").mkdir()
    wheel = build_wheel(tmp_path / "wheel", compiled=True)
    folders = {"Python": ROOT, "compiled": install_wheel(wheel, tmp_path / "compiled")}
    tests = json.dumps([str(ROOT / "tests" / "benchmarks"), str(ROOT)])
    found: dict[str, list[dict[str, float]]] = {name: [] for name in folders}
    for turn in range(TURNS):
        for name, folder in folders.items():
            printed = run_installed(folder, "-c", MEASURE, tests, str(tmp_path / f"{name}{turn}"))
            found[name].append(json.loads(printed.splitlines()[-1]))

    def best(what: str, of: Callable[[Iterable[float]], float]) -> tuple[float, float]:
        compiled, python = (of(one[what] for one in found[name]) for name in ("compiled", "Python"))
        return compiled, python

    mean, of_python = best("mean", min)
    asked = f"at most {1 / FASTER:.0%} of Python's"
    leave(Row("flight computer's tick, compiled, mean", mean, of_python, "us", "Python", asked))
    leave(Row("flight computer's tick, compiled, median", *best("median", min), "us", "Python"))
    for log in ("logging", "no log"):
        leave(Row(f"flight in one process, {log}, compiled", *best(log, max), "times real time", "Python"))
    assert FASTER * mean <= of_python

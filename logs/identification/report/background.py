"""Work that goes on beside other work."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TypeVar

Result = TypeVar("Result")


def begun(work: Callable[[], Result]) -> Callable[[], Result]:
    """Begin with ``work`` in a thread; what is called for its result waits, and raises what it raised.

    Who is interrupted meanwhile, or fails in another way, does not wait for it: it ends with the process.
    """
    results, failures = list[Result](), list[BaseException]()

    def run() -> None:
        try:
            results.append(work())
        except BaseException as error:
            failures.append(error)

    thread = threading.Thread(target=run, name="beside", daemon=True)
    thread.start()

    def result() -> Result:
        thread.join()
        if failures:
            raise failures[0]
        return results[0]

    return result

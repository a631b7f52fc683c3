"""Computation beside the caller: on another core where a process can be forked, in a thread elsewhere."""

from __future__ import annotations

import multiprocessing
import sys
import threading
import warnings
from collections.abc import Callable
from functools import cache
from typing import TypeVar

from wingbeat.cores import available_cores

Result = TypeVar("Result")
PATIENCE = 120.0
"""s; for the result of a process after it is asked for, beyond which the caller computes it itself"""


def run_in_background(work: Callable[[], Result]) -> Callable[[], Result]:
    """Start ``work``; the returned function waits for its result or raises its exception.

    The result must be picklable; what ``work`` changes besides may be lost. The caller's process does not wait for it
    at its end.
    """
    # Workers of a pool may not fork, and use every core already.
    pooled = multiprocessing.current_process().daemon
    return _forked(work) if sys.platform == "linux" and available_cores() > 1 and not pooled else _threaded(work)


def _forked(work: Callable[[], Result]) -> Callable[[], Result]:
    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)

    def run() -> None:
        try:
            sender.send((work(), None))
        except KeyboardInterrupt:  # of the whole terminal: the caller tells it
            pass
        except Exception as error:
            sender.send((None, error))

    process = context.Process(target=run, daemon=True)
    with warnings.catch_warnings():
        # Since Python 3.12, for a process with threads. The fork computes only: it needs none of their locks.
        warnings.simplefilter("ignore", DeprecationWarning)
        process.start()
    sender.close()

    def result() -> Result:
        try:
            if not receiver.poll(PATIENCE):  # a lock that another thread held at the fork is never released in it
                process.kill()
            found, error = receiver.recv()
        except EOFError:  # it was killed
            return work()
        finally:
            receiver.close()
        process.join()
        if error is not None:
            raise error
        done: Result = found
        return done

    return cache(result)


def _threaded(work: Callable[[], Result]) -> Callable[[], Result]:
    results, failures = list[Result](), list[BaseException]()

    def run() -> None:
        try:
            results.append(work())
        except BaseException as error:
            failures.append(error)

    thread = threading.Thread(target=run, name="background", daemon=True)
    thread.start()

    def result() -> Result:
        thread.join()
        if failures:
            raise failures[0]
        return results[0]

    return result

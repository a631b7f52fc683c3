"""Write queue in a thread, so that a flight does not wait for the disk."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable

PATIENCE = 10.0
"""s; timeout of the end of a recording if the disk does not respond"""


class Backlog:
    """Worker thread that runs jobs in order from a queue with a limit in bytes."""

    def __init__(
        self, capacity: int, idle: Callable[[], None], period: float, failed: Callable[[BaseException], None]
    ) -> None:
        """Start the thread.

        Args:
            capacity: bytes; limit of the jobs that are queued or running.
            idle: called by the thread after each ``period`` without a job; must not block.
            period: s.
            failed: called with an exception of a job or ``idle``; the thread then stops and drops the queue.
        """
        self._capacity = capacity
        self._idle, self._period, self._failed = idle, period, failed
        self._jobs: deque[tuple[Callable[[], None], int]] = deque()
        self._turn = threading.Condition()
        self._bytes = 0
        self._ending = self._dead = False
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        """Bytes of queued and running jobs."""
        return self._bytes

    def offer(self, job: Callable[[], None], size: int, timeout: float = 0.0) -> bool:
        """Queue a job of ``size`` bytes; return False if the queue has no capacity within ``timeout`` s.

        A job larger than the queue is accepted only if no other job is pending. No job is accepted after the thread
        has stopped.
        """

        def has_capacity() -> bool:
            return self._dead or not self._bytes or self._bytes + size <= self._capacity

        with self._turn:
            found = has_capacity() or (timeout and self._turn.wait_for(has_capacity, timeout))
            if self._dead or not found:
                return False
            self._jobs.append((job, size))
            self._bytes += size
            self._turn.notify_all()
        return True

    def close(self) -> bool:
        """Wait until all jobs are done; return False if that takes longer than `PATIENCE`."""
        with self._turn:
            self._ending = True
            self._turn.notify_all()
        self._thread.join(PATIENCE)
        return not self._thread.is_alive()

    def _work(self) -> None:
        try:
            self._turns()
        except BaseException as error:
            self._failed(error)
            with self._turn:
                self._dead = True
                self._jobs.clear()
                self._bytes = 0
                self._turn.notify_all()

    def _turns(self) -> None:
        while True:
            with self._turn:
                waited = self._jobs or self._ending or self._turn.wait(self._period)
                if self._ending and not self._jobs:
                    return
                job, size = self._jobs.popleft() if self._jobs else (None, 0)
            if job is not None:
                self._do(job, size)
            elif not waited:
                self._idle()

    def _do(self, job: Callable[[], None], size: int) -> None:
        try:
            job()
        finally:
            with self._turn:
                self._bytes -= size
                self._turn.notify_all()

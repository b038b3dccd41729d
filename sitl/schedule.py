"""What happens when, in vehicle time: tasks in order of time, then rank, then the order in which they were added."""

from __future__ import annotations

import heapq
from collections.abc import Callable

# Rank of tasks at the same instant: readings are taken and handed over, the firmware acts on them, then it reports.
SENSE, HAND_OVER, FLY, REPORT = range(4)

Task = Callable[[int], int | None]


class Schedule:
    """Tasks by vehicle time. A task is called with the time and returns when it wants to run next, or None."""

    def __init__(self) -> None:
        self._heap: list[tuple[int, int, int, Task]] = []
        self._added = 0

    def add(self, due_us: int, rank: int, task: Task) -> None:
        """Run a task at a time; the same or an earlier instant means as soon as possible."""
        self._added += 1
        heapq.heappush(self._heap, (due_us, rank, self._added, task))

    def next_us(self) -> int | None:
        """When the next task is due."""
        return self._heap[0][0] if self._heap else None

    def run_due(self, until_us: int, time_us: int) -> None:
        """Run all tasks due up to ``until_us``, telling them that it is ``time_us``."""
        heap = self._heap
        while heap and heap[0][0] <= until_us:
            _, rank, order, task = heapq.heappop(heap)
            again = task(time_us)
            if again is not None:
                heapq.heappush(heap, (again, rank, order, task))

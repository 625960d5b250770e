"""What is still to be done, and what of it may begin: a task waits for those that it needs, and fails with them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from svbrdfgan.experiments.tasks import Task


class Schedule:
    """Tasks in order of preference. Several may be taken at once; who takes one tells how it ended."""

    def __init__(self, tasks: Iterable[Task]) -> None:
        self._waiting = {task.folder: task for task in tasks}
        self._open = set(self._waiting)

    def __len__(self) -> int:
        """How many have not ended."""
        return len(self._open)

    def take(self) -> Task | None:
        """The first that may begin; None while there is none."""
        for task in self._waiting.values():
            if not self._open & set(task.needs):
                return self._waiting.pop(task.folder)
        return None

    def end(self, task: Task, reason: str | None) -> Iterator[tuple[Task, str | None]]:
        """Those that are over with it, itself first: where it failed for a reason, also those that need it."""
        self._open.discard(task.folder)
        yield task, reason
        if reason is None:
            return
        for other in list(self._waiting.values()):
            if task.folder in other.needs and self._waiting.pop(other.folder, None) is not None:
                yield from self.end(other, f"{task.title}: {reason}")

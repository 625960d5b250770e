"""The process of one task: `python -m svbrdfgan.experiments.job PARENT` reads the task, as JSON, from stdin."""

from __future__ import annotations

import logging
import os
import signal
import sys
import time
from threading import Thread

from svbrdfgan.errors import SvbrdfganError

_PARENT_CHECK_SECONDS = 0.5


def end_with_parent(parent: int) -> None:
    """Starts a thread that kills this process and its children when its parent dies. Does nothing outside POSIX.

    Otherwise the tasks of a killed `svbrdfgan experiment` would continue to write into folders that the next call uses.

    Args:
        parent: id of the process that started this one; it may be dead already. The process that calls must lead a
            process group of its own.
    """
    if os.name == "posix":
        Thread(target=_watch, args=[parent], daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:  # a process whose parent dies gets another parent
        time.sleep(_PARENT_CHECK_SECONDS)
    os.killpg(0, signal.SIGKILL)


def main() -> None:
    end_with_parent(int(sys.argv[1]))
    from svbrdfgan.experiments.tasks import TASK  # imports torch, which takes seconds; the parent may die in them

    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", stream=sys.stdout)
    task = TASK.validate_json(sys.stdin.read())
    try:
        task.work()
    except SvbrdfganError as error:
        sys.exit(" ".join(str(error).split()))


if __name__ == "__main__":
    main()

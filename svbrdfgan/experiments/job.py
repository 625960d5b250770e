"""The process of one task: `python -m svbrdfgan.experiments.job PARENT` reads the task, as JSON, from stdin."""

from __future__ import annotations

import logging
import sys

from svbrdfgan.errors import SvbrdfganError
from svbrdfgan.utils.processes import end_with_parent


def main() -> None:
    end_with_parent(int(sys.argv[1]))  # else tasks of a killed command would write into folders that the next call uses
    from svbrdfgan.experiments.tasks import TASK  # imports torch, which takes seconds; the parent may die in them

    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", stream=sys.stdout)
    task = TASK.validate_json(sys.stdin.read())
    try:
        task.work()
    except SvbrdfganError as error:
        sys.exit(" ".join(str(error).split()))


if __name__ == "__main__":
    main()

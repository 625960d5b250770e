"""`python -m svbrdfgan.experiments.job PARENT`: does the task that stdin describes, for the process of that number."""

from __future__ import annotations

import logging
import sys

from svbrdfgan.errors import SvbrdfganError
from svbrdfgan.experiments.parent_death_guard import end_with_parent
from svbrdfgan.experiments.tasks import Order


def main() -> None:
    end_with_parent(int(sys.argv[1]))
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", stream=sys.stdout)
    task = Order.model_validate_json(sys.stdin.read()).task
    try:
        task.work()
    except SvbrdfganError as error:
        sys.exit(" ".join(str(error).split()))


if __name__ == "__main__":
    main()

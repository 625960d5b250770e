"""Processes that torchrun has started: which one this is, and how all end when one does."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import timedelta
from typing import TYPE_CHECKING

from svbrdfgan.errors import ConfigError

if TYPE_CHECKING:
    from torch.distributed import TCPStore

_VARIABLES = ("RANK", "WORLD_SIZE", "LOCAL_WORLD_SIZE")
_PLACE = ("LOCAL_RANK", "MASTER_ADDR", "MASTER_PORT")
_FAILED = "svbrdfgan/failed"
"""The key in torchrun's store that counts processes that have failed, or have heard of it."""
_POLL_SECONDS = 0.25
_LINGER_SECONDS = 3.0
"""How long one that failed waits for the others to hear of it, since the store may end with it."""
_REACH = timedelta(seconds=5)


@dataclass(frozen=True)
class Rank:
    """The number of this process, from 0 on, of so many in all, and of so many on this machine."""

    number: int
    processes: int
    processes_here: int


def torchrun_rank() -> Rank | None:
    """The rank that torchrun's variables give this process; None if there are none, or it is the only one.

    Raises:
        ConfigError: machines have different numbers of processes, or a variable is no number.
    """
    if not all(map(os.environ.get, _VARIABLES + _PLACE)):
        return None
    try:
        rank = Rank(*(int(os.environ[name]) for name in _VARIABLES))
    except ValueError as error:
        raise ConfigError(f"torchrun's {', '.join(_VARIABLES)} must be whole numbers: {error}.") from error
    if rank.processes == 1:
        return None
    if rank.processes % rank.processes_here:
        raise ConfigError(
            f"torchrun started {rank.processes} processes, and {rank.processes_here} of them here: wanted as many "
            "on every machine (--nproc-per-node)."
        )
    return rank


class Alarm:
    """Tells the processes of torchrun of one that has failed."""

    def __init__(self, rank: Rank) -> None:
        self._processes = rank.processes

    def raise_(self) -> bool:
        """Whether this process is the first to fail, and so is to say why."""
        with suppress(RuntimeError):  # the store is gone with the first process's machine
            return _store().add(_FAILED, 1) == 1
        return True

    def linger(self) -> None:
        """Waits some seconds for the others to have heard of it."""
        with suppress(RuntimeError):
            store, until = _store(), time.monotonic() + _LINGER_SECONDS
            while store.add(_FAILED, 0) < self._processes and time.monotonic() < until:
                time.sleep(_POLL_SECONDS)

    @contextmanager
    def heard(self) -> Iterator[None]:
        """For the time of the block, this process ends without a word when another one has failed.

        One that waits for the failed one on a GPU would not notice otherwise before a timeout of half an hour.
        """
        over = threading.Event()
        threading.Thread(target=_listen, args=[_store(), over], daemon=True).start()
        try:
            yield
        finally:
            over.set()


def _listen(store: TCPStore, over: threading.Event) -> None:
    with suppress(RuntimeError):
        while not over.wait(_POLL_SECONDS):
            if store.add(_FAILED, 0) and not over.is_set():
                store.add(_FAILED, 1)
                os._exit(1)


def _store() -> TCPStore:
    """A connection of its own to the store of torchrun."""
    from torch.distributed import TCPStore

    return TCPStore(os.environ["MASTER_ADDR"], int(os.environ["MASTER_PORT"]), is_master=False, timeout=_REACH)


def lost_process(error: RuntimeError) -> bool:
    """Whether it says that another process is gone, or cannot be reached."""
    from torch.distributed import DistError

    return isinstance(error, DistError) or "gloo" in str(error).lower()

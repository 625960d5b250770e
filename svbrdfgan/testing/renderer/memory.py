"""How much memory is allocated: not the process's pages, which swing by megabytes, as allocators keep what is freed."""

from __future__ import annotations

import ctypes
import gc
import unittest

import torch

_FIELDS = ("arena", "ordblks", "smblks", "hblks", "hblkhd", "usmblks", "fsmblks", "uordblks", "fordblks", "keepcost")


class _Mallinfo(ctypes.Structure):
    """glibc's `struct mallinfo2`."""

    _fields_ = [(name, ctypes.c_size_t) for name in _FIELDS]


def memory() -> dict[str, int]:
    """Bytes allocated and not freed: by the process from the C library, and by torch on the GPU.

    Raises:
        unittest.SkipTest: the C library does not say; glibc does, since 2.33.
    """
    gc.collect()
    try:
        mallinfo = ctypes.CDLL(None).mallinfo2
    except (AttributeError, OSError, TypeError) as error:
        raise unittest.SkipTest("what a process has allocated is asked of glibc 2.33 or later") from error
    mallinfo.restype = _Mallinfo
    said = mallinfo()
    gpu = torch.cuda.memory_allocated() if torch.cuda.is_available() else 0
    return {"in memory": said.uordblks + said.hblkhd, "on the GPU": gpu}

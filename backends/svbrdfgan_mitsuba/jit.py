"""Dr.Jit and Mitsuba, imported with a good LLVM where there is one."""

import importlib
from typing import Any

from svbrdfgan_mitsuba import llvm

dr: Any = llvm.import_drjit()
mitsuba: Any = importlib.import_module("mitsuba")

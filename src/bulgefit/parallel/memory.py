"""How does memory that is free get back to the system, for the processes beside this one?"""

from __future__ import annotations

import ctypes
import sys
from concurrent.futures import Executor

from bulgefit.parallel.processes import Processes

__all__ = ["give_back"]


def give_back(executor: Executor | None = None) -> None:
    """Let the allocator part with what it holds of freed memory, where it is asked to: glibc.

    It keeps what lies between pieces in use, a third of a process that has fitted large models.

    Parameters
    ----------
    executor : concurrent.futures.Executor, optional
        Whose processes have nothing to do for a while: those of our own end, with what they were
        last sent.
    """
    if isinstance(executor, Processes):
        executor.rest()
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # other libraries have none
        if trim is not None:
            trim(0)

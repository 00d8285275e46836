"""This process, once it holds a key: nothing of its memory goes to a core dump or to another process of the same user.

The service's unit keeps it out of swap, too (MemorySwapMax); a program that is started by hand may be swapped.
"""

from __future__ import annotations

import contextlib
import resource

PR_SET_DUMPABLE = 4  # Linux, prctl.h


def harden_process() -> str:
    """No core dump from now on, by whatever signal. Returns what could not be had, in words, or nothing.

    The limit alone does not do: a core that the kernel pipes to a program (systemd-coredump, apport) ignores it. A
    process that is not dumpable has no core, and no other process of its user may look into it (ptrace, /proc).
    """
    with contextlib.suppress(OSError, ValueError):  # the service's unit forbids the call, and has set the limit
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    try:
        import ctypes

        if ctypes.CDLL(None).prctl(PR_SET_DUMPABLE, 0, 0, 0, 0) == 0:
            return ""
    except (ImportError, OSError, AttributeError, MemoryError):
        pass
    return "core dumps are limited to 0 bytes; one that is piped to a program is not disabled (PR_SET_DUMPABLE)"

"""The machine, and what else it was doing, for the record."""

from __future__ import annotations

import os
import platform
from pathlib import Path


def machine() -> str:
    """The machine in a line, for the record."""
    model = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [line.split(":")[1].strip() for line in cpuinfo.read_text().splitlines() if "model name" in line]
        model = names[0] if names else model
    return f"{model}, {os.cpu_count()} cores, Python {platform.python_version()}, {platform.system()}"


def conditions() -> str:
    """The machine, how busy it is, and whether this process goes before others."""
    first = os.sched_getscheduler(0) in (os.SCHED_FIFO, os.SCHED_RR)
    return f"{machine()}; load {os.getloadavg()[0]:.1f}, {'real-time' if first else 'ordinary'} priority"

"""Puts this process on one core. Import it before any peer: their thread pools (OpenMP, TBB) are sized once, when they are loaded."""

import os

CORES = sorted(os.sched_getaffinity(0))
os.environ["OMP_NUM_THREADS"] = "1"
os.sched_setaffinity(0, CORES[:1])

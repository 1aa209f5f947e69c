"""`arthro register SOURCE TARGET --json`, one process a case, from files to answer."""

import contextlib
import dataclasses
import json
import os
import subprocess
import time

import numpy as np

from dataset import FREE_SCALE
from scoring import Answer
from similarity import Similarity

TIMEOUT_S = 120
KEYS = ("scale", "rotation", "translation_mm", "verdict", "reasons")
VERDICTS = ("ACCEPT", "REVIEW", "REJECT")


@dataclasses.dataclass(frozen=True)
class Arthro:
    """The binary, and the cores it may use."""

    path: str
    cores: frozenset

    def lacks(self):
        """Why the binary cannot be measured, as a sentence; none if it can."""
        try:
            done = subprocess.run([self.path, "register", "--help"], capture_output=True, text=True, timeout=TIMEOUT_S)
        except OSError as error:
            return f"{self.path} cannot be run: {error.strerror}"
        if done.returncode != 0 or "--viewpoint" not in done.stdout:
            return f"{self.path} has no `register SOURCE TARGET --scale --viewpoint`; build the current one"
        return None

    def register(self, case, method, scale):
        """One run. The time is that of the process, which includes starting it and reading both files."""
        viewpoint = ",".join(repr(float(value)) for value in case.viewpoint)
        command = [self.path, "register", case.source_path, case.target_path, "--scale", scale, f"--viewpoint={viewpoint}"]
        command += ["--method", method, "--json"]
        environment = os.environ | {"RAYON_NUM_THREADS": str(len(self.cores))}
        began = time.perf_counter()
        try:
            with _on_cores(self.cores):
                done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, env=environment)
        except subprocess.TimeoutExpired:
            return Answer(None, time.perf_counter() - began, note=f"no answer within {TIMEOUT_S} s")
        return _answer(done, time.perf_counter() - began)


@contextlib.contextmanager
def _on_cores(cores):
    """A process that is started within runs on these cores."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cores)
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def _answer(done, seconds):
    """The last line of standard output, whatever the exit code: a refusal is an answer too."""
    lines = done.stdout.strip().splitlines()
    try:
        result = json.loads(lines[-1])
    except (IndexError, json.JSONDecodeError):
        return Answer(None, seconds, note=f"exit {done.returncode} without JSON: {done.stderr.strip()[-200:]}")
    if "error" in result:
        return Answer(None, seconds, note=f"{result['error'].get('reason')}: {result['error'].get('message')}")
    if missing := [key for key in KEYS if key not in result]:
        raise ValueError(f"`register --json` lacks {', '.join(missing)}")
    if result["verdict"] not in VERDICTS:
        raise ValueError(f"`register --json` says verdict {result['verdict']!r}, none of {', '.join(VERDICTS)}")
    found = Similarity(float(result["scale"]), np.array(result["rotation"], float), np.array(result["translation_mm"], float))
    return Answer(found, seconds, result["verdict"], "; ".join(result["reasons"]))


def scale_argument(case, mode):
    """What is told of the scale: nothing but the widest range, +-10 %, or the truth."""
    if mode == "free":
        return f"{FREE_SCALE[0]}..{FREE_SCALE[1]}"
    if mode == "prior":
        low, high = case.scale_range()
        return f"{low!r}..{high!r}"
    return repr(case.truth.scale)

"""One simulated UR controller on an address of its own, and what its arm must compute: `with ur5.controller(...)`."""

import contextlib
import json
import math
import subprocess
import time

# Nominal Denavit-Hartenberg parameters as the manufacturer publishes them: d, a in m, alpha in rad.
ALPHA = [math.pi / 2, 0.0, 0.0, math.pi / 2, -math.pi / 2, 0.0]
DH = {
    "cb3": ([0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823], [0.0, -0.425, -0.39225, 0.0, 0.0, 0.0]),
    "e": ([0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996], [0.0, -0.425, -0.3922, 0.0, 0.0, 0.0]),
}
RATE_HZ = {"cb3": 125.0, "e": 500.0}


@contextlib.contextmanager
def controller(simulator, host, series):
    """A powered controller at this address, until the block ends."""
    command = [simulator, "ur5", "--bind", host, "--series", series, "--powered", "--grpc", f"{host}:0"]
    process = subprocess.Popen([*command, "--until-stdin-closes"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        line = process.stdout.readline()
        assert line, "the controller did not start"
        yield json.loads(line)["ur5"]
    finally:
        process.stdin.close()
        process.wait(timeout=30)


class Checks:
    """Prints what holds and what does not, and remembers."""

    def __init__(self, title):
        self.title = title
        self.failed = 0

    def __call__(self, what, holds, value=""):
        self.failed += not holds
        print(f"{'PASS' if holds else 'FAIL'} {self.title}: {what} {value}".rstrip(), flush=True)
        return holds

    def near(self, what, found, wanted, tolerance):
        worst = max((abs(a - b) for a, b in zip(found, wanted)), default=math.inf)
        same = len(found) == len(wanted) and worst <= tolerance
        return self(what, same, f"off by {worst:.1e}, at most {tolerance:.0e}")

    def exit_code(self):
        return 1 if self.failed else 0


def until(condition, seconds):
    """Whether the condition came true within this time."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.01)
    return True


def multiply(a, b):
    return [[sum(a[i][k] * b[k][j] for k in range(4)) for j in range(4)] for i in range(4)]


def forward(series, joints):
    """Base from flange as a 4x4 matrix."""
    d, a = DH[series]
    pose = [[float(i == j) for j in range(4)] for i in range(4)]
    for i, angle in enumerate(joints):
        c, s, ca, sa = math.cos(angle), math.sin(angle), math.cos(ALPHA[i]), math.sin(ALPHA[i])
        link = [[c, -s * ca, s * sa, a[i] * c], [s, c * ca, -c * sa, a[i] * s], [0, sa, ca, d[i]], [0, 0, 0, 1]]
        pose = multiply(pose, link)
    return pose


def matrix(pose):
    """A pose (position, rotation vector) as a 4x4 matrix."""
    x, y, z, *vector = pose
    angle = math.sqrt(sum(part * part for part in vector))
    u, v, w = (part / angle for part in vector) if angle > 1e-12 else (1.0, 0.0, 0.0)
    c, s, t = math.cos(angle), math.sin(angle), 1 - math.cos(angle)
    return [
        [t * u * u + c, t * u * v - s * w, t * u * w + s * v, x],
        [t * u * v + s * w, t * v * v + c, t * v * w - s * u, y],
        [t * u * w - s * v, t * v * w + s * u, t * w * w + c, z],
        [0, 0, 0, 1],
    ]


def flat(rows):
    return [number for row in rows for number in row]

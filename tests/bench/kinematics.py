"""Forward and inverse kinematics of a UR5: arthro beside ur-analytic-ik and ur_kin.cpp.

    kinematics.py FOLDER

FOLDER holds what `cargo bench -p arthro-motion --bench kinematics` left in this run: 100,000 poses, 13 of 33 singular or nearly
so, and our account over a million of each make. The peers are asked the same poses, ur-analytic-ik from Python, so that
some of its time is that of the call. ur_kin.cpp is compiled from ARTHRO_UR_KIN, a folder like ur_kinematics of
ros-industrial/universal_robot (src/ur_kin.cpp and include/), and left out without.

All solutions are judged here by a chain of Denavit-Hartenberg matrices of its own: missing is a pose without a solution, lost one
whose generating joints are not among them, within what the pose can tell (the rule of sweep.rs); where the wrist is singular to
1e-9 any solution that reaches the pose counts. Both numbers are also told of the random poses alone.
"""

import contextlib
import json
import os
import pathlib
import subprocess
import sys
import time

import numpy as np

D = np.array([0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823])
A = np.array([0.0, -0.425, -0.39225, 0.0, 0.0, 0.0])
ALPHA = np.array([np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0])
ROUNDS = 5


def main() -> None:
    folder = pathlib.Path(sys.argv[1])
    rows = np.fromfile(folder / "poses.f64").reshape(-1, 18)
    joints = rows[:, :6]
    wanted = forward(joints)
    off = np.abs(wanted[:, :3, 3] - rows[:, 15:]).max()
    if off > 1e-12:
        sys.exit(f"our forward kinematics differ from the textbook's by {off:.1e} m")
    print(f"{'':16}{'forward ns':>12}{'inverse ns':>12}{'poses':>10}{'missing':>16}{'lost':>16}{'worst m':>10}{'worst rad':>11}")
    for ours in json.loads((folder / "account.json").read_text()):
        line(f"arthro {ours['name']}", ours["forward_ns"], ours["inverse_ns"], ours["poses"], str(ours["missing"]), str(ours["lost"]), ours["worst_m"], ours["worst_rad"])
    for name, measure in (("ur-analytic-ik", analytic_peer), ("ur_kin.cpp", ur_kin_peer)):
        answer = measure(folder, joints, wanted)
        if answer is not None:
            times, solutions = answer
            line(name, *times, len(joints), *judged(joints, wanted, solutions))


def line(name, forward_ns, inverse_ns, poses, missing, lost, worst_m, worst_rad) -> None:
    print(f"{name:16}{forward_ns:12.1f}{inverse_ns:12.1f}{poses:10d}{missing:>16}{lost:>16}{worst_m:10.1e}{worst_rad:11.1e}")


def forward(joints: np.ndarray) -> np.ndarray:
    """Transforms of many rows of joints."""
    product = np.broadcast_to(np.eye(4), (len(joints), 4, 4))
    for i in range(6):
        c, s = np.cos(joints[:, i]), np.sin(joints[:, i])
        ca, sa = np.cos(ALPHA[i]), np.sin(ALPHA[i])
        link = np.zeros((len(joints), 4, 4))
        link[:, 0, :] = np.stack([c, -s * ca, s * sa, A[i] * c], axis=1)
        link[:, 1, :] = np.stack([s, c * ca, -c * sa, A[i] * s], axis=1)
        link[:, 2, 1:] = [sa, ca, D[i]]
        link[:, 3, 3] = 1.0
        product = product @ link
    return product


def tolerances(joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How near the generating joints must be, rad, and the sine of joint 5."""

    def fold(known, distance):
        return np.minimum(known / np.maximum(distance, 1e-16), np.sqrt(known))

    q2, q23 = joints[:, 1], joints[:, 1] + joints[:, 2]
    reach = np.abs(A[1] * np.cos(q2) + A[2] * np.cos(q23) + D[4] * np.sin(q23 + joints[:, 3]))
    known = fold(1e-12, np.minimum(reach / D[3], 1.0))
    wrist = np.abs(np.sin(joints[:, 4]))
    known = fold(known / np.maximum(wrist, 1e-16), np.abs(np.sin(joints[:, 2])))
    return np.minimum(known, 1.0), wrist


def judged(joints: np.ndarray, wanted: np.ndarray, solutions: np.ndarray) -> tuple[str, str, float, float]:
    """Missing and lost, altogether and of random poses, and the residuals of the worst solution."""
    tolerance, wrist = tolerances(joints)
    worst_m, worst_rad = 0.0, 0.0
    there = ~np.isnan(solutions[:, :, 0])
    kept = np.zeros(len(joints), dtype=bool)
    for k in range(solutions.shape[1]):
        has = there[:, k]
        reached = forward(solutions[has, k])
        off_m = np.linalg.norm(reached[:, :3, 3] - wanted[has, :3, 3], axis=1)
        between = np.einsum("nij,nik->njk", reached[:, :3, :3], wanted[has, :3, :3])
        turns = between - np.swapaxes(between, 1, 2)
        off_rad = 0.5 * np.linalg.norm(np.stack([turns[:, 2, 1], turns[:, 0, 2], turns[:, 1, 0]]), axis=0)
        worst_m, worst_rad = max(worst_m, off_m.max(initial=0.0)), max(worst_rad, off_rad.max(initial=0.0))
        apart = solutions[has, k] - joints[has]
        apart = np.abs(apart - 2.0 * np.pi * np.round(apart / (2.0 * np.pi))).max(axis=1)
        free = (wrist[has] < 1e-9) | (tolerance[has] >= 1.0)
        kept[has] |= (apart <= tolerance[has]) | (free & (off_m < 1e-9))
    # Of 33 poses sweep.rs makes the first 13 singular.
    random = np.arange(len(joints)) % 33 >= 13

    def counted(what):
        return f"{what.sum()} ({(what & random).sum()})"

    return counted(~there.any(axis=1)), counted(~kept), worst_m, worst_rad


@contextlib.contextmanager
def silent():
    """What a library of another language prints goes nowhere; it would be timed too."""
    sys.stdout.flush()
    kept = [os.dup(1), os.dup(2)]
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        for stream in (1, 2):
            os.dup2(nowhere, stream)
        yield
    finally:
        for stream, descriptor in zip((1, 2), kept):
            os.dup2(descriptor, stream)
            os.close(descriptor)
        os.close(nowhere)


def analytic_peer(folder: pathlib.Path, joints: np.ndarray, wanted: np.ndarray):
    try:
        from ur_analytic_ik import ur5
    except ImportError as error:
        print(f"ur-analytic-ik is not installed: {error}")
        return None
    with silent():
        return asked_of(ur5, joints, wanted)


def asked_of(ur5, joints: np.ndarray, wanted: np.ndarray):
    poses = [np.ascontiguousarray(pose) for pose in wanted]
    rows = joints.tolist()
    times = []
    for ask, asked in ((lambda row: ur5.forward_kinematics(*row), rows), (ur5.inverse_kinematics, poses)):
        best = float("inf")
        for _ in range(ROUNDS):
            for block in range(0, len(asked) - 1000, 1000):
                some = asked[block : block + 1000]
                began = time.perf_counter()
                for item in some:
                    ask(item)
                best = min(best, time.perf_counter() - began)
        times.append(best * 1e6)
    solutions = np.full((len(poses), 16, 6), np.nan)
    for i, pose in enumerate(poses):
        for k, solution in enumerate(ur5.inverse_kinematics(pose)):
            solutions[i, k] = solution
    return times, solutions


def ur_kin_peer(folder: pathlib.Path, joints: np.ndarray, wanted: np.ndarray):
    source = os.environ.get("ARTHRO_UR_KIN")
    if not source:
        print("ur_kin.cpp is left out: ARTHRO_UR_KIN does not name its folder")
        return None
    package = pathlib.Path(source)
    program = folder / "ur_kin_peer"
    here = pathlib.Path(__file__).parent
    subprocess.run(
        ["g++", "-O2", "-DUR5_PARAMS", "-DIKFAST_NO_MAIN", f"-I{package / 'include'}"]
        + [str(here / "ur_kin_peer.cpp"), str(package / "src" / "ur_kin.cpp"), "-o", str(program)],
        check=True,
    )
    told = subprocess.run(
        [str(program), str(folder / "poses.f64"), str(folder / "solutions.f64")], check=True, capture_output=True, text=True
    )
    times = [float(word) for word in told.stdout.split()]
    return times, np.fromfile(folder / "solutions.f64").reshape(-1, 8, 6)


if __name__ == "__main__":
    main()

"""The manufacturer's external_control.urscript, unmodified, on one simulated controller: `external_control.py HOST SERIES`.

ARTHRO_URCL names the folder with that file (the client library's resources). This script fills in its template as the library does
and plays the library's side of the four sockets: it streams servoj targets, forwards a trajectory, cancels one, and falls silent.
"""

import os
import pathlib
import re
import socket
import struct
import sys
import time

import ur5
from rtde_receive import RTDEReceiveInterface

SCALE = 1_000_000
IDLE, SERVOJ, SPEEDJ, FORWARD, STOPPED = 0, 1, 2, 3, -2
RECEIVE, CANCEL = 1, -1
MOVEJ, MOVEL, SPLINE, QUINTIC = 0, 1, 51, 2
SUCCESS, CANCELED = 0, 1
VERSION = {"cb3": (3, 15, 8), "e": (5, 12, 6)}


def render(text, values, version):
    """Fills in {{NAME}} and keeps the {% if ROBOT_SOFTWARE_VERSION ... %} branches that hold for this version."""

    def holds(condition):
        sign, number = re.fullmatch(r"ROBOT_SOFTWARE_VERSION (<|>=) v([\d.]+)", condition.strip()).groups()
        other = tuple(int(part) for part in number.split("."))
        return version < other if sign == "<" else version >= other

    lines, open_blocks = [], []
    for line in text.splitlines():
        directive = re.fullmatch(r"\s*\{% (if|elif|else|endif)(.*) %\}\s*", line)
        if not directive:
            if all(block["on"] for block in open_blocks):
                lines.append(re.sub(r"\{\{(\w+)\}\}", lambda name: str(values[name.group(1)]), line))
            continue
        word, condition = directive.groups()
        if word == "if":
            on = holds(condition)
            open_blocks.append({"on": on, "taken": on})
        elif word == "endif":
            open_blocks.pop()
        else:
            block = open_blocks[-1]
            block["on"] = not block["taken"] and (word == "else" or holds(condition))
            block["taken"] |= block["on"]
    return "\n".join(lines) + "\n"


class Library:
    """The library's end of the sockets that the script opens."""

    def __init__(self):
        self.listeners = {name: socket.create_server(("127.0.0.1", 0)) for name in ("reverse", "trajectory", "command")}
        self.sockets = {}

    def port(self, name):
        return self.listeners[name].getsockname()[1]

    def accept(self):
        for name in ("trajectory", "command", "reverse"):
            self.listeners[name].settimeout(5)
            self.sockets[name], _ = self.listeners[name].accept()
            self.sockets[name].setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self.sockets[name].settimeout(20)

    def write(self, mode, target=(0,) * 6, timeout_ms=200):
        self.sockets["reverse"].sendall(struct.pack(">8i", timeout_ms, *target, mode))

    def joints(self, mode, joints, timeout_ms=200):
        self.write(mode, [round(angle * SCALE) for angle in joints], timeout_ms)

    def point(self, position, kind, time_s, speeds=(0,) * 6, third=(0,) * 6, blend=0):
        numbers = [round(value * SCALE) for value in (*position, *speeds, *third, time_s)]
        self.sockets["trajectory"].sendall(struct.pack(">21i", *numbers, blend, kind))

    def result(self):
        return struct.unpack(">i", self.sockets["trajectory"].recv(4))[0]

    def keep_alive_until(self, condition, seconds, mode=FORWARD):
        """As the library does while a trajectory runs."""
        deadline = time.monotonic() + seconds
        while not condition() and time.monotonic() < deadline:
            self.write(mode)
            time.sleep(0.02)
        return condition()

    def close(self):
        for each in (*self.sockets.values(), *self.listeners.values()):
            each.close()


def start(host, series, library):
    values = {
        "BEGIN_REPLACE": "",
        "JOINT_STATE_REPLACE": SCALE,
        "TIME_REPLACE": SCALE,
        "SERVO_J_REPLACE": "lookahead_time=0.03, gain=2000",
        "SERVER_IP_REPLACE": "127.0.0.1",
        "SERVER_PORT_REPLACE": library.port("reverse"),
        "TRAJECTORY_SERVER_PORT_REPLACE": library.port("trajectory"),
        "SCRIPT_COMMAND_SERVER_PORT_REPLACE": library.port("command"),
    }
    text = pathlib.Path(os.environ["ARTHRO_URCL"], "external_control.urscript").read_text()
    body = render(text, values, VERSION[series])
    program = "def external_control():\n" + "".join(f"  {line}\n" for line in body.splitlines()) + "end\n"
    with socket.create_connection((host, 30002), 5) as interface:
        interface.sendall(program.encode())
        library.accept()


def main():
    host, series = sys.argv[1:3]
    check = ur5.Checks(f"external_control.urscript {series}")
    arm = RTDEReceiveInterface(host)
    playing = lambda: arm.getRuntimeState() == 2
    library = Library()
    start(host, series, library)
    check("three sockets are open and the program runs", ur5.until(playing, 5))
    home = arm.getActualQ()

    period = 1 / ur5.RATE_HZ[series]
    library.write(IDLE, timeout_ms=1000)
    for cycle in range(int(1.0 / period)):
        target = [home[0] + 0.2 * min(1.0, cycle * period / 0.8), *home[1:]]
        library.joints(SERVOJ, target)
        time.sleep(period)
    check("servoj targets are followed", ur5.until(lambda: abs(arm.getActualQ()[0] - home[0] - 0.2) < 5e-3, 1), arm.getActualQ()[0] - home[0])
    for _ in range(int(0.5 / period)):
        library.joints(SPEEDJ, [0, 0, 0, 0, 0, 0.2])
        time.sleep(period)
    check("speedj", abs(arm.getActualQd()[5] - 0.2) < 0.02, arm.getActualQd()[5])
    library.keep_alive_until(lambda: False, 0.3, IDLE)

    def finished():
        library.sockets["trajectory"].setblocking(False)
        try:
            results.append(library.result())
        except (BlockingIOError, struct.error):
            pass
        library.sockets["trajectory"].settimeout(20)
        return bool(results)

    def forward(points):
        results.clear()
        library.write(FORWARD, (RECEIVE, len(points), 0, 0, 0, 0))
        for point in points:
            library.point(*point)

    results = []
    rates = (1.05, 1.4, 0, 0, 0, 0)
    bent = [home[0] + 0.1, *home[1:]]
    forward([(home, MOVEJ, 1.0, (0,) * 6, rates), (bent, MOVEJ, 1.0, (0,) * 6, rates)])
    ended = library.keep_alive_until(finished, 10)
    check("a trajectory of movej points succeeds", ended and results[0] == SUCCESS, results)
    check("and ends at its last point", ur5.until(lambda: abs(arm.getActualQ()[0] - home[0] - 0.1) < 2e-3, 1))
    forward([(home, SPLINE, 1.0, (0,) * 6, (0,) * 6, QUINTIC)])
    ended = library.keep_alive_until(finished, 10)
    check("a quintic spline succeeds", ended and results[0] == SUCCESS, results)
    check("and ends at its point", ur5.until(lambda: abs(arm.getActualQ()[0] - home[0]) < 5e-3, 1), arm.getActualQ()[0] - home[0])
    forward([([home[0] + 1.0, *home[1:]], MOVEJ, 5.0, (0,) * 6, rates)])
    library.keep_alive_until(lambda: abs(arm.getActualQd()[0]) > 0.1, 5)
    library.write(FORWARD, (CANCEL, 0, 0, 0, 0, 0))
    ended = library.keep_alive_until(finished, 5, IDLE)
    check("a cancelled trajectory says so", ended and results[0] == CANCELED, results)
    check("and stands", ur5.until(lambda: max(map(abs, arm.getActualQd())) < 1e-3, 3))
    check("far from its goal", abs(arm.getActualQ()[0] - home[0] - 1.0) > 0.2)

    for _ in range(int(0.3 / period)):
        library.joints(SPEEDJ, [0.2, 0, 0, 0, 0, 0], timeout_ms=100)
        time.sleep(period)
    check("silence ends the program", ur5.until(lambda: not playing(), 3))
    check("and the arm stands", ur5.until(lambda: max(map(abs, arm.getActualQd())) < 1e-3, 3))
    library.close()
    arm.disconnect()
    return check.exit_code()


if __name__ == "__main__":
    sys.exit(main())

"""SDO round trips of epos4-link beside python canopen's, on one simulated bus in one run; then what hearing process data takes.

    can_bus.py [--uploads N] [--rounds N] [--json FILE]

The bus is the simulated one of four drives (`arthro-simulator epos4`), over socketcand on the loopback. Both masters read the same
object, one request after another to a node, from one node and then from four at once (a thread a node in Python). Each round runs all, and
the medians over the rounds are compared. A bare round trip of a message as long over TCP is the floor of what two processes can do. All
run with real-time priority (`chrt -f`) where the system grants it, as what else runs on the machine would be measured otherwise.
"""

import argparse
import json
import os
import pathlib
import shutil
import socket
import statistics
import subprocess
import sys
import threading
import time

ROOT = pathlib.Path(__file__).parents[2]
PEERS = pathlib.Path(os.environ.get("ARTHRO_PEERS", ROOT / "target/peers"))
PROCESS_DATA_PER_S = 8000
LISTEN_S = 5
TIMEOUT_S = 120
FLOOR = "bare TCP round trip"


def build():
    """The simulated bus and our bench."""
    programs = {}
    for command in (
        ["build", "--release", "-p", "arthro-simulator"],
        ["bench", "-p", "epos4-link", "--bench", "bus", "--no-run"],
    ):
        lines = subprocess.run(["cargo", *command, "--message-format=json"], cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout
        for made in map(json.loads, lines.splitlines()):
            if made.get("executable"):
                programs[made["target"]["name"]] = made["executable"]
    return programs["arthro-simulator"], programs["bus"]


def real_time():
    """What starts a program with real-time priority; nothing where that is not granted."""
    priority = ["chrt", "-f", "10"]
    granted = shutil.which("chrt") and subprocess.run([*priority, "true"], stderr=subprocess.DEVNULL).returncode == 0
    return priority if granted else []


class Serving:
    """A program that prints its address and ends with its input."""

    def __init__(self, *command):
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        line = self.process.stdout.readline().strip()
        self.address = json.loads(line)["epos4"]["can"] if line.startswith("{") else line

    def __enter__(self):
        return self.address

    def __exit__(self, *_):
        self.process.stdin.close()
        self.process.wait(timeout=10)


def figures(times_s, took_s):
    times_ms = sorted(1e3 * one for one in times_s)
    return {"per_s": len(times_ms) / took_s, "p50_ms": times_ms[len(times_ms) // 2], "p99_ms": times_ms[len(times_ms) * 99 // 100]}


def canopen_peer(address, uploads, nodes):
    """Runs in the peers' Python."""
    import canopen

    host, port = address.removeprefix("socketcand://").split("/")[0].rsplit(":", 1)
    network = canopen.Network()
    network.connect(interface="socketcand", host=host, port=int(port), channel="can0", tcp_tune=True)
    times = []

    def upload(node):
        for _ in range(uploads):
            began = time.perf_counter()
            node.sdo.upload(0x1018, 4)
            times.append(time.perf_counter() - began)

    threads = [threading.Thread(target=upload, args=[network.add_node(n, canopen.ObjectDictionary())]) for n in range(1, nodes + 1)]
    began = time.perf_counter()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    took = time.perf_counter() - began
    network.disconnect()
    if len(times) != uploads * nodes:
        raise RuntimeError(f"{len(times)} of {uploads * nodes} uploads succeeded")
    print(json.dumps(figures(times, took)))


def floor(uploads):
    """A child sends back what comes."""
    listener = socket.create_server(("127.0.0.1", 0))
    child = os.fork()
    near = socket.create_connection(listener.getsockname()) if child else listener.accept()[0]
    near.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    if not child:
        while received := near.recv(1024):
            near.sendall(received)
        os._exit(0)
    times = []
    began = time.perf_counter()
    for _ in range(uploads):
        asked = time.perf_counter()
        near.sendall(b"< send 601 8 40 18 10 4 0 0 0 0 >")
        near.recv(1024)
        times.append(time.perf_counter() - asked)
    took = time.perf_counter() - began
    near.close()
    os.waitpid(child, 0)
    print(json.dumps(figures(times, took)))


def measured(*command):
    return json.loads(subprocess.run([*map(str, command)], check=True, stdout=subprocess.PIPE, text=True, timeout=TIMEOUT_S).stdout)


def row(name, values, base):
    ratio = f"{values['per_s'] / base['per_s']:8.1f}" if base else " " * 8
    print(f"{name:<34} {values['per_s']:10.0f} {values['p50_ms']:9.3f} {values['p99_ms']:9.3f} {ratio}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--uploads", type=int, default=10_000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--json", type=pathlib.Path)
    parser.add_argument("--peer", nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--floor", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.peer:
        return canopen_peer(arguments.peer[0], arguments.uploads, int(arguments.peer[1]))
    if arguments.floor:
        return floor(arguments.uploads)

    drives, bench = build()
    priority = real_time()
    ours = [*priority, bench]
    python = [*priority, PEERS / "bin/python", __file__]
    rounds = []
    for _ in range(arguments.rounds):
        now = {FLOOR: measured(*python, "--uploads", arguments.uploads, "--floor")}
        # A bus bears one master.
        with Serving(*priority, drives, "epos4", "--listen", "127.0.0.1:0", "--grpc", "127.0.0.1:0", "--until-stdin-closes") as address:
            for nodes in (1, 4):
                uploads = arguments.uploads // nodes
                now[f"python canopen 2.4.1, nodes: {nodes}"] = measured(*python, "--uploads", uploads, "--peer", address, nodes)
                now[f"epos4-link, nodes: {nodes}"] = measured(*ours, "sdo", address, uploads, nodes)
        rounds.append(now)
    medians = {name: {key: statistics.median(one[name][key] for one in rounds) for key in rounds[0][name]} for name in rounds[0]}

    how = "real-time priority" if priority else "default priority"
    print(f"SDO uploads over socketcand, medians of {arguments.rounds} rounds, {how}, load average {os.getloadavg()[0]:.1f}")
    print(f"{'':<34} {'uploads/s':>10} {'p50 ms':>9} {'p99 ms':>9} {'ratio':>8}")
    row(FLOOR, medians[FLOOR], None)
    for nodes in (1, 4):
        theirs = medians[f"python canopen 2.4.1, nodes: {nodes}"]
        row(f"python canopen 2.4.1, nodes: {nodes}", theirs, theirs)
        row(f"epos4-link, nodes: {nodes}", medians[f"epos4-link, nodes: {nodes}"], theirs)

    with Serving(*ours, "stream") as address:
        heard = measured(*ours, "listen", address, LISTEN_S)
    if heard["per_s"] < 0.99 * PROCESS_DATA_PER_S:
        raise RuntimeError(f"{heard['per_s']:.0f} frames/s of {PROCESS_DATA_PER_S}")
    print(f"process data of 4 drives x 2 TPDO at 1 kHz: {heard['per_s']:.0f} frames/s heard with {100 * heard['cpu']:.1f} % of a core")
    if arguments.json:
        arguments.json.write_text(json.dumps({"rounds": rounds, "process_data": heard}, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())

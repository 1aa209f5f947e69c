"""How late states are seen and how many, over one stand-in controller: ur-link beside ur_rtde and a reader that does nothing else.

    rtde.py [--seconds S] [--json FILE]

The stand-in stamps each state with CLOCK_MONOTONIC when it sends it, and numbers it; a latency is the time from there to the
moment at which the client's user has the state in hand. Paced runs have the stand-in at a higher real-time priority than
the client (`chrt -f`) where the system grants it, and one more with the client at default priority beside busy processes. All run at
ur_rtde's default recipe of 58 fields, on one address that ur_rtde can use (port 30004 is fixed in it).
"""

import argparse
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time

HOST = "127.0.0.31"
ROOT = pathlib.Path(__file__).parents[2]
CLIENTS = ("ur-link reader", "ur-link latest", "ur-link client", "ur_rtde 1.6.5", "raw C++")


def build() -> tuple[str, str]:
    """Our bench program, and the raw reader."""
    command = ["cargo", "bench", "-p", "ur-link", "--bench", "link", "--no-run", "--message-format=json"]
    lines = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout.splitlines()
    made = [json.loads(line) for line in lines]
    link = next(one["executable"] for one in made if one.get("executable") and one["target"]["name"] == "link")
    reader = os.path.join(tempfile.mkdtemp(prefix="rtde-bench-"), "rtde_reader")
    subprocess.run(["g++", "-O2", "-o", reader, str(ROOT / "tests/bench/rtde_reader.cpp")], check=True)
    return link, reader


def real_time() -> bool:
    return shutil.which("chrt") is not None and subprocess.run(["chrt", "-f", "50", "true"], stderr=subprocess.DEVNULL).returncode == 0


class StandIn:
    """The controller, at a rate or flooding."""

    def __init__(self, link: str, rate: str, priority: list[str]):
        self.process = subprocess.Popen(
            [*priority, link, "serve", HOST, rate], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert self.process.stdout.readline() == "ready\n"

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.stdin.close()
        self.process.wait()


def measured(client: str, programs: tuple[str, str], priority: list[str], hz: float, seconds: float) -> dict:
    link, reader = programs
    if client.startswith("ur-link"):
        command = [link, "read", client.split()[1], HOST, str(hz), str(seconds)]
    elif client == "raw C++":
        names, number_at = recipe()
        command = [reader, HOST, str(hz), str(seconds), names, str(number_at)]
    else:
        command = [sys.executable, __file__, "--peer", str(hz), str(seconds)]
    try:
        done = subprocess.run([*priority, *command], stdout=subprocess.PIPE, text=True, timeout=seconds + 15)
        return json.loads(done.stdout)
    except (json.JSONDecodeError, subprocess.TimeoutExpired):
        return {}


def recipe() -> tuple[str, int]:
    """The names of the recipe, and the bytes before output_int_register_2, from our bench: one list for all."""
    source = (ROOT / "services/drivers/ur/benches/link/read.rs").read_text()
    body = source.split("struct Recipe {")[1].split("}")[0]
    sizes = {"f64": 8, "i32": 4, "u32": 4, "u64": 8, "[f64; 6]": 48, "[f64; 3]": 24, "[i32; 6]": 24}
    names, number_at = [], 0
    for line in body.split(",\n"):
        name, _, kind = line.strip().rstrip(",").partition(":")
        if not name:
            continue
        names.append(name.split()[0])
        if "output_int_register_2" not in names:
            number_at += sizes[kind.strip()]
    return ",".join(names), number_at


def peer(hz: float, seconds: float) -> None:
    """ur_rtde in a process of its own, polled as fast as lets its own thread run."""
    from rtde_receive import RTDEReceiveInterface

    arm = RTDEReceiveInterface(HOST, hz)
    monotonic = time.CLOCK_MONOTONIC
    latencies, last, began, now = [], 0.0, time.clock_gettime(monotonic), 0.0
    while now - began < seconds + 0.3:
        stamp = arm.getTimestamp()
        now = time.clock_gettime(monotonic)
        if stamp != last:
            last = stamp
            if now - began >= 0.3:
                latencies.append((now - stamp) * 1e6)
        else:
            time.sleep(1e-6)
    latencies.sort()

    def at(share: float) -> float:
        return latencies[round(share * (len(latencies) - 1))] if latencies else float("nan")

    rate = len(latencies) / seconds
    print(json.dumps({"p50": at(0.5), "p99": at(0.99), "p999": at(0.999), "distinct_s": rate, "taken_s": None, "missed": None}), flush=True)
    # Its destructor may wait for a thread that a flood keeps busy.
    os._exit(0)


def table(title: str, rows: dict[str, dict], columns: list[tuple[str, str]], base: str) -> None:
    print(f"\n{title}")
    print(f"{'':16}" + "".join(f"{head:>14}" for head, _ in columns) + f"{'ratio':>10}")
    reference = rows.get("ur-link reader", {}).get(base)
    for name, row in rows.items():
        cells = "".join(f"{row[key]:14.0f}" if isinstance(row.get(key), (int, float)) else f"{'-':>14}" for _, key in columns)
        ratio = f"{row[base] / reference:9.2f} x" if reference and isinstance(row.get(base), (int, float)) else f"{'-':>10}"
        print(f"{name:16}{cells}{ratio}")


LATENCY = [("p50 us", "p50"), ("p99 us", "p99"), ("p99.9 us", "p999"), ("missed", "missed"), ("dissembled", "dissembled")]
THROUGHPUT = [("taken /s", "taken_s"), ("seen /s", "distinct_s"), ("p50 us", "p50"), ("p99 us", "p99")]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=5.0, help="of each latency run; floods take 2")
    parser.add_argument("--json", help="writes all figures to this file")
    parser.add_argument("--peer", nargs=2, type=float, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.peer:
        return peer(*options.peer)
    programs = build()
    fifo = real_time()
    above, below = (["chrt", "-f", "50"], ["chrt", "-f", "49"]) if fifo else ([], [])
    results: dict[str, dict] = {}

    def run(key: str, rate: str, hz: float, seconds: float, priority: list[str]) -> dict[str, dict]:
        rows = {}
        with StandIn(programs[0], rate, above if rate != "flood" else []):
            for client in CLIENTS:
                rows[client] = measured(client, programs, priority, hz, seconds)
        results[key] = rows
        return rows

    sched = "SCHED_FIFO" if fifo else "default scheduling, since the system grants no real time"
    for hz in (125, 500):
        rows = run(f"latency_{hz}", str(hz), hz, options.seconds, below)
        table(f"latency at {hz} Hz, {sched}; ratio of p50 to ur-link reader", rows, LATENCY, "p50")
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2 * (os.cpu_count() or 1))]
    try:
        rows = run("latency_500_loaded", "500", 500, options.seconds, [])
    finally:
        for process in busy:
            process.kill()
            process.wait()
    table(f"latency at 500 Hz, default scheduling beside {len(busy)} busy processes", rows, LATENCY, "p50")
    print("missed: states that were replaced by later ones before they were read; dissembled: samples that did not tell of that, or of their age")
    for rate in ("20000", "flood"):
        rows = run(f"throughput_{rate}", rate, 500, 2.0, below)
        table(f"states, {'flooded' if rate == 'flood' else rate + ' /s offered'}, {sched}; ratio of seen", rows, THROUGHPUT, "distinct_s")
    print("taken: states read off the socket; seen: states handed to the user (ur-link hands out the newest of what it took)")
    if options.json:
        pathlib.Path(options.json).write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()

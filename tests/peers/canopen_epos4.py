"""Drives EPOS4 nodes with a foreign CANopen master: python canopen over python-can, both unmodified.

    pip install canopen==2.4.1 python-can==4.6.1
    python canopen_epos4.py BUS [EDS]

BUS is `socketcand://HOST:PORT/can0` or `socketcan:vcan0`, with nodes 1 to 4 as the simulated cell has them and no other
master: two clients of one SDO server hear each other's answers. Nodes 2 and 4 are the feeds, with a negative limit switch
at -1 mm and hard stops at -2 and 15 mm. EDS is what `arthro can eds` writes; without it the program is asked (ARTHRO, or
target/release/arthro).

Prints a line for each check, a table of the subjects and a line of JSON, and exits 1 if a check failed.
"""

import io
import logging
import os
import pathlib
import subprocess
import sys
import time
import urllib.parse

import canopen
from canopen.profiles.p402 import BaseNode402

import canopen_motion as motion
import canopen_network as networking
import canopen_objects as objects
from canopen_check import Report

NODES = (1, 2, 3, 4)


def data_sheet(path):
    """The text of the data sheet."""
    if path:
        return pathlib.Path(path).read_text(encoding="ascii")
    arthro = os.environ.get("ARTHRO", pathlib.Path(__file__).parents[2] / "target/release/arthro")
    return subprocess.run([arthro, "can", "eds"], check=True, capture_output=True, text=True).stdout


def connected(bus):
    """python canopen on the bus."""
    network = canopen.Network()
    if bus.startswith("socketcan:"):
        network.connect(interface="socketcan", channel=bus.removeprefix("socketcan:"))
    else:
        address = urllib.parse.urlsplit(bus)
        network.connect(interface="socketcand", host=address.hostname, port=address.port, channel=address.path[1:], tcp_tune=True)
    return network


class Warnings(logging.Handler):
    """Remembers what a library warns of."""

    def __init__(self):
        super().__init__(logging.WARNING)
        self.seen = []

    def emit(self, record):
        self.seen.append(record.getMessage())


def main(bus, eds=None):
    report = Report()
    logging.getLogger("canopen.profiles.p402").setLevel(logging.ERROR)  # it warns of every read that is no PDO
    text = data_sheet(eds)
    network = connected(bus)
    try:
        warnings = Warnings()
        logging.getLogger().addHandler(warnings)
        nodes = {node_id: BaseNode402(node_id, canopen.import_od(named(text), node_id)) for node_id in NODES}
        logging.getLogger().removeHandler(warnings)
        for node in nodes.values():
            patient(node)
            network.add_node(node)
        report.run("data sheet", lambda report: report.check("is read without a warning", not warnings.seen, warnings.seen or ""))
        conformance(report, network, nodes)
    finally:
        network.sync.stop()
        network.disconnect()
    return report.finish()


def patient(node):
    """Waits as long as a busy machine may take to give both programs their turn; the client's own limits are for an idle one."""
    node.sdo.RESPONSE_TIMEOUT = 3
    for limit in ("TIMEOUT_RESET_FAULT", "TIMEOUT_SWITCH_OP_MODE", "TIMEOUT_SWITCH_STATE_FINAL", "TIMEOUT_SWITCH_STATE_SINGLE", "TIMEOUT_CHECK_TPDO"):
        setattr(node, limit, 3)


def named(text):
    """A file as python canopen wants it."""
    file = io.StringIO(text)
    file.name = "arthro.eds"
    return file


def conformance(report, network, nodes):
    """Everything, from what needs nothing to what needs all before."""
    rotation, _, arthroscope_rotation, feed = nodes.values()
    report.run("data sheet", objects.data_sheet, arthroscope_rotation.object_dictionary)
    report.run("node scan", networking.restart_all, network, nodes)
    report.run("node scan", networking.scan, network, nodes)
    report.run("network management", networking.states, arthroscope_rotation)
    report.run("objects read", objects.reads, arthroscope_rotation)
    report.run("objects written", objects.writes, arthroscope_rotation)
    report.run("objects refused", objects.refusals, arthroscope_rotation)
    report.run("pdo mapping", objects.mapping, arthroscope_rotation)
    report.run("save and restore", networking.parameters, arthroscope_rotation)
    for node in nodes.values():
        report.run("default pdos", networking.default_mapping, node)
        report.run("synchronous pdos", networking.synchronous, network, node)
    network.sync.start(0.01)
    report.run("states", motion.states, rotation)
    report.run("modes", motion.modes, rotation)
    rotation.state = "OPERATION ENABLED"
    report.run("objects with power on", objects.power, rotation)
    report.run("heartbeat consumer", networking.consumer, network, arthroscope_rotation)
    report.run("profile position", motion.profile_position, rotation)
    report.run("profile velocity", motion.profile_velocity, arthroscope_rotation)
    report.run("cyclic position", motion.cyclic_position, network, rotation)
    report.run("homing", motion.homings, rotation, feed)
    report.run("current limit", motion.current_limit, feed)
    report.run("faults", motion.faults, feed)
    report.run("speed", speed, rotation)


def speed(report, node):
    """Round trips of SDO as this client makes them."""
    count = 2000
    start = time.monotonic()
    for _ in range(count):
        node.sdo.upload(0x6041, 0)
    rate = count / (time.monotonic() - start)
    report.check("sdo uploads", rate > 200, f"{rate:.0f} a second")


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    sys.exit(0 if main(*sys.argv[1:]) else 1)

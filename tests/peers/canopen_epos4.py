"""Drives simulated EPOS4 nodes with two foreign CANopen masters' code: python-can (socketcand, SocketCAN) and python canopen.

    pip install canopen==2.4.1 python-can==4.6.1
    python canopen_epos4.py socketcand://HOST:PORT/can0
    python canopen_epos4.py socketcan:vcan0

The other end is the CAN bus of the simulated cell, e.g. the simulator crate's example `epos4_bus`. It must have no other
master: two clients of one SDO server hear each other's answers. Nodes 2 and 4 are the feeds, with a negative limit switch
at -1 mm and hard stops at -2 and 15 mm.

Prints a PASS line for each check and exits 1 at the first that fails.
"""

import sys
import time
import urllib.parse

import can
import canopen
from canopen import objectdictionary as od
from canopen.profiles.p402 import BaseNode402

NODES = (1, 2, 3, 4)
QC_PER_TURN = 2048
# gear 21:1, lead 2 mm
QC_PER_MM = QC_PER_TURN * 21 // 2

TYPES = {"u8": od.UNSIGNED8, "u16": od.UNSIGNED16, "u32": od.UNSIGNED32,
         "i8": od.INTEGER8, "i16": od.INTEGER16, "i32": od.INTEGER32, "text": od.VISIBLE_STRING}

# index, subindex, type, name: written from the drive's manual and not from the simulator's table
OBJECTS = [
    (0x1000, 0, "u32", "device type"), (0x1001, 0, "u8", "error register"), (0x1008, 0, "text", "device name"),
    (0x1017, 0, "u16", "producer heartbeat"),
    (0x1016, 1, "u32", "consumer heartbeat 1"),
    (0x1018, 1, "u32", "vendor"), (0x1018, 2, "u32", "product"), (0x1018, 3, "u32", "revision"),
    (0x1018, 4, "u32", "serial"),
    (0x3000, 5, "u32", "main sensor resolution"),
    (0x3142, 1, "u8", "input 1 function"),
    (0x3001, 1, "u32", "nominal current"), (0x3001, 2, "u32", "output current limit"),
    (0x30B0, 0, "i32", "home position"), (0x30B1, 0, "i32", "home offset move distance"),
    (0x30B2, 0, "u16", "homing current threshold"),
    (0x30D1, 1, "i32", "current averaged"), (0x30D1, 2, "i32", "current actual"),
    (0x603F, 0, "u16", "error code"), (0x6040, 0, "u16", "controlword"), (0x6041, 0, "u16", "statusword"),
    (0x6060, 0, "i8", "mode"), (0x6061, 0, "i8", "mode display"), (0x6064, 0, "i32", "position actual"),
    (0x6065, 0, "u32", "following error window"), (0x606C, 0, "i32", "velocity actual"),
    (0x6071, 0, "i16", "target torque"), (0x607A, 0, "i32", "target position"),
    (0x6081, 0, "u32", "profile velocity"), (0x6083, 0, "u32", "profile acceleration"),
    (0x6084, 0, "u32", "profile deceleration"), (0x6098, 0, "i8", "homing method"),
    (0x6099, 1, "u32", "homing speed switch"), (0x6099, 2, "u32", "homing speed zero"),
    (0x60FF, 0, "i32", "target velocity"), (0x6502, 0, "u32", "supported modes"),
]
for pdo in range(4):
    for base, subs in ((0x1400, (1, 2)), (0x1800, (1, 2, 3))):
        OBJECTS += [(base + pdo, 0, "u8", "highest")]
        OBJECTS += [(base + pdo, sub, {1: "u32", 2: "u8", 3: "u16"}[sub], f"communication {sub}") for sub in subs]
    for base in (0x1600, 0x1A00):
        OBJECTS += [(base + pdo, 0, "u8", "count")]
        OBJECTS += [(base + pdo, sub, "u32", f"mapped {sub}") for sub in range(1, 13)]


def dictionary(node_id):
    objects = od.ObjectDictionary()
    objects.node_id = node_id
    records = {}
    for index, sub, kind, name in OBJECTS:
        variable = od.ODVariable(name, index, sub)
        variable.data_type = TYPES[kind]
        variable.access_type = "rw"
        if sub == 0 and not 0x1400 <= index < 0x1C00:
            objects.add_object(variable)
            continue
        if index not in records:
            records[index] = od.ODRecord(f"record {index:04X}", index)
        records[index].add_member(variable)
    for record in records.values():
        objects.add_object(record)
    return objects


def check(name, condition, seen=""):
    print(f"{'PASS' if condition else 'FAIL'} {name}" + (f": {seen}" if seen != "" else ""), flush=True)
    if not condition:
        sys.exit(1)


def wait_for(name, limit_s, condition):
    end = time.monotonic() + limit_s
    while time.monotonic() < end:
        if condition():
            return
        time.sleep(0.005)
    check(name, False, f"not within {limit_s} s")


def python_can_options(address):
    """What python-can calls this bus."""
    if address.startswith("socketcan:"):
        return {"interface": "socketcan", "channel": address.removeprefix("socketcan:")}
    url = urllib.parse.urlsplit(address)
    return {"interface": "socketcand", "host": url.hostname, "port": url.port, "channel": url.path.removeprefix("/")}


def main(address):
    options = python_can_options(address)
    network = canopen.Network()
    network.connect(**options, **({"tcp_tune": True} if options["interface"] == "socketcand" else {}))
    listener = can.Bus(**options)
    try:
        nodes = {node_id: BaseNode402(node_id, dictionary(node_id)) for node_id in NODES}
        for node in nodes.values():
            network.add_node(node)
        run(network, listener, nodes)
    finally:
        network.sync.stop()
        listener.shutdown()
        network.disconnect()
    print("PASS all")


def run(network, listener, nodes):
    network.scanner.search(limit=8)
    wait_for("scanner", 2, lambda: sorted(network.scanner.nodes) == list(NODES))
    check("the scanner finds nodes 1 to 4 and no other", sorted(network.scanner.nodes) == list(NODES))

    for node_id, node in nodes.items():
        identity = [node.sdo[0x1018][sub].raw for sub in (1, 2, 3, 4)]
        check(f"identity of node {node_id}", identity[:3] == [0xFB, 0x60500000, 0x01700000], [hex(x) for x in identity])
    node = nodes[1]
    check("segmented upload of the device name", node.sdo[0x1008].raw == "EPOS4")
    check("encoder resolution", node.sdo[0x3000][5].raw == QC_PER_TURN)

    aborts = []
    for index, sub, data in ((0x6072, 0, b"\0\0"), (0x6041, 0, b"\0\0"), (0x605A, 0, b"\2\0"), (0x1018, 9, b"\0"), (0x6040, 0, b"\0")):
        try:
            node.sdo.download(index, sub, data)
        except canopen.SdoAbortedError as error:
            aborts.append(error.code)
    check("abort codes", aborts == [0x06020000, 0x06010002, 0x06090030, 0x06090011, 0x06070010], [hex(x) for x in aborts])

    nodes[3].nmt.send_command(0x81)
    nodes[3].nmt.wait_for_bootup(2)
    check("boot-up after reset of node 3", True)
    for node in nodes.values():
        node.sdo[0x1017].raw = 50
        node.nmt.wait_for_heartbeat(2)
        # The statusword is sent when it changes, and on entering OPERATIONAL: the master must be listening by then.
        node.nmt.state = "PRE-OPERATIONAL"
        node.nmt.wait_for_heartbeat(2)
        # As maxon advises for generic masters: else a new mode would go out in RPDO2 with an old controlword.
        for pdo in (1, 2, 3):
            node.sdo[0x1400 + pdo][1].raw |= 0x80000000
        node.setup_402_state_machine()
        node.nmt.state = "OPERATIONAL"
        wait_for("heartbeat", 2, lambda: node.nmt.wait_for_heartbeat(2) == "OPERATIONAL")
        check(f"heartbeat of node {node.id}", node.nmt.state == "OPERATIONAL")
        check(f"statusword and controlword of node {node.id} by pdo", 0x6041 in node.tpdo_values and 0x6040 in node.rpdo_pointers)

    for node in nodes.values():
        # Once two of them have come, BaseNode402 takes the statusword for periodic and waits for the next one: so it is.
        node.nmt.state = "PRE-OPERATIONAL"
        node.tpdo[1].trans_type = 1
        node.tpdo[1].save()
        check(f"node {node.id} sends its statusword on sync", node.sdo[0x1800][2].raw == 1)
        node.nmt.state = "OPERATIONAL"
    network.sync.start(0.01)

    wait_for("listener", 2, lambda: (m := listener.recv(0.1)) and m.arbitration_id == 0x701 and bytes(m.data) == b"\x05")
    check("a second client hears the bus", True)

    for node in nodes.values():
        node.state = "OPERATION ENABLED"
        check(f"node {node.id} enabled", node.state == "OPERATION ENABLED", hex(node.statusword))

    profile_position(nodes[1])
    profile_velocity(nodes[3])
    # The feed without a jaw: the other one is stopped by the jaw it closes.
    homing(nodes[4], 17, "the negative limit switch", -QC_PER_MM)
    profile_position(nodes[4])
    current_limit(nodes[4])
    nodes[4].sdo[0x3142][1].raw = 255  # the limit switch lies before the stop
    homing(nodes[4], -4, "the hard stop by current", -2 * QC_PER_MM)
    nodes[4].sdo[0x3142][1].raw = 0
    homing(nodes[1], 34, "the encoder index", -100)
    homing(nodes[1], 37, "the present position", 0)
    fault(network, nodes[4])
    latency(nodes[1])
    for node in nodes.values():
        node.state = "SWITCH ON DISABLED"
        check(f"node {node.id} disabled", node.state == "SWITCH ON DISABLED")


def move(node, target_qc, limit_s=10):
    node.sdo[0x607A].raw = target_qc
    node.sdo[0x6040].raw = 0x0F  # homing leaves its start bit set: a set point needs the edge
    node.sdo[0x6040].raw = 0x1F
    wait_for("set point acknowledged", 1, lambda: node.sdo[0x6041].raw & 0x1000)
    node.sdo[0x6040].raw = 0x0F
    wait_for("target reached", limit_s, lambda: node.sdo[0x6041].raw & 0x1400 == 0x0400)


def profile_position(node):
    node.op_mode = "PROFILED POSITION"
    node.state = "OPERATION ENABLED"
    node.sdo[0x6081].raw = 3000
    for target_qc in (21504, 1000, 43008, 0):
        start = time.monotonic()
        move(node, target_qc)
        took_s = time.monotonic() - start
        time.sleep(0.02)
        position_qc = node.sdo[0x6064].raw
        check(f"node {node.id} profile position to {target_qc} qc", abs(position_qc - target_qc) <= 1, f"{position_qc} qc, {took_s:.3f} s")


def profile_velocity(node):
    node.op_mode = "PROFILED VELOCITY"
    node.sdo[0x60FF].raw = -1200
    node.state = "OPERATION ENABLED"
    wait_for("velocity", 2, lambda: node.sdo[0x606C].raw == -1200)
    check("profile velocity", node.sdo[0x6041].raw & 0x0400 != 0)
    node.sdo[0x60FF].raw = 0
    wait_for("velocity zero", 2, lambda: node.sdo[0x6041].raw & 0x1400 == 0x1400)
    check("profile velocity back to zero", True)


def homing(node, method, what, position_qc):
    node.sdo[0x6098].raw = method
    node.sdo[0x6099][1].raw = 500
    node.sdo[0x6099][2].raw = 50
    node.sdo[0x30B0].raw = position_qc
    node.controlword = 0x0F  # the start bit of the last homing falls
    homed = node.homing(timeout=20)
    check(f"homing {method} of node {node.id} on {what}", homed, hex(node.statusword))
    check(f"homing {method} gives the home position", node.sdo[0x6064].raw == position_qc and node.sdo[0x6041].raw & 0x8000)


def current_limit(node):
    """Onto the hard stop at 15 mm with little current and without a following error."""
    move(node, 14 * QC_PER_MM)
    node.sdo[0x3001][2].raw = 300
    node.sdo[0x6065].raw = 0xFFFFFFFF
    node.sdo[0x607A].raw = 16 * QC_PER_MM
    node.sdo[0x6040].raw = 0x1F
    wait_for("stall", 10, lambda: node.sdo[0x6041].raw & 0x0800 and node.sdo[0x606C].raw == 0)
    current_ma, feed_mm = node.sdo[0x30D1][2].raw, node.sdo[0x6064].raw / QC_PER_MM
    check("the current limit stalls the drive", current_ma == 300 and abs(feed_mm - 15) < 0.01, f"{current_ma} mA at {feed_mm:.3f} mm")
    node.sdo[0x6040].raw = 0x0F
    node.sdo[0x607A].raw = 0
    node.sdo[0x6040].raw = 0x3F
    wait_for("back", 10, lambda: node.sdo[0x6041].raw & 0x0400 and abs(node.sdo[0x6064].raw) <= 1)
    node.sdo[0x6040].raw = 0x0F
    node.sdo[0x3001][2].raw = 1000
    node.sdo[0x6065].raw = 2000
    check("and it comes back", True)


def fault(network, node):
    """Into the hard stop of the feed until the following error."""
    node.op_mode = "PROFILED POSITION"
    node.state = "OPERATION ENABLED"
    node.emcy.reset()
    node.sdo[0x6081].raw = 3000
    node.sdo[0x607A].raw = 500_000
    node.sdo[0x6040].raw = 0x0F
    node.sdo[0x6040].raw = 0x1F
    wait_for("fault", 10, lambda: node.sdo[0x6041].raw & 0x4F == 0x08)
    codes = [error.code for error in node.emcy.log]
    check("a blocked axis is an emergency", codes == [0x8611], [hex(code) for code in codes])
    check("error code object", node.sdo[0x603F].raw == 0x8611)
    node.sdo[0x6040].raw = 0x0000
    node.sdo[0x6040].raw = 0x0080
    wait_for("fault reset", 1, lambda: node.sdo[0x6041].raw & 0x4F == 0x40)
    wait_for("emergency reset", 1, lambda: [error.code for error in node.emcy.log] == [0x8611, 0])
    check("fault reset on the edge", True)


def latency(node):
    count = 2000
    start = time.monotonic()
    for _ in range(count):
        node.sdo.upload(0x6041, 0)
    rate = count / (time.monotonic() - start)
    check("sdo uploads", rate > 200, f"{rate:.0f} a second")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])

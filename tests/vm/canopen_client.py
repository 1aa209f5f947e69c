"""A foreign CANopen master over AF_CAN: python canopen and python-can, both unmodified: `canopen_client.py INTERFACE`.

The interface has the four simulated drives and no other master. This is the part of `tests/peers` that shows whether the
kernel's sockets make a difference; the whole of it takes too long where the processor is emulated.
"""

import sys
import threading
import time

import canopen
from canopen import objectdictionary as od
from canopen.profiles.p402 import BaseNode402

TARGET_QC = 21504
NODES = (1, 2, 3, 4)

# index, subindex, type: written from the drive's manual and not from the simulator's table
OBJECTS = [(0x1000, 0, od.UNSIGNED32), (0x1008, 0, od.VISIBLE_STRING), (0x1017, 0, od.UNSIGNED16),
           *((0x1018, sub, od.UNSIGNED32) for sub in (1, 2, 3, 4)), (0x3000, 5, od.UNSIGNED32),
           (0x6040, 0, od.UNSIGNED16), (0x6041, 0, od.UNSIGNED16), (0x6060, 0, od.INTEGER8), (0x6061, 0, od.INTEGER8),
           (0x6064, 0, od.INTEGER32), (0x607A, 0, od.INTEGER32), (0x6081, 0, od.UNSIGNED32), (0x6098, 0, od.INTEGER8),
           (0x60FF, 0, od.INTEGER32), (0x6071, 0, od.INTEGER16), (0x606C, 0, od.INTEGER32), (0x6502, 0, od.UNSIGNED32)]
for pdo in range(4):
    OBJECTS += [(0x1400 + pdo, sub, kind) for sub, kind in ((0, od.UNSIGNED8), (1, od.UNSIGNED32), (2, od.UNSIGNED8))]
    OBJECTS += [(0x1800 + pdo, sub, kind) for sub, kind in ((0, od.UNSIGNED8), (1, od.UNSIGNED32), (2, od.UNSIGNED8), (3, od.UNSIGNED16))]
    for base in (0x1600, 0x1A00):
        OBJECTS += [(base + pdo, 0, od.UNSIGNED8), *((base + pdo, sub, od.UNSIGNED32) for sub in range(1, 13))]


def dictionary():
    objects = od.ObjectDictionary()
    indices = sorted({index for index, _, _ in OBJECTS})
    for index in indices:
        members = [(sub, kind) for other, sub, kind in OBJECTS if other == index]
        variables = []
        for sub, kind in members:
            variable = od.ODVariable(f"{index:04X}:{sub:02X}", index, sub)
            variable.data_type, variable.access_type = kind, "rw"
            variables.append(variable)
        if len(variables) == 1 and variables[0].subindex == 0:
            objects.add_object(variables[0])
            continue
        record = od.ODRecord(f"{index:04X}", index)
        for variable in variables:
            record.add_member(variable)
        objects.add_object(record)
    return objects


def check(name, condition, seen=""):
    print(f"{'PASS' if condition else 'FAIL'} {name}" + (f": {seen}" if seen != "" else ""), flush=True)


def wait_for(condition, limit_s=20):
    end = time.monotonic() + limit_s
    while not (found := condition()) and time.monotonic() < end:
        time.sleep(0.01)
    return found


def main(interface):
    # What the profile's client waits for a transition is meant for a machine that computes in time.
    BaseNode402.TIMEOUT_SWITCH_OP_MODE = BaseNode402.TIMEOUT_SWITCH_STATE_FINAL = BaseNode402.TIMEOUT_SWITCH_STATE_SINGLE = 10
    network = canopen.Network()
    network.connect(interface="socketcan", channel=interface)
    try:
        nodes = {node_id: BaseNode402(node_id, dictionary()) for node_id in NODES}
        for node in nodes.values():
            node.sdo.RESPONSE_TIMEOUT = 10
            network.add_node(node)
        communication(network, nodes)
        motion(network, nodes[1])
    finally:
        network.sync.stop()
        network.disconnect()


def communication(network, nodes):
    network.scanner.search(limit=8)
    wait_for(lambda: len(network.scanner.nodes) >= len(NODES))
    check("the scanner finds the four drives", sorted(network.scanner.nodes) == list(NODES), sorted(network.scanner.nodes))
    node = nodes[1]
    identity = [node.sdo[0x1018][sub].raw for sub in (1, 2)]
    check("an expedited upload", identity == [0xFB, 0x60500000], [hex(x) for x in identity])
    check("a segmented upload", node.sdo[0x1008].raw == "EPOS4", node.sdo[0x1008].raw)
    node.sdo[0x6081].raw = 3000
    check("a download is read back", node.sdo[0x6081].raw == 3000)
    try:
        node.sdo.download(0x6072, 0, b"\0\0")
        code = 0
    except canopen.SdoAbortedError as error:
        code = error.code
    check("an abort by its code", code == 0x06020000, hex(code))
    # Not `wait_for_bootup`: the message may have come before that begins to wait.
    booted = threading.Event()
    nodes[3].nmt.add_heartbeat_callback(lambda state: state == 0 and booted.set())
    nodes[3].nmt.send_command(0x81)
    check("boot-up after a reset", booted.wait(20))
    node.sdo[0x1017].raw = 50
    node.nmt.state = "OPERATIONAL"
    heard = []
    node.nmt.add_heartbeat_callback(heard.append)
    check("heartbeats", wait_for(lambda: heard.count(5) >= 3), f"{len(heard)} heard")


def motion(network, node):
    node.nmt.state = "PRE-OPERATIONAL"
    # As maxon advises for generic masters: else a new mode would go out in RPDO2 with an old controlword.
    for pdo in (1, 2, 3):
        node.sdo[0x1400 + pdo][1].raw |= 0x80000000
    node.setup_402_state_machine()
    node.tpdo[1].trans_type = 1
    node.tpdo[1].save()
    node.nmt.state = "OPERATIONAL"
    network.sync.start(0.02)
    node.op_mode = "PROFILED POSITION"
    node.state = "OPERATION ENABLED"
    check("the state machine by process data", node.state == "OPERATION ENABLED", hex(node.statusword))
    node.sdo[0x607A].raw = TARGET_QC
    node.sdo[0x6040].raw = 0x0F
    node.sdo[0x6040].raw = 0x1F
    wait_for(lambda: node.sdo[0x6041].raw & 0x1000)
    node.sdo[0x6040].raw = 0x0F
    wait_for(lambda: node.sdo[0x6041].raw & 0x1400 == 0x0400)
    position_qc = node.sdo[0x6064].raw
    check("a move to its target", abs(position_qc - TARGET_QC) <= 1, f"{position_qc} qc")
    node.state = "SWITCH ON DISABLED"
    start = time.monotonic()
    seen = [node.sdo[0x6064].raw for _ in range(300)]
    rate = len(seen) / (time.monotonic() - start)
    check("uploads one after the other", set(seen) == {seen[0]}, f"{rate:.0f} a second, as the emulator goes")
    print("PASS to the end", flush=True)


if __name__ == "__main__":
    main(sys.argv[1])

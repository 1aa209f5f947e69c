"""NMT, heartbeats, process data, and the parameters that a drive keeps."""

import time

import canopen

from canopen_check import wait_for
from canopen_objects import variables

HOST = 127
PDO_OFF = 0x80000000


def restart_all(report, network, nodes):
    """One command for all, whatever a client before has left."""
    started = set()
    for node_id, node in nodes.items():
        node.nmt.add_heartbeat_callback(lambda state, node_id=node_id: state == 0 and started.add(node_id))
    network.nmt.send_command(0x81)
    wait_for("boot-up of all", 5, lambda: len(started) == len(nodes))
    report.check("a reset for all restarts all", True)


def scan(report, network, nodes):
    """Who is there."""
    network.scanner.reset()
    network.scanner.search(limit=8)
    wait_for("four nodes", 2, lambda: len(network.scanner.nodes) >= len(nodes))
    report.check("the scanner finds nodes 1 to 4 and no other", sorted(network.scanner.nodes) == sorted(nodes))
    serials = set()
    for node_id, node in nodes.items():
        identity = [node.sdo[0x1018][subindex].raw for subindex in (1, 2, 3)]
        report.check(f"identity of node {node_id}", identity == [0xFB, 0x60500000, 0x01700000], [hex(x) for x in identity])
        report.check(f"name of node {node_id}", node.sdo[0x1008].raw == "EPOS4")
        serials.add(node.sdo[0x1018][4].raw)
    report.check("serial numbers differ", len(serials) == len(nodes))


def states(report, node):
    """The NMT states and what works in each."""
    node.nmt.send_command(0x81)
    node.nmt.wait_for_bootup(5)
    report.check("boot-up after a reset of the node", True)
    node.nmt.send_command(0x82)
    node.nmt.wait_for_bootup(5)
    report.check("boot-up after a reset of the communication", True)
    node.sdo[0x1017].raw = 50
    heard(node, "PRE-OPERATIONAL")
    report.check("a started node is pre-operational", True)
    for order, state in (("OPERATIONAL", "OPERATIONAL"), ("STOPPED", "STOPPED"), ("PRE-OPERATIONAL", "PRE-OPERATIONAL")):
        node.nmt.state = order
        heard(node, state)
        report.check(f"the heartbeat tells {state}", True)
        answered = True
        try:
            node.sdo.upload(0x1000, 0)
        except canopen.SdoCommunicationError:
            answered = False
        report.check(f"SDO in {state}", answered == (state != "STOPPED"))
        if answered:
            remote = bool(node.sdo[0x6041].raw & 0x0200)
            report.check(f"remote bit in {state}", remote == (state == "OPERATIONAL"))
    times = []
    node.nmt.add_heartbeat_callback(lambda _: times.append(node.nmt.timestamp))
    wait_for("ten heartbeats", 5, lambda: len(times) >= 10)
    period_s = (times[9] - times[0]) / 9
    report.check("heartbeats come in their period", abs(period_s - 0.05) < 0.005, f"{period_s:.4f} s")
    node.sdo[0x1017].raw = 0
    count = len(times)
    node.sdo.upload(0x1000, 0)
    time.sleep(0.3)
    report.check("period 0 is silence", len(times) <= count + 1)


def heard(node, state):
    """Waits for a heartbeat with this state."""
    wait_for(f"heartbeat {state}", 5, lambda: node.nmt.wait_for_heartbeat(5) == state)


def consumer(report, network, node):
    """The drive watches the heartbeat of a host and stops when it stays out."""
    node.sdo[0x1029][1].raw = 1
    node.sdo[0x1016][1].raw = HOST << 16 | 400
    node.emcy.reset()
    time.sleep(0.6)
    report.check("a host that never lived is not missed", not node.emcy.log)
    host = network.send_periodic(0x700 + HOST, b"\x05", 0.05)
    time.sleep(1.0)
    report.check("no error while the host lives", not node.emcy.log, [hex(error.code) for error in node.emcy.log])
    node.state = "OPERATION ENABLED"
    host.stop()
    wait_for("emergency", 3, lambda: [error for error in node.emcy.log if error.code == 0x8130])
    report.check("its death is emergency 0x8130", True)
    wait_for("fault", 2, lambda: node.sdo[0x6041].raw & 0x4F == 0x08)
    report.check("and the drive is in fault", True)
    register = node.emcy.log[-1].register
    report.check("with the communication bit of the register", register & 0x10, hex(register))
    node.sdo[0x1016][1].raw = 0
    node.sdo[0x1029][1].raw = 0
    node.sdo[0x6040].raw = 0x00
    node.sdo[0x6040].raw = 0x80
    wait_for("fault reset", 2, lambda: node.sdo[0x6041].raw & 0x4F == 0x40)
    node.sdo[0x6040].raw = 0x00


def default_mapping(report, node):
    """Process data as the factory maps them, found by python canopen itself."""
    node.nmt.state = "PRE-OPERATIONAL"
    node.sdo[0x1017].raw = 50
    heard(node, "PRE-OPERATIONAL")
    node.setup_402_state_machine()
    report.check(f"statusword and controlword of node {node.id} by pdo", 0x6041 in node.tpdo_values and 0x6040 in node.rpdo_pointers)
    mapped = [[variable.index for variable in node.rpdo[number]] for number in (1, 2, 3, 4)]
    report.check("receive pdos as from the factory", mapped == [[0x6040], [0x6040, 0x6060], [0x6040, 0x607A], [0x6040, 0x60FF]], mapped)
    mapped = [[variable.index for variable in node.tpdo[number]] for number in (1, 2, 3, 4)]
    report.check("transmit pdos as from the factory", mapped == [[0x6041], [0x6041, 0x6061], [0x6041, 0x6064], [0x6041, 0x606C]], mapped)
    enabled = [node.tpdo[number].enabled for number in (1, 2, 3, 4)]
    report.check("one transmit pdo is on", enabled == [True, False, False, False], enabled)
    received = []
    node.tpdo[1].add_callback(lambda pdo: received.append(pdo["statusword"].raw))
    node.nmt.state = "OPERATIONAL"
    wait_for("statusword on entering operational", 2, lambda: received)
    report.check("the statusword is sent on entering operational", received[0] & 0x6F == 0x40, hex(received[0]))
    node.rpdo[1]["controlword"].raw = 0x06
    node.rpdo[1].transmit()
    wait_for("statusword on change", 2, lambda: received[-1] & 0x6F == 0x21)
    report.check("and on change, after a controlword by pdo", True)
    count = len(received)
    time.sleep(0.2)
    report.check("and not without a change", len(received) == count)
    node.rpdo[1]["controlword"].raw = 0x00
    node.rpdo[1].transmit()
    wait_for("statusword on change", 2, lambda: received[-1] & 0x6F == 0x40)


def synchronous(report, network, node):
    """Statusword on every SYNC, which python canopen's state machine takes for periodic; the other receive PDOs off, as
    maxon advises for generic masters: else a new mode would go out with an old controlword."""
    node.nmt.state = "PRE-OPERATIONAL"
    for pdo in (1, 2, 3):
        node.sdo[0x1400 + pdo][1].raw |= PDO_OFF
    node.tpdo[1].trans_type = 1
    node.tpdo[1].save()
    node.rpdo_pointers.clear()  # it keeps what it found in a receive pdo that is off now
    node.setup_402_state_machine()
    report.check(f"node {node.id} sends its statusword on sync", node.sdo[0x1800][2].raw == 1)
    node.nmt.state = "OPERATIONAL"
    heard(node, "OPERATIONAL")
    report.check(f"node {node.id} is operational", True)


def parameters(report, node):
    """Save, restart, restore: what is kept and what is not. Ends with the parameters of the beginning."""
    node.nmt.state = "PRE-OPERATIONAL"
    stored = {(variable.index, variable.subindex): node.sdo.upload(variable.index, variable.subindex) for variable in
              variables(node.object_dictionary) if variable.writable and variable.index not in (0x1003, 0x1010, 0x1011, 0x6040)}
    node.sdo[0x6081].raw = 1234
    restart(node)
    report.check("what is not saved is gone after a reset", node.sdo[0x6081].raw != 1234)
    node.sdo[0x6081].raw = 1234
    node.sdo[0x607A].raw = 99
    node.sdo[0x1010][1].raw = int.from_bytes(b"save", "little")
    restart(node)
    report.check("what is saved is there after a reset", node.sdo[0x6081].raw == 1234)
    report.check("a target is not saved", node.sdo[0x607A].raw == 0)
    node.sdo[0x1011][1].raw = int.from_bytes(b"load", "little")
    report.check("restored values wait for the reset", node.sdo[0x6081].raw == 1234)
    restart(node)
    for variable in variables(node.object_dictionary):
        if not variable.writable or variable.index in (0x1003, 0x6040):
            continue
        value = node.sdo.get_variable(variable.index, variable.subindex).raw
        report.check(f"{variable.index:04X}:{variable.subindex:02X} has its factory value", value == variable.default, f"{value} {variable.default}")
    refused = write_back(node, stored)
    node.sdo[0x1010][1].raw = int.from_bytes(b"save", "little")
    restart(node)
    differ = [f"{index:04X}:{subindex:02X}" for (index, subindex), data in stored.items() if node.sdo.upload(index, subindex) != data]
    report.check("the parameters of the beginning are back", not refused and not differ, (refused, differ))


def write_back(node, stored):
    """Writes parameters in an order that the rules allow; what was refused."""
    for index, subindex in stored:
        if index == 0x3142 and subindex:  # a function is given to one input alone
            node.sdo.download(index, subindex, b"\xff")
    refused = []
    for (index, subindex), data in stored.items():
        try:
            if node.sdo.upload(index, subindex) != data:
                node.sdo.download(index, subindex, data)
        except canopen.SdoAbortedError as error:
            refused.append((f"{index:04X}:{subindex:02X}", hex(error.code)))
    return refused


def restart(node):
    """Resets the node and waits for it."""
    node.nmt.send_command(0x81)
    node.nmt.wait_for_bootup(5)

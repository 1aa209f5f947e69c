"""A CANopen slave that nobody here wrote, for our master: python canopen's LocalNode.

    python canopen_slave.py BUS EDS NODE_ID

BUS is `socketcand://HOST:PORT/can0` or `socketcan:vcan0`. The node has the objects of the data sheet with their factory values,
a longer device name, and 0x5000, which takes any bytes. It tells its boot-up, prints READY, and then obeys the lines of standard input, `emcy CODE REGISTER`,
until that closes.
"""

import sys

import canopen
from canopen.objectdictionary import ODVariable, datatypes

from canopen_epos4 import connected

DEVICE_NAME = "EPOS4 as python canopen's LocalNode serves it"


def scratch():
    """An object that takes any bytes; the drive has none."""
    variable = ODVariable("scratch", 0x5000, 0)
    variable.data_type = datatypes.DOMAIN
    variable.access_type = "rw"
    return variable


def main(bus, eds, node_id):
    network = connected(bus)
    try:
        objects = canopen.import_od(eds, node_id)
        objects.add_object(scratch())
        node = canopen.LocalNode(node_id, objects)
        network.add_node(node)
        node.sdo[0x1008].raw = DEVICE_NAME
        node.nmt.send_command(0x81)
        node.nmt.send_command(0x80)
        print("READY", flush=True)
        for line in sys.stdin:
            command, code, register = line.split()
            if command != "emcy":
                raise ValueError(f"unknown command {command}")
            node.emcy.send(int(code, 0), int(register, 0), b"\1\2\3\4\5")
    finally:
        network.disconnect()


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]))

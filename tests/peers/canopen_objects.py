"""The electronic data sheet, and every object of it against the drive: read, written, refused."""

import struct

import canopen
from canopen.objectdictionary import ODVariable, datatypes

U8, U16, U32 = datatypes.UNSIGNED8, datatypes.UNSIGNED16, datatypes.UNSIGNED32
I8, I16, I32 = datatypes.INTEGER8, datatypes.INTEGER16, datatypes.INTEGER32
TEXT = datatypes.VISIBLE_STRING

READ_ONLY, NO_OBJECT, NO_SUBINDEX = 0x06010002, 0x06020000, 0x06090011
LENGTH, TOO_LONG, TOO_SHORT = 0x06070010, 0x06070012, 0x06070013
VALUE_RANGE, DEVICE_STATE = 0x06090030, 0x08000022
NOT_MAPPABLE, PDO_LENGTH, SUBINDEX, CANNOT_STORE = 0x06040041, 0x06040042, 0x06010003, 0x08000020
UNKNOWN_COMMAND, TOGGLE_BIT = 0x05040001, 0x05030000

MAX_U32 = 2**32 - 1

# index, subindex, type, writable, default, low, high, mappable: from the drive's manual and not from the table that the
# data sheet is written from. None is not stated.
FACTS = [
    (0x1000, 0, U32, False, 0x00020192, None, None, False), (0x1001, 0, U8, False, None, None, None, False),
    (0x1008, 0, TEXT, False, "EPOS4", None, None, False), (0x1010, 1, U32, True, 1, None, None, False),
    (0x1014, 0, U32, False, 0x83, None, None, False), (0x1016, 1, U32, True, 0, None, None, False),
    (0x1017, 0, U16, True, 0, None, None, False), (0x1018, 1, U32, False, 0xFB, None, None, False),
    (0x1018, 2, U32, False, 0x60500000, None, None, False), (0x1018, 3, U32, False, 0x01700000, None, None, False),
    (0x1029, 1, U8, True, 0, None, None, False), (0x1400, 1, U32, True, 0x203, None, None, False),
    (0x1400, 2, U8, True, 255, None, None, False), (0x1600, 0, U8, True, 1, 0, 12, False),
    (0x1602, 2, U32, True, 0x607A0020, None, None, False), (0x1800, 1, U32, True, 0x40000183, None, None, False),
    (0x1801, 1, U32, True, 0xC0000283, None, None, False), (0x1800, 3, U16, True, 10, None, None, False),
    (0x1A03, 2, U32, True, 0x606C0020, None, None, False), (0x2201, 1, U32, True, 8000, 8000, 28500, False),
    (0x3000, 5, U32, False, None, None, None, False), (0x3001, 1, U32, True, 1500, 0, 1500, True),
    (0x3001, 2, U32, True, 4500, 0, 4500, True), (0x3001, 3, U8, True, 1, 1, 255, False),
    (0x3003, 1, U32, True, 1, 1, MAX_U32, False), (0x3003, 3, U32, True, 100000, 1, 100000, False),
    (0x3010, 1, U32, True, 500, 16, 2500000, False), (0x3010, 4, I32, False, None, None, None, True),
    (0x30B0, 0, I32, True, 0, None, None, True), (0x30B1, 0, I32, True, 0, None, None, False),
    (0x30B2, 0, U16, True, 500, 0, 4500, True), (0x30D1, 1, I32, False, None, None, None, True),
    (0x30D1, 2, I32, False, None, None, None, True), (0x30E0, 1, U32, True, 30, None, None, False),
    (0x3142, 1, U8, True, 0, None, None, False), (0x3142, 4, U8, True, 19, None, None, False),
    (0x6007, 0, I16, True, 3, 2, 3, False), (0x603F, 0, U16, False, None, None, None, True),
    (0x6040, 0, U16, True, 0, None, None, True), (0x6041, 0, U16, False, None, None, None, True),
    (0x605A, 0, I16, True, 6, 6, 6, False), (0x605E, 0, I16, True, 2, 0, 2, False),
    (0x6060, 0, I8, True, 1, None, None, True), (0x6061, 0, I8, False, None, None, None, True),
    (0x6062, 0, I32, False, None, None, None, True), (0x6064, 0, I32, False, None, None, None, True),
    (0x6065, 0, U32, True, 2000, None, None, True), (0x6066, 0, U16, True, 0, 0, 0, True),
    (0x6067, 0, U32, True, MAX_U32, None, None, True), (0x606C, 0, I32, False, None, None, None, True),
    (0x6071, 0, I16, True, 0, None, None, True), (0x6076, 0, U32, False, None, None, None, False),
    (0x6077, 0, I16, False, None, None, None, True), (0x607A, 0, I32, True, 0, None, None, True),
    (0x607B, 1, I32, True, 0, 0, 0, True), (0x607D, 1, I32, True, 0, None, None, True),
    (0x607F, 0, U32, True, 50000, None, None, True), (0x6081, 0, U32, True, 1000, None, None, True),
    (0x6083, 0, U32, True, 10000, 1, MAX_U32, True), (0x6085, 0, U32, True, 10000, 1, MAX_U32, True),
    (0x6098, 0, I8, True, 7, None, None, True), (0x6099, 1, U32, True, 100, None, None, True),
    (0x6099, 2, U32, True, 10, None, None, True), (0x609A, 0, U32, True, 1000, 1, MAX_U32, True),
    (0x60A9, 0, U32, True, 0x00B44700, None, None, False), (0x60C2, 1, U8, True, 0, 0, 100, True),
    (0x60C5, 0, U32, True, MAX_U32, 1, MAX_U32, True), (0x60E3, 1, I8, False, 37, None, None, False),
    (0x60FD, 0, U32, False, None, None, None, True), (0x60FF, 0, I32, True, 0, None, None, True),
    (0x6402, 0, U16, True, 10, None, None, False), (0x6502, 0, U32, False, 0x3A5, None, None, True),
]

# What the drive has not, index and subindex.
ABSENT_OBJECTS = [0x1006, 0x1009, 0x100A, 0x100C, 0x100D, 0x1015, 0x1019, 0x605D, 0x6072, 0x607C, 0x5FFF, 0xA000]
ABSENT_SUBINDICES = [(0x1018, 5), (0x1400, 5), (0x1800, 5), (0x1A00, 13), (0x3001, 9), (0x6041, 1)]

# Written with power alone off.
POWER_OFF = [(0x3000, 1), (0x3000, 2), (0x3000, 3), (0x3001, 3), (0x3003, 1), (0x3003, 2), (0x3010, 1), (0x3010, 2), (0x60A9, 0)]


def variables(dictionary):
    """Every variable, members of records and arrays among them."""
    for entry in dictionary.values():
        if isinstance(entry, ODVariable):
            yield entry
        else:
            yield from (entry.subindices[subindex] for subindex in sorted(entry.subindices))


def abort_code(action, *arguments):
    """The code with which the drive refused; 0 if it did not."""
    try:
        action(*arguments)
    except canopen.SdoAbortedError as error:
        return error.code
    return 0


def place(variable):
    return f"{variable.index:04X}:{variable.subindex:02X} {variable.name}"


def data_sheet(report, dictionary):
    """The file as python canopen read it, for node 3."""
    info = dictionary.device_information
    report.check("vendor, product and revision", (info.vendor_number, info.product_number, info.revision_number)
                 == (0xFB, 0x60500000, 0x01700000))
    report.check("four PDOs in each direction", (info.nr_of_RXPDO, info.nr_of_TXPDO) == (4, 4))
    report.check("1 Mbit/s is among the bit rates", 1_000_000 in info.allowed_baudrates)
    for index, subindex, kind, writable, default, low, high, mappable in FACTS:
        variable = dictionary.get_variable(index, subindex)
        if variable is None:
            report.check(f"{index:04X}:{subindex:02X} is described", False)
            continue
        stated = [(variable.data_type, kind), (variable.writable, writable), (variable.pdo_mappable, mappable)]
        stated += [(variable.default, default)] if default is not None else []
        full = index == 0x3001 and subindex == 3 or high == MAX_U32 and low == 0
        if low is not None and not full:
            stated += [(variable.min, low), (variable.max, high)]
        report.check(f"{place(variable)} is described as in the manual", all(a == b for a, b in stated), stated)
    absent = [hex(index) for index in ABSENT_OBJECTS if index in dictionary]
    report.check("what the drive has not is not described", not absent, absent)
    described = list(variables(dictionary))
    report.check("every variable has a name of its own within its object, a type and a default",
                 all(variable.name and variable.default is not None for variable in described), len(described))


def reads(report, node):
    """Every object is read, has the size of its type, and keeps to its limits."""
    for variable in variables(node.object_dictionary):
        code, data = 0, b""
        try:
            # Not by the dictionary: it would cut the answer to the size it expects.
            with node.sdo.open(variable.index, variable.subindex, buffering=0) as stream:
                data = stream.read()
        except canopen.SdoAbortedError as error:
            code = error.code
        size = len(variable.default) if variable.data_type == TEXT else len(variable) // 8
        report.check(f"{place(variable)} is read", code == 0 and len(data) == size, data.hex() if not code else hex(code))


def writes(report, node):
    """Every object takes its own value or refuses as it is described; nothing is changed in the end."""
    for variable in variables(node.object_dictionary):
        index, subindex = variable.index, variable.subindex
        before = node.sdo.upload(index, subindex)
        write = lambda data: abort_code(node.sdo.download, index, subindex, data)  # noqa: E731
        if not variable.writable:
            report.check(f"{place(variable)} refuses a write", write(before) == READ_ONLY)
            continue
        code = write(before)
        expected = expected_of_own_value(node, variable)
        report.check(f"{place(variable)} takes its own value", code == expected, f"0x{code:08X}")
        if variable.data_type == TEXT:
            continue
        too_long = write(before + b"\0")
        too_short = write(before[:-1]) if len(before) > 1 else TOO_SHORT
        report.check(f"{place(variable)} refuses a wrong length", too_long in (LENGTH, TOO_LONG) and too_short in (LENGTH, TOO_SHORT),
                     f"0x{too_long:08X} 0x{too_short:08X}")
        for beyond in (None if variable.min is None else variable.min - 1, None if variable.max is None else variable.max + 1):
            if beyond is not None and (data := encoded(variable, beyond)) is not None:
                code = write(data)
                report.check(f"{place(variable)} refuses {beyond}", code == VALUE_RANGE, f"0x{code:08X}")
        report.check(f"{place(variable)} is as before", node.sdo.upload(index, subindex) == before)


def expected_of_own_value(node, variable):
    """The abort code of writing what is there: 0 but for signatures and mappings in use."""
    if variable.index in (0x1010, 0x1011):
        return CANNOT_STORE
    if variable.index in (0x1600, 0x1601, 0x1602, 0x1603, 0x1A00, 0x1A01, 0x1A02, 0x1A03):
        if not node.sdo[variable.index - 0x200][1].raw & 0x80000000:
            return DEVICE_STATE
        if variable.subindex and node.sdo[variable.index][0].raw:
            return SUBINDEX
    return 0


def encoded(variable, value):
    """Bytes of the type; None when it cannot hold the value."""
    formats = {U8: "<B", U16: "<H", U32: "<I", I8: "<b", I16: "<h", I32: "<i"}
    try:
        return struct.pack(formats[variable.data_type], value)
    except struct.error:
        return None


def refusals(report, node):
    """What is not there, and what waits for another state."""
    for index in ABSENT_OBJECTS:
        codes = abort_code(node.sdo.upload, index, 0), abort_code(node.sdo.download, index, 0, b"\0")
        report.check(f"{index:04X} is absent", codes == (NO_OBJECT, NO_OBJECT), [hex(code) for code in codes])
    for index, subindex in ABSENT_SUBINDICES:
        codes = abort_code(node.sdo.upload, index, subindex), abort_code(node.sdo.download, index, subindex, b"\0")
        report.check(f"{index:04X}:{subindex:02X} is absent", codes == (NO_SUBINDEX, NO_SUBINDEX), [hex(code) for code in codes])
    code = abort_code(lambda: node.sdo.open(0x1008, 0, "rb", block_transfer=True))
    report.check("block upload is refused", code == UNKNOWN_COMMAND, hex(code))
    report.check("the next transfer works", node.sdo.upload(0x1008, 0) == b"EPOS4")
    node.sdo.download(0x6081, 0, struct.pack("<I", 1000), force_segment=True)
    report.check("a segmented download is taken", node.sdo[0x6081].raw == 1000)
    code = abort_code(lambda: node.sdo.download(0x6081, 0, b"0123456789", force_segment=True))
    report.check("a segmented download of another length is refused", code in (LENGTH, TOO_LONG), hex(code))
    code = abort_code(node.sdo.download, 0x1010, 1, b"save"[::-1])
    report.check("a wrong signature is refused", code == CANNOT_STORE, hex(code))


def power(report, node):
    """Objects that are written with power off alone: the drive is enabled here."""
    for index, subindex in POWER_OFF:
        code = abort_code(node.sdo.download, index, subindex, node.sdo.upload(index, subindex))
        report.check(f"{index:04X}:{subindex:02X} is refused with power on", code == DEVICE_STATE, hex(code))


def mapping(report, node):
    """Mapping in the order of CiA 301, and everything out of order."""
    communication, record = node.sdo[0x1801], node.sdo[0x1A01]
    download = lambda subindex, value, size=4: abort_code(node.sdo.download, 0x1A01, subindex, value.to_bytes(size, "little"))  # noqa: E731
    before = communication[1].raw, [record[subindex].raw for subindex in range(13)]
    communication[1].raw = 0x40000280 + node.id
    report.check("a valid pdo keeps its mapping", download(0, 0, 1) == DEVICE_STATE)
    communication[1].raw = 0xC0000280 + node.id
    code = download(1, 0x60640020)
    report.check("an entry waits for the count to be 0", code == SUBINDEX, hex(code))
    report.check("the count is set to 0", download(0, 0, 1) == 0)
    for name, value, expected in (
        ("an object that is not there", 0x60720010, NOT_MAPPABLE), ("an object that is never sent", 0x607A0020, NOT_MAPPABLE),
        ("another size", 0x60640010, NOT_MAPPABLE), ("an object of no pdo", 0x10170010, NOT_MAPPABLE),
    ):
        code = download(1, value)
        report.check(f"{name} is not mapped", code == expected, hex(code))
    for subindex, value in enumerate((0x60640020, 0x606C0020, 0x60410010), start=1):
        report.check(f"entry {subindex} is mapped", download(subindex, value) == 0)
    code = download(0, 3, 1)
    report.check("ten bytes are too long", code == PDO_LENGTH, hex(code))
    report.check("more entries than twelve are refused", download(0, 13, 1) == VALUE_RANGE)
    report.check("eight bytes are mapped", download(0, 2, 1) == 0)
    # As it was, in the same order.
    download(0, 0, 1)
    for subindex, value in enumerate(before[1][1:], start=1):
        download(subindex, value)
    download(0, before[1][0], 1)
    communication[1].raw = before[0]
    report.check("the mapping is as before", [record[subindex].raw for subindex in range(13)] == before[1])

"""The drive profile CiA 402 as python canopen's BaseNode402 sees it: states, modes, homing, faults."""

import time

from canopen_check import wait_for
from canopen_network import PDO_OFF

QC_PER_TURN = 2048
# gear 21:1, lead 2 mm
QC_PER_MM = QC_PER_TURN * 21 // 2
ENABLE, NEW_SETPOINT, AT_ONCE, RELATIVE, HALT = 0x0F, 0x10, 0x20, 0x40, 0x100


def states(report, node):
    """Through all states and every way between them."""
    for state in ("READY TO SWITCH ON", "SWITCHED ON", "OPERATION ENABLED", "SWITCHED ON", "READY TO SWITCH ON", "SWITCH ON DISABLED",
                  "OPERATION ENABLED", "READY TO SWITCH ON", "OPERATION ENABLED", "SWITCH ON DISABLED", "OPERATION ENABLED",
                  "QUICK STOP ACTIVE", "SWITCH ON DISABLED", "OPERATION ENABLED"):
        before = node.state
        node.state = state
        report.check(f"node {node.id} {before} to {state}", node.state == state, hex(node.statusword))
    node.state = "QUICK STOP ACTIVE"
    node.sdo[0x6040].raw = 0x0F
    wait_for("enabled from quick stop", 2, lambda: node.sdo[0x6041].raw & 0x6F == 0x27)
    report.check("quick stop active back to operation enabled", True)
    node.state = "SWITCH ON DISABLED"
    for word, why in ((0x0F, "enable"), (0x07, "switch on"), (0x02, "quick stop"), (0x80, "fault reset without a fault")):
        node.sdo[0x6040].raw = word
        report.check(f"switch on disabled ignores {why}", node.sdo[0x6041].raw & 0x6F == 0x40)
    node.sdo[0x6040].raw = 0x00


def modes(report, node):
    """Every mode that 0x6502 lists, and those that the drive has not."""
    for mode, code in (("PROFILED VELOCITY", 3), ("HOMING", 6), ("CYCLIC SYNCHRONOUS POSITION", 8), ("CYCLIC SYNCHRONOUS VELOCITY", 9),
                       ("CYCLIC SYNCHRONOUS TORQUE", 10), ("PROFILED POSITION", 1)):
        node.op_mode = mode
        report.check(f"mode {mode}", node.sdo[0x6061].raw == code)
    for mode in ("INTERPOLATED POSITION", "PROFILED TORQUE", "VELOCITY"):
        report.check(f"no mode {mode}", not node.is_op_mode_supported(mode))


def command(node, flags, target_qc):
    """A new set point, and its acknowledgement."""
    node.sdo[0x607A].raw = target_qc
    node.sdo[0x6040].raw = ENABLE  # a set point needs the edge
    node.sdo[0x6040].raw = ENABLE | NEW_SETPOINT | flags
    wait_for("set point acknowledged", 2, lambda: node.sdo[0x6041].raw & 0x1000)
    node.sdo[0x6040].raw = ENABLE
    wait_for("acknowledgement taken back", 2, lambda: not node.sdo[0x6041].raw & 0x1000)


def arrived(node, limit_s=15):
    """Waits for target reached; where the motor then stands, qc."""
    wait_for("target reached", limit_s, lambda: node.sdo[0x6041].raw & 0x0400)
    wait_for("standing", 2, lambda: node.sdo[0x606C].raw == 0)
    return node.sdo[0x6064].raw


def profile_position(report, node):
    """Absolute, relative, at once, halt."""
    node.op_mode = "PROFILED POSITION"
    node.state = "OPERATION ENABLED"
    node.sdo[0x6081].raw = 3000
    node.sdo[0x6083].raw = node.sdo[0x6084].raw = 20_000
    start_qc = node.sdo[0x6064].raw
    for target_qc in (start_qc + 10_752, start_qc + 500, start_qc + 21_504):
        command(node, 0, target_qc)
        position_qc = arrived(node)
        report.check(f"node {node.id} to {target_qc} qc", abs(position_qc - target_qc) <= 1, f"{position_qc} qc")
    before_qc = node.sdo[0x6062].raw
    command(node, RELATIVE, -20_000)
    position_qc = arrived(node)
    report.check("by -20000 qc from the demand", abs(position_qc - (before_qc - 20_000)) <= 1, f"{position_qc} qc")
    far_qc, near_qc = position_qc + 2_000_000, position_qc + 60_000
    command(node, 0, far_qc)
    wait_for("on the way", 5, lambda: node.sdo[0x606C].raw > 2500)
    report.check("not reached while moving", not node.sdo[0x6041].raw & 0x0400)
    command(node, AT_ONCE, near_qc)
    position_qc = arrived(node)
    report.check("another target at once", abs(position_qc - near_qc) <= 1, f"{position_qc} qc")
    command(node, 0, position_qc + 2_000_000)
    wait_for("on the way", 5, lambda: node.sdo[0x606C].raw > 2500)
    node.sdo[0x6040].raw = ENABLE | HALT
    stopped_qc = arrived(node, 5)
    report.check("halt brakes to a stand", stopped_qc < position_qc + 2_000_000, f"{stopped_qc - position_qc} qc on")
    report.check("and the drive stays enabled", node.sdo[0x6041].raw & 0x6F == 0x27)
    node.state = "SWITCH ON DISABLED"
    node.state = "OPERATION ENABLED"
    report.check("a drive enabled anew stands", node.sdo[0x606C].raw == 0)
    command(node, 0, start_qc)
    report.check("back to the start", abs(arrived(node, 30) - start_qc) <= 1)


def profile_velocity(report, node):
    """To a speed, the other way round, halt, and to zero."""
    node.op_mode = "PROFILED VELOCITY"
    node.sdo[0x60FF].raw = 0
    node.sdo[0x6083].raw = node.sdo[0x6084].raw = 10_000
    node.state = "OPERATION ENABLED"
    for target_rpm in (-1200, 800):
        node.sdo[0x60FF].raw = target_rpm
        wait_for("velocity", 5, lambda: node.sdo[0x606C].raw == target_rpm)
        wait_for("target reached", 2, lambda: node.sdo[0x6041].raw & 0x0400)
        report.check(f"{target_rpm} rpm", not node.sdo[0x6041].raw & 0x1000)
    node.sdo[0x6040].raw = ENABLE | HALT
    wait_for("halt", 5, lambda: node.sdo[0x606C].raw == 0)
    report.check("halt stops the turning", node.sdo[0x6041].raw & 0x6F == 0x27)
    node.sdo[0x6040].raw = ENABLE
    wait_for("turning again", 5, lambda: node.sdo[0x606C].raw == 800)
    report.check("and lets it go on", True)
    node.sdo[0x60FF].raw = 0
    wait_for("speed 0", 5, lambda: node.sdo[0x6041].raw & 0x1400 == 0x1400)
    wait_for("standing", 2, lambda: node.sdo[0x606C].raw == 0)
    report.check("to a stand", True)


def cyclic_position(report, network, node):
    """Targets by PDO, one a SYNC."""
    node.state = "SWITCH ON DISABLED"
    node.nmt.state = "PRE-OPERATIONAL"
    node.sdo[0x60C2][1].raw = 10
    pdo = node.rpdo[3]
    pdo.enabled = True
    pdo.trans_type = 255
    pdo.save()
    node.nmt.state = "OPERATIONAL"
    node.op_mode = "CYCLIC SYNCHRONOUS POSITION"
    start_qc = node.sdo[0x6064].raw
    node.sdo[0x607A].raw = start_qc
    node.state = "OPERATION ENABLED"
    wait_for("following", 2, lambda: node.sdo[0x6041].raw & 0x1000)
    report.check("the drive follows the command", True)
    pdo["controlword"].raw = ENABLE
    for step in range(1, 101):
        pdo["target position"].raw = start_qc + 20 * step
        pdo.transmit()
        time.sleep(0.01)
    wait_for("the last target", 3, lambda: abs(node.sdo[0x6064].raw - start_qc - 2000) <= 1)
    report.check("a hundred targets are followed to the last", True)
    report.check("without an error", node.sdo[0x6041].raw & 0x6F == 0x27, hex(node.sdo[0x6041].raw))
    node.state = "SWITCH ON DISABLED"
    node.sdo[0x1402][1].raw |= PDO_OFF
    node.sdo[0x60C2][1].raw = 0
    node.op_mode = "PROFILED POSITION"


def homing(report, node, method, what, home_qc):
    """One method."""
    node.sdo[0x6098].raw = method
    node.sdo[0x6099][1].raw = 500
    node.sdo[0x6099][2].raw = 50
    node.sdo[0x30B0].raw = home_qc
    node.controlword = ENABLE  # the start bit of the last homing falls
    # A statusword from before the start, read late on a busy machine, is "interrupted" to this client. The drive goes on.
    homed = node.homing(timeout=30) or wait_for("homing attained", 30, lambda: node.sdo[0x6041].raw & 0x3400 == 0x1400)
    report.check(f"homing {method} of node {node.id} on {what}", homed, hex(node.sdo[0x6041].raw))
    report.check("the position is referenced", node.sdo[0x6041].raw & 0x8000)
    return node.sdo[0x6064].raw


def homings(report, rotation, feed):
    """Every kind of method that the mechanisms have something for."""
    for method, what, home_qc in ((17, "the negative limit switch", -QC_PER_MM), (1, "negative limit switch and index", -QC_PER_MM)):
        position_qc = homing(report, feed, method, what, home_qc)
        report.check(f"homing {method} gives the home position", abs(position_qc - home_qc) <= 1, position_qc)
    feed.sdo[0x3142][1].raw = 255  # the limit switch lies before the stop
    for method, what, home_qc in ((-4, "the negative stop by current", -2 * QC_PER_MM), (-2, "negative stop and index", -2 * QC_PER_MM)):
        position_qc = homing(report, feed, method, what, home_qc)
        report.check(f"homing {method} gives the home position", abs(position_qc - home_qc) <= 1, position_qc)
    homing(report, feed, -4, "the negative stop once more", -2 * QC_PER_MM)
    feed.op_mode = "PROFILED POSITION"
    command(feed, 0, 0)
    arrived(feed)
    feed.sdo[0x3142][1].raw = 0
    for method, what, home_qc in ((34, "the next index in positive direction", -100), (33, "the next index in negative direction", 55),
                                  (37, "the present position", 0)):
        position_qc = homing(report, rotation, method, what, home_qc)
        report.check(f"homing {method} gives the home position", abs(position_qc - home_qc) <= 1, position_qc)
    rotation.sdo[0x30B1].raw = 1000
    position_qc = homing(report, rotation, 34, "the index with a move away", 0)
    report.check("the move away ends at the home position", abs(position_qc - 0) <= 1, position_qc)
    rotation.sdo[0x30B1].raw = 0


def current_limit(report, node):
    """Onto the hard stop at 15 mm with little current and without a following error."""
    node.op_mode = "PROFILED POSITION"
    node.state = "OPERATION ENABLED"
    node.sdo[0x6081].raw = 3000
    command(node, 0, 14 * QC_PER_MM)
    arrived(node, 30)
    limit_ma = node.sdo[0x3001][2].raw
    node.sdo[0x3001][2].raw = 300
    node.sdo[0x6065].raw = 0xFFFFFFFF
    node.sdo[0x607A].raw = 16 * QC_PER_MM
    node.sdo[0x6040].raw = ENABLE | NEW_SETPOINT
    wait_for("stall", 15, lambda: node.sdo[0x6041].raw & 0x0800 and node.sdo[0x606C].raw == 0)
    current_ma, feed_mm = node.sdo[0x30D1][2].raw, node.sdo[0x6064].raw / QC_PER_MM
    report.check("the current limit stalls the drive", current_ma == 300 and abs(feed_mm - 15) < 0.01, f"{current_ma} mA at {feed_mm:.3f} mm")
    node.sdo[0x6040].raw = ENABLE
    command(node, AT_ONCE, 0)
    report.check("and it comes back", abs(arrived(node, 30)) <= 1)
    node.sdo[0x3001][2].raw = limit_ma
    node.sdo[0x6065].raw = 2000


def faults(report, node):
    """Following error, limit switch: emergency, register, history, acknowledgement."""
    node.sdo[0x1003][0].raw = 0
    node.op_mode = "PROFILED POSITION"
    node.state = "OPERATION ENABLED"
    node.emcy.reset()
    node.sdo[0x6081].raw = 3000
    node.sdo[0x607A].raw = 500_000
    node.sdo[0x6040].raw = ENABLE
    node.sdo[0x6040].raw = ENABLE | NEW_SETPOINT
    fault(report, node, 0x8611, 0x80, "a blocked axis")
    node.sdo[0x6040].raw = 0x0F
    report.check("a fault stays without a reset", node.sdo[0x6041].raw & 0x4F == 0x08)
    acknowledge(report, node, 0x8611)
    report.check("the history remembers", [node.sdo[0x1003][0].raw, node.sdo[0x1003][1].raw & 0xFFFF] == [1, 0x8611])
    node.op_mode = "PROFILED VELOCITY"
    node.sdo[0x60FF].raw = 0
    node.state = "OPERATION ENABLED"
    node.emcy.reset()
    node.sdo[0x60FF].raw = -3000
    fault(report, node, 0x8A80, 0x80, "the negative limit switch")
    wait_for("standing", 3, lambda: node.sdo[0x606C].raw == 0)
    report.check("the drive stands after a fault", True)
    node.sdo[0x60FF].raw = 0
    acknowledge(report, node, 0x8A80)
    history = [node.sdo[0x1003][place].raw & 0xFFFF for place in (1, 2)]
    report.check("newest first", history == [0x8A80, 0x8611], [hex(code) for code in history])
    node.reset_from_fault()
    node.state = "OPERATION ENABLED"
    node.sdo[0x60FF].raw = 1000
    wait_for("off the switch", 5, lambda: not node.sdo[0x60FD].raw & 1)
    node.sdo[0x60FF].raw = 0
    report.check("the way off the switch is free", node.sdo[0x6041].raw & 0x6F == 0x27)
    node.sdo[0x1003][0].raw = 0
    report.check("the history is cleared", node.sdo[0x1003][0].raw == 0)
    node.state = "SWITCH ON DISABLED"


def fault(report, node, code, register, why):
    """A fault that must come, with its emergency."""
    wait_for("fault", 20, lambda: node.sdo[0x6041].raw & 0x4F == 0x08)
    wait_for("emergency", 2, lambda: node.emcy.log)
    codes = [error.code for error in node.emcy.log]
    report.check(f"{why} is an emergency", codes == [code], [hex(code) for code in codes])
    report.check("with its register bit", node.emcy.log[0].register & register, hex(node.emcy.log[0].register))
    report.check("error code and register as objects", node.sdo[0x603F].raw == code and node.sdo[0x1001].raw & register)
    wait_for("the statusword of the next SYNC", 2, node.is_faulted)
    report.check("python canopen sees the fault", True)


def acknowledge(report, node, code):
    """The rising edge of the reset bit, and the emergency that tells that the error is gone."""
    node.sdo[0x6040].raw = 0x0000
    node.sdo[0x6040].raw = 0x0080
    wait_for("fault reset", 2, lambda: node.sdo[0x6041].raw & 0x4F == 0x40)
    wait_for("emergency reset", 2, lambda: [error.code for error in node.emcy.log] == [code, 0])
    report.check("fault reset on the edge", not node.emcy.active and node.sdo[0x1001].raw == 0)
    node.sdo[0x6040].raw = 0x0000

"""ur-rtde's DashboardClient and RTDEReceiveInterface against simulated UR5 controllers: `ur_rtde_clients.py HOST...`.

The dashboard powers each arm on and releases its brakes, as an operator would; the receive interface then watches it.
"""

import sys
import time

from dashboard_client import DashboardClient
from rtde_receive import RTDEReceiveInterface

ROBOT_MODE_RUNNING = 7
SAFETY_MODE_NORMAL = 1


def check(what, holds, value):
    print(f"{'PASS' if holds else 'FAIL'} {what}: {value}", flush=True)
    return holds


def until(condition, seconds):
    """Whether the condition came true within this time."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True


def dashboard(host):
    client = DashboardClient(host)
    client.connect()
    client.powerOn()
    powered = until(lambda: "IDLE" in client.robotmode(), 20)
    client.brakeRelease()
    released = until(lambda: "RUNNING" in client.robotmode(), 20)
    passed = [
        check("dashboard is connected", client.isConnected(), host),
        check("power on leads to IDLE", powered, client.robotmode()),
        check("brake release leads to RUNNING", released, client.robotmode()),
        check("safetymode", "NORMAL" in client.safetymode(), client.safetymode()),
        check("version", client.polyscopeVersion() != "", client.polyscopeVersion()),
        check("programState", "STOPPED" in client.programState(), client.programState()),
    ]
    client.disconnect()
    return all(passed)


def receive(host):
    arm = RTDEReceiveInterface(host)
    first = arm.getTimestamp()
    goes_on = until(lambda: arm.getTimestamp() - first >= 1.0, 10)
    q, pose = arm.getActualQ(), arm.getActualTCPPose()
    passed = [
        check("is connected", arm.isConnected(), host),
        check("the controller's clock goes on", goes_on, arm.getTimestamp() - first),
        check("six joint angles", len(q) == 6 and all(abs(angle) <= 6.3 for angle in q), q),
        check("tool pose within reach", len(pose) == 6 and sum(x * x for x in pose[:3]) < 1.5**2, pose),
        check("robot mode is RUNNING", arm.getRobotMode() == ROBOT_MODE_RUNNING, arm.getRobotMode()),
        check("safety mode is NORMAL", arm.getSafetyMode() == SAFETY_MODE_NORMAL, arm.getSafetyMode()),
        check("speed scaling", 0.0 <= arm.getSpeedScaling() <= 1.0, arm.getSpeedScaling()),
        check("nothing moves", max(abs(speed) for speed in arm.getActualQd()) < 1e-3, arm.getActualQd()),
    ]
    arm.disconnect()
    return all(passed)


def main():
    passed = [step(host) for host in sys.argv[1:] for step in (dashboard, receive)]
    return 0 if passed and all(passed) else 1


if __name__ == "__main__":
    sys.exit(main())

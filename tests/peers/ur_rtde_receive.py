"""ur-rtde's RTDEReceiveInterface and DashboardClient against simulated UR5 controllers: `ur_rtde_receive.py HOST...`."""

import sys
import time

from dashboard_client import DashboardClient
from rtde_receive import RTDEReceiveInterface

ROBOT_MODE_RUNNING = 7
SAFETY_MODE_NORMAL = 1


def check(what, holds, value):
    print(f"{'PASS' if holds else 'FAIL'} {what}: {value}")
    return holds


def receive(host):
    arm = RTDEReceiveInterface(host)
    first = arm.getTimestamp()
    deadline = time.monotonic() + 10
    while arm.getTimestamp() - first < 1.0 and time.monotonic() < deadline:
        time.sleep(0.01)
    later = arm.getTimestamp()
    q, pose = arm.getActualQ(), arm.getActualTCPPose()
    passed = [
        check("is connected", arm.isConnected(), host),
        check("the controller's clock goes on", later - first >= 1.0, later - first),
        check("six joint angles", len(q) == 6 and all(abs(angle) <= 6.3 for angle in q), q),
        check("tool pose within reach", len(pose) == 6 and sum(x * x for x in pose[:3]) < 1.5**2, pose),
        check("robot mode is RUNNING", arm.getRobotMode() == ROBOT_MODE_RUNNING, arm.getRobotMode()),
        check("safety mode is NORMAL", arm.getSafetyMode() == SAFETY_MODE_NORMAL, arm.getSafetyMode()),
        check("speed scaling", 0.0 <= arm.getSpeedScaling() <= 1.0, arm.getSpeedScaling()),
    ]
    arm.disconnect()
    return all(passed)


def dashboard(host):
    client = DashboardClient(host)
    client.connect()
    passed = [
        check("dashboard is connected", client.isConnected(), host),
        check("robotmode", "RUNNING" in client.robotmode(), client.robotmode()),
        check("safetymode", "NORMAL" in client.safetymode(), client.safetymode()),
        check("version", "URSoftware" in client.polyscopeVersion() or client.polyscopeVersion()[0].isdigit(), client.polyscopeVersion()),
        check("programState", client.programState() != "", client.programState()),
    ]
    client.disconnect()
    return all(passed)


def main():
    passed = [step(host) for host in sys.argv[1:] for step in (receive, dashboard)]
    return 0 if passed and all(passed) else 1


if __name__ == "__main__":
    sys.exit(main())

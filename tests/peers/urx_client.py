"""urx against one simulated controller: `urx_client.py HOST`. It reads the secondary interface and sends scripts there."""

import collections
import collections.abc
import sys

import ur5

# The math3d that urx was written for looks for a name that Python moved.
collections.Iterable = collections.abc.Iterable
import urx  # noqa: E402


def main():
    check = ur5.Checks("urx")
    robot = urx.Robot(sys.argv[1])
    try:
        home = robot.getj()
        check("six joints", len(home) == 6, home)
        pose = robot.getl()
        expected = ur5.forward("cb3", home)
        check.near("pose", pose[:3], [expected[row][3] for row in range(3)], 1e-6)
        goal = [home[0] + 0.2, *home[1:]]
        robot.movej(goal, acc=1.4, vel=1.0)
        check("movej", ur5.until(lambda: abs(robot.getj()[0] - goal[0]) < 2e-3, 5), robot.getj()[0] - goal[0])
        pose = robot.getl()
        robot.movel([*pose[:2], pose[2] + 0.05, *pose[3:]], acc=0.5, vel=0.2)
        check("movel", ur5.until(lambda: abs(robot.getl()[2] - pose[2] - 0.05) < 1e-3, 5), robot.getl()[2] - pose[2])
        robot.movej(home, acc=0.5, vel=0.3, wait=False)
        check("moves", ur5.until(lambda: abs(robot.getj()[0] - goal[0]) > 0.02, 5))
        robot.stopj(2.0)
        ur5.until(lambda: not robot.is_program_running(), 5)
        check("stop", abs(robot.getj()[0] - home[0]) > 0.02, robot.getj()[0] - home[0])
        robot.send_program("set_digital_out(2, True)")
        check("digital output", ur5.until(lambda: robot.get_digital_out(2) == 1, 5))
    finally:
        robot.close()
    return check.exit_code()


if __name__ == "__main__":
    sys.exit(main())

"""The manufacturer's own Python RTDE client against one simulated controller: `official_rtde.py HOST SERIES`.

Its package is not on PyPI: ARTHRO_RTDE_PYTHON names a folder that holds it.
"""

import os
import sys

import ur5

sys.path.insert(0, os.environ["ARTHRO_RTDE_PYTHON"])
from rtde import rtde  # noqa: E402


def main():
    host, series = sys.argv[1:3]
    check = ur5.Checks(f"official RTDE client {series}")
    client = rtde.RTDE(host, 30004)
    client.connect()
    version = client.get_controller_version()
    check("controller version", version[0] == {"cb3": 3, "e": 5}[series], version)
    names = ["timestamp", "actual_q", "actual_TCP_pose", "robot_mode", "safety_mode", "output_int_register_24"]
    check("outputs", client.send_output_setup(names, frequency=ur5.RATE_HZ[series]))
    inputs = client.send_input_setup(["input_int_register_24"], ["INT32"])
    check("inputs", inputs is not None)
    check("start", client.send_start())
    first = client.receive()
    for _ in range(100):
        state = client.receive()
    elapsed = state.timestamp - first.timestamp
    check("every cycle is sent", abs(elapsed - 100 / ur5.RATE_HZ[series]) < 0.5, elapsed)
    check("robot mode", state.robot_mode == 7 and state.safety_mode == 1, (state.robot_mode, state.safety_mode))
    expected = ur5.forward(series, state.actual_q)
    check.near("pose", ur5.flat(ur5.matrix(state.actual_TCP_pose)), ur5.flat(expected), 1e-6)
    inputs.input_int_register_24 = 42
    check("an input is sent", client.send(inputs))
    check("pause", client.send_pause())
    client.disconnect()
    return check.exit_code()


if __name__ == "__main__":
    sys.exit(main())

"""Foreign clients against the simulated cell: `run.py ARTHRO`.

Starts the simulator alone on free loopback addresses (a second master on the bus would hear the first one's answers), runs each
client as a process of its own, and ends the simulator.
"""

import json
import os
import pathlib
import subprocess
import sys
import time

HERE = pathlib.Path(__file__).parent
GRPCURL = pathlib.Path(sys.executable).parent / "grpcurl"


def arm_hosts():
    """Two loopback addresses that no other run of this script uses at this time."""
    number = os.getpid() % 60000
    return [f"127.{200 + number // 2500 % 50}.{number % 250}.{last}" for last in (11, 12)]


def simulator(arthro, hosts):
    """A running simulator, and what it says of itself."""
    command = [arthro, "serve", "simulator", "--listen", "127.0.0.1:0", "--until-stdin-closes"]
    for arm, host in zip(("forceps_arm", "arthroscope_arm"), hosts):
        command += ["--set", f'{arm}.bind="{host}"']
    command += ["--set", 'can_listen="127.0.0.1:0"']
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    address = json.loads(process.stdout.readline())["address"]
    described = subprocess.run(
        [GRPCURL, "-plaintext", address, "arthro.simulator.v1.RefereeService/GetCell"],
        check=True,
        capture_output=True,
        text=True,
    )
    return process, json.loads(described.stdout)


def main():
    hosts = arm_hosts()
    process, cell = simulator(sys.argv[1], hosts)
    try:
        can_host, can_port = cell["canAddress"].removeprefix("socketcand://").split("/")[0].split(":")
        clients = [
            ["ur_rtde_clients.py", *hosts],
            ["canopen_epos4.py", can_host, can_port],
        ]
        failed = 0
        for script, *arguments in clients:
            began = time.monotonic()
            code = subprocess.run([sys.executable, HERE / script, *arguments], timeout=300).returncode
            print(f"{script}: {'passed' if code == 0 else 'FAILED'} in {time.monotonic() - began:.1f} s", flush=True)
            failed += code != 0
        print(f"peers: {len(clients) - failed} passed, {failed} failed")
        return 1 if failed else 0
    finally:
        process.stdin.close()
        process.wait(timeout=30)


if __name__ == "__main__":
    sys.exit(main())

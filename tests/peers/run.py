"""Foreign clients against the simulated cell and against its controllers alone: `run.py ARTHRO ARTHRO_SIMULATOR`.

Starts the simulator alone on free loopback addresses (a second master on the bus would hear the first one's answers), runs each
client as a process of its own, and ends the simulator. Then the same for the drives alone, and for two arms at two addresses, as CB3 and as e-Series.

ARTHRO_RTDE_PYTHON (a folder with the manufacturer's Python package `rtde`) and ARTHRO_URCL (a folder with its
external_control.urscript) bring in what no package registry has; without them their clients are skipped, which is said.
"""

import contextlib
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

import ur5

HERE = pathlib.Path(__file__).parent
GRPCURL = pathlib.Path(sys.executable).parent / "grpcurl"


# A client that hangs has failed.
CLIENT_TIMEOUT_S = 150


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


def run(clients):
    """Runs clients side by side; how many failed."""
    began = time.monotonic()
    processes = [subprocess.Popen([sys.executable, HERE / script, *arguments]) for script, *arguments in clients]
    failed = 0
    for (script, *arguments), process in zip(clients, processes):
        try:
            code = process.wait(timeout=CLIENT_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            code = process.wait()
        took = time.monotonic() - began
        print(f"{script} {' '.join(arguments)}: {'passed' if code == 0 else 'FAILED'} in {took:.1f} s", flush=True)
        failed += code != 0
    return failed


@contextlib.contextmanager
def data_sheet(arthro):
    """The drives' electronic data sheet, in a file for as long."""
    with tempfile.TemporaryDirectory() as folder:
        path = f"{folder}/epos4.eds"
        subprocess.run([arthro, "can", "eds", "--out", path], check=True, stdout=subprocess.DEVNULL)
        yield path


def cell(arthro):
    """Clients of the whole cell: how many ran, and how many failed."""
    hosts = arm_hosts()
    process, described = simulator(arthro, hosts)
    try:
        with data_sheet(arthro) as sheet:
            clients = [["ur_rtde_clients.py", *hosts], ["canopen_epos4.py", described["canAddress"], sheet]]
            return len(clients), sum(run([client]) for client in clients)
    finally:
        process.stdin.close()
        process.wait(timeout=30)


def drives(arthro, arthro_simulator):
    """Clients of the drives alone: how many ran, and how many failed."""
    command = [arthro_simulator, "epos4", "--listen", "127.0.0.1:0", "--grpc", "127.0.0.1:0", "--until-stdin-closes"]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        address = json.loads(process.stdout.readline())["epos4"]["can"]
        with data_sheet(arthro) as sheet:
            return 1, run([["canopen_epos4.py", address, sheet]])
    finally:
        process.stdin.close()
        process.wait(timeout=30)


def recordings(arthro):
    """The reader of what the gateway records: how many ran, and how many failed."""
    return 1, run([["recording.py", arthro]])


def controllers(arthro_simulator, series):
    """Clients of two controllers: how many ran, and how many failed."""
    hosts = arm_hosts()
    with contextlib.ExitStack() as stack:
        for host in hosts:
            stack.enter_context(ur5.controller(arthro_simulator, host, series))
        rounds = [[["ur_rtde_control.py", host, series] for host in hosts]]
        if series == "cb3":
            rounds.append([["urx_client.py", hosts[0]]])
        for variable, script in (("ARTHRO_RTDE_PYTHON", "official_rtde.py"), ("ARTHRO_URCL", "external_control.py")):
            if os.environ.get(variable):
                rounds.append([[script, hosts[0], series]])
            else:
                print(f"{script} {series}: skipped, {variable} is not set", flush=True)
        return sum(map(len, rounds)), sum(map(run, rounds))


def main():
    arthro, arthro_simulator = sys.argv[1:3]
    counts = [cell(arthro), recordings(arthro), drives(arthro, arthro_simulator)] + [controllers(arthro_simulator, series) for series in ur5.DH]
    ran, failed = (sum(column) for column in zip(*counts))
    print(f"peers: {ran - failed} passed, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

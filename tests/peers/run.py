"""Foreign clients against the simulated cell: `run.py ARTHRO`.

Starts `arthro up` on free loopback addresses, runs each client as a process of its own, and ends the cell.
"""

import json
import pathlib
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).parent


def main():
    arthro = sys.argv[1]
    with tempfile.TemporaryDirectory() as state:
        cell = subprocess.Popen(
            [arthro, "up", "--json", "--free-ports", "--time-scale", "1", "--state", state],
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            at = json.loads(cell.stdout.readline())
            host, port = at["can"].removeprefix("socketcand://").split("/")[0].split(":")
            clients = [
                ["ur_rtde_receive.py", *at["arms"]],
                ["canopen_epos4.py", host, port],
            ]
            failed = 0
            for script, *arguments in clients:
                began = time.monotonic()
                code = subprocess.run([sys.executable, HERE / script, *arguments], timeout=300).returncode
                print(f"{script}: {'passed' if code == 0 else 'FAILED'} in {time.monotonic() - began:.1f} s")
                failed += code != 0
            print(f"peers: {len(clients) - failed} passed, {failed} failed")
            return 1 if failed else 0
        finally:
            cell.terminate()
            cell.wait(timeout=60)


if __name__ == "__main__":
    sys.exit(main())

"""Real SocketCAN on a machine without it: `run.py ARTHRO VCAN`, the second being the driver's tests (`tests/vcan.rs`).

Boots Debian's kernel in QEMU with a virtual and two emulated CAN interfaces, and runs `guest.py` in it on the programs of
this machine, which the guest sees read-only. Counts its PASS and FAIL lines and exits 1 unless all of its checks passed.
ARTHRO_VM=skip skips, for people whose machine is no Debian; then it says so.
"""

import os
import pathlib
import re
import sys
import time

from machine import Machine
from packages import Missing, ensure

HERE = pathlib.Path(__file__).resolve().parent
# A guest that hangs has failed. It takes less than a minute on an idle machine, and three on one that is busy elsewhere.
LIMIT_S = 400


def main():
    if os.environ.get("ARTHRO_VM") == "skip":
        print("vm: SKIPPED by ARTHRO_VM=skip; nothing ran on real SocketCAN")
        return 0
    arthro, vcan = (pathlib.Path(argument).resolve() for argument in sys.argv[1:3])
    peers = pathlib.Path(os.environ["ARTHRO_PEERS"]).resolve()
    folder = arthro.parent.parent / "vm"
    began = time.monotonic()
    try:
        root, kernel = ensure(folder)
    except Missing as missing:
        print(f"vm: cannot run: {missing}", file=sys.stderr)
        return 1
    fetched = time.monotonic()

    interpreter = (peers / "bin/python").resolve()
    shares = ["/usr", arthro.parent, peers, root, HERE.parent]
    if not interpreter.is_relative_to("/usr"):
        shares.append(interpreter.parent.parent)
    command = f"{peers}/bin/python {HERE}/guest.py {arthro.parent} {peers} {vcan}"

    passed, failed, stamps = [], [], {}

    with open(folder / "console.log", "w") as log:
        def on_line(line):
            log.write(line + "\n")
            word, _, rest = line.partition(" ")
            if word == "PASS":
                passed.append(rest)
            elif word == "FAIL":
                failed.append(rest)
            # The firmware leaves its cursor movements before the first line.
            elif stamp := re.search("guest (up|down)", line):
                stamps[stamp[1]] = time.monotonic()
            if word in ("PASS", "FAIL"):
                print(line, flush=True)

        powered_off = Machine(root, kernel, folder).run(shares, command, LIMIT_S, on_line)

    ended = time.monotonic()
    if not powered_off:
        failed.append(f"the guest did not power off within {LIMIT_S} s")
    if "all checks ran" in passed:
        passed.remove("all checks ran")
    elif not failed:
        failed.append("the guest did not run all of its checks")
    up, down = stamps.get("up", ended), stamps.get("down", ended)
    print(f"vm: {len(passed)} passed, {len(failed)} failed; packages {fetched - began:.1f} s, boot {up - fetched:.1f} s, "
          f"tests {down - up:.1f} s, in all {ended - fetched:.1f} s; console in {folder / 'console.log'}")
    for failure in failed:
        print(f"vm: FAILED {failure}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

"""Fetches strace from Debian into a folder, if the machine has none: `strace.py FOLDER`. Nothing is installed, and no root is needed."""

import pathlib
import shutil
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "vm"))

from packages import Apt, Missing, run, unpack  # noqa: E402

WRAPPER = """#!/bin/sh
LD_LIBRARY_PATH="{root}/usr/lib/x86_64-linux-gnu" exec "{root}/usr/bin/strace" "$@"
"""


def fetch(apt):
    # What the machine has already is not fetched again.
    run(["apt-get", *apt.options, "--yes", "--download-only", "--no-install-recommends", "--reinstall", "install", "strace"])


def main():
    folder = pathlib.Path(sys.argv[1]).resolve()
    shutil.rmtree(folder, ignore_errors=True)
    root = folder / "root"
    root.mkdir(parents=True)
    apt = Apt(folder)
    try:
        fetch(apt)
    except Missing:
        apt.update()
        fetch(apt)
    unpack(apt.packages, root)
    wrapper = folder / "bin/strace"
    wrapper.parent.mkdir()
    wrapper.write_text(WRAPPER.format(root=root))
    wrapper.chmod(0o755)


if __name__ == "__main__":
    main()

"""Fetches PostgreSQL's server from Debian into a folder, for a machine that has none: `tests/postgres.py FOLDER`.

Nothing is installed, and no root is needed. The tests start the server themselves; see gateway/server/tests/shared/postgres.rs.
"""

import pathlib
import shutil
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parent / "vm"))
import packages

PACKAGE = "postgresql"


def fetch(apt):
    # Installing would remove packages that stand in the way; fetching removes nothing.
    packages.run(["apt-get", *apt.options, "--yes", "--download-only", "--no-install-recommends", "install", PACKAGE])


def ensure(folder):
    """The folder is there only once everything in it is."""
    if folder.exists():
        return
    under_way = folder.with_name(folder.name + ".part")
    shutil.rmtree(under_way, ignore_errors=True)
    (under_way / "root").mkdir(parents=True)
    apt = packages.Apt(under_way)
    try:
        fetch(apt)
    except packages.Missing:
        apt.update()
        fetch(apt)
    packages.unpack(apt.packages, under_way / "root")
    if not any((under_way / "root/usr/lib/postgresql").glob("*/bin/postgres")):
        raise packages.Missing(f"Debian's package {PACKAGE} brought no server")
    (under_way / "root").rename(folder)
    shutil.rmtree(under_way)


if __name__ == "__main__":
    try:
        ensure(pathlib.Path(sys.argv[1]))
    except packages.Missing as missing:
        sys.exit(f"tests/postgres.py: {missing}")

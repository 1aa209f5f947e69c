"""Fetches a Linux kernel with CAN, QEMU and can-utils from Debian into a folder: nothing is installed, and no root is needed.

The kernel of a cloud machine or of a container's host often has no CAN, and a container cannot load modules. Debian's
`linux-image-amd64` has it (its `cloud` flavour has not). Packages are found by name through apt and unpacked; what is
installed already is taken from the system. What was unpacked once is used again.
"""

import json
import pathlib
import re
import shutil
import subprocess

# Fetched whether installed or not: the guest needs the files, not the installation.
FETCHED = ("busybox-static", "can-utils")
# Fetched with what they depend on, as far as it is not installed.
INSTALLABLE = ("qemu-system-x86", "iproute2")
# Of the kernel's 400 MB these are unpacked.
KERNEL_FILES = ("./boot/vmlinuz-*", "*/kernel/net/*", "*/kernel/drivers/net/can/*", "*/kernel/drivers/virtio/*", "*/kernel/fs/*")
APT_TIMEOUT_S = 300


class Missing(Exception):
    """What the machine lacks, for a person."""


def run(command, **options):
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=APT_TIMEOUT_S, **options)
    if done.returncode != 0:
        raise Missing(f"`{' '.join(map(str, command))}` failed:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done.stdout


class Apt:
    """apt with this machine's sources, writing below `folder` alone."""

    def __init__(self, folder):
        missing = [tool for tool in ("apt-get", "apt-cache", "dpkg-deb") if shutil.which(tool) is None]
        if missing:
            raise Missing(f"{', '.join(missing)} not found: the packages come from Debian, so this needs a Debian machine")
        self.folder, self.packages = folder, folder / "packages"
        (self.packages / "partial").mkdir(parents=True, exist_ok=True)
        # Nothing is installed, so nobody is in the way of it.
        self.options = ["-o", "Debug::NoLocking=1", "-o", f"Dir::Cache::archives={self.packages}", "-o", "APT::Sandbox::User="]

    def update(self):
        """Fetches lists of packages of our own: those of the machine are absent, or too old for the server."""
        (self.folder / "lists/partial").mkdir(parents=True, exist_ok=True)
        self.options += ["-o", f"Dir::State::lists={self.folder / 'lists'}", "-o", f"Dir::Cache={self.folder}"]
        run(["apt-get", *self.options, "update"])

    def kernel_package(self):
        """The package that `linux-image-amd64` stands for at present."""
        told = subprocess.run(["apt-cache", *self.options, "depends", "linux-image-amd64"], capture_output=True, text=True)
        found = re.search(r"Depends: (linux-image-\S+-amd64)\b", told.stdout)
        if found is None:
            raise Missing("apt knows no linux-image-amd64: this needs the package sources of Debian (amd64)")
        return found[1]

    def fetch(self):
        """The kernel's release, once all packages are there."""
        kernel = self.kernel_package()
        run(["apt-get", *self.options, "download", kernel, *FETCHED], cwd=self.packages)
        # Installing would remove packages that stand in the way; fetching removes nothing.
        run(["apt-get", *self.options, "--yes", "--download-only", "--no-install-recommends", "install", *INSTALLABLE])
        return kernel.removeprefix("linux-image-")


def unpack(packages, root):
    for package in sorted(packages.glob("*.deb")):
        if not package.name.startswith("linux-image-"):
            run(["dpkg-deb", "--extract", package, root])
            continue
        with subprocess.Popen(["dpkg-deb", "--fsys-tarfile", package], stdout=subprocess.PIPE) as contents:
            tar = ["tar", "--extract", "--directory", root, "--wildcards", *KERNEL_FILES]
            subprocess.run(tar, stdin=contents.stdout, check=True, timeout=APT_TIMEOUT_S)


def ensure(folder):
    """Where everything is unpacked below `folder`, and the kernel's release."""
    told = folder / "unpacked.json"
    wanted = {"packages": [*FETCHED, *INSTALLABLE], "kernel_files": [*KERNEL_FILES]}
    if told.exists():
        there = json.loads(told.read_text())
        if there["wanted"] == wanted:
            return folder / "root", there["kernel"]
        told.unlink()
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "root").mkdir(parents=True)
    apt = Apt(folder)
    try:
        kernel = apt.fetch()
    except Missing:
        apt.update()
        kernel = apt.fetch()
    unpack(apt.packages, folder / "root")
    shutil.rmtree(apt.packages)
    shutil.rmtree(folder / "lists", ignore_errors=True)
    told.write_text(json.dumps({"kernel": kernel, "wanted": wanted}))
    return folder / "root", kernel

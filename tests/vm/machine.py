"""A QEMU machine that boots a Debian kernel with CAN and two CAN controllers, sees chosen folders of this one read-only at
their own paths, and runs one command in them."""

import gzip
import os
import pathlib
import re
import shutil
import subprocess

# What the kernel does not have built in; what they depend on is found.
MODULES = ("virtio_pci", "9pnet_virtio", "9p", "can-raw", "can-bcm", "vcan", "kvaser_pci")
# Without what costs an emulated processor half of the boot: mitigations, self tests of ciphers, security modules.
KERNEL_ARGUMENTS = ("console=ttyS0 quiet panic=-1 mitigations=off nokaslr no_timer_check tsc=reliable random.trust_cpu=on audit=0 "
                    "cryptomgr.notests lsm=capability")
# The guest's clock counts its instructions, 4 ns each, so that a machine that is busy elsewhere makes the guest slow and
# not late: heartbeats and time limits hold. While the guest has nothing to do its clock is this machine's.
CLOCK = "shift=2"
MEMORY_MIB = 768

INIT = """#!/busybox sh
/busybox mkdir -p /proc /sys /dev /tmp /etc /run
/busybox mount -t proc proc /proc
/busybox mount -t sysfs sysfs /sys
/busybox mount -t devtmpfs devtmpfs /dev
for module in {modules}; do /busybox insmod /modules/$module.ko || echo "cannot load $module"; done
{mounts}
for name in bin sbin lib lib64; do /busybox ln -s usr/$name /$name; done
/busybox ip link set lo up
export PATH={path} LD_LIBRARY_PATH={libraries} HOME=/tmp PYTHONDONTWRITEBYTECODE=1
echo "guest up $(/busybox cut -d' ' -f1 /proc/uptime)"
{command}
echo "guest down $(/busybox cut -d' ' -f1 /proc/uptime)"
/busybox poweroff -f
"""


class Machine:
    """Assembled in `folder` from the packages unpacked in `root`."""

    def __init__(self, root, kernel, folder):
        self.root, self.kernel, self.folder = root, kernel, folder

    def program(self, name):
        """One of the packages' programs, or the system's."""
        for folder in ("bin", "usr/bin", "usr/sbin", "sbin"):
            if (self.root / folder / name).exists():
                return self.root / folder / name
        found = shutil.which(name)
        if found is None:
            raise FileNotFoundError(f"{name} is neither installed nor among the packages in {self.root}")
        return pathlib.Path(found)

    def modules(self):
        """Files of the modules in the order in which they load."""
        files = {file.stem.replace("-", "_"): file for file in (self.root / "lib/modules" / self.kernel).rglob("*.ko")}
        ordered = []

        def add(name):
            name = name.replace("-", "_")
            if name not in files:
                raise FileNotFoundError(f"the kernel {self.kernel} has no module {name}")
            if files[name] in ordered:
                return
            depends = re.search(rb"\0depends=([^\0]*)\0", files[name].read_bytes())
            for other in filter(None, (depends[1].decode() if depends else "").split(",")):
                add(other)
            ordered.append(files[name])

        for name in MODULES:
            add(name)
        return ordered

    def initial_ramdisk(self, shares, command):
        tree = self.folder / "ramdisk"
        shutil.rmtree(tree, ignore_errors=True)
        (tree / "modules").mkdir(parents=True)
        shutil.copy(self.program("busybox"), tree / "busybox")
        modules = self.modules()
        for module in modules:
            shutil.copy(module, tree / "modules")
        options = "trans=virtio,version=9p2000.L,msize=262144,ro,cache=loose"
        mounts = [f"/busybox mkdir -p {path} && /busybox mount -t 9p -o {options} share{i} {path}" for i, path in enumerate(shares)]
        folders = [self.root / "usr/bin", self.root / "usr/sbin", self.root / "sbin", "/usr/bin", "/usr/sbin"]
        libraries = [self.root / "usr/lib/x86_64-linux-gnu", self.root / "lib/x86_64-linux-gnu"]
        init = INIT.format(modules=" ".join(module.stem for module in modules), mounts="\n".join(mounts), command=command,
                           path=":".join(map(str, folders)), libraries=":".join(map(str, libraries)))
        (tree / "init").write_text(init)
        (tree / "init").chmod(0o755)
        names = "\n".join(["."] + sorted(str(file.relative_to(tree)) for file in tree.rglob("*")))
        packed = subprocess.run([tree / "busybox", "cpio", "-o", "-H", "newc"], input=names.encode(), cwd=tree, capture_output=True, check=True)
        ramdisk = self.folder / "ramdisk.gz"
        ramdisk.write_bytes(gzip.compress(packed.stdout, 1))
        return ramdisk

    def run(self, shares, command, limit_s, on_line):
        """Boots, runs the shell command, powers off. Every line of the console goes to `on_line`. False when it took too long."""
        libraries = f"{self.root}/usr/lib/x86_64-linux-gnu:{self.root}/lib/x86_64-linux-gnu"
        qemu = [self.program("qemu-system-x86_64"), "-M", "pc,accel=tcg", "-cpu", "max", "-icount", CLOCK, "-m", MEMORY_MIB,
                "-L", self.root / "usr/share/qemu", "-L", self.root / "usr/share/seabios",
                "-nographic", "-nodefaults", "-no-reboot", "-serial", "stdio",
                "-kernel", self.root / f"boot/vmlinuz-{self.kernel}", "-initrd", self.initial_ramdisk(shares, command),
                "-append", KERNEL_ARGUMENTS,
                "-object", "can-bus,id=wire", "-device", "kvaser_pci,canbus=wire", "-device", "kvaser_pci,canbus=wire"]
        for i, path in enumerate(shares):
            share = f"local,id=fs{i},path={path},security_model=none,readonly=on,multidevs=remap"
            qemu += ["-fsdev", share, "-device", f"virtio-9p-pci,fsdev=fs{i},mount_tag=share{i}"]
        process = subprocess.Popen(["timeout", "--kill-after=5", str(limit_s), *map(str, qemu)], stdin=subprocess.DEVNULL,
                                   stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
                                   env={**os.environ, "LD_LIBRARY_PATH": libraries})
        with process:
            for line in process.stdout:
                on_line(line.rstrip())
        return process.returncode == 0

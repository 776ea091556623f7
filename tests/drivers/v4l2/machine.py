"""Runs a module of this checkout beside vivid: the kernel of this host, or an emulated
machine.

The host's files are the machine's root, read-only; there is no disk image and nothing
runs as root here. Its clock counts instructions, a nanosecond each, and skips idle
time: a busy host makes it slow and changes nothing that it measures. KVM is not used
where it exists: it may not run a stock kernel.
"""

import lzma
import os
import re
import shlex
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.drivers.v4l2.vivid.device import DRIVER

WANTED = ("virtio_pci", "9pnet_virtio", "9p", "vivid")
FOLDER = "CELL_KERNEL"
DIRECTORY, PROGRAM, DEVICE, MODULE = 0o040755, 0o100755, 0o020600, 0o100644
CHECKOUT = Path(__file__).parents[3]
BEGIN, END = "the machine begins", "the machine ends with"
# a camera, with HDMI as its second input, and an HDMI output plugged into that
VIVID = (
    "n_devs=1 node_types=0x101 num_inputs=2 input_types=0xc num_outputs=1"
    " output_types=0x1"
)
PACKAGES = "qemu-system-x86 busybox-static"

SCRIPT = """#!/bin/busybox sh
b=/bin/busybox
$b mkdir -p /proc && $b mount -t proc proc /proc
for m in /m/*.ko; do $b insmod $m $($b test $m = {last} && echo {options}); done
$b mount -t 9p -o ro,trans=virtio,version=9p2000.L,msize=524288,cache=loose host /root
$b mount -t devtmpfs dev /root/dev && $b mount -t devtmpfs dev /dev
$b mount -t proc proc /root/proc
$b mount -t sysfs sys /root/sys
$b mount -t tmpfs tmp /root/run
$b chmod 1777 /root/run
exec > /dev/ttyS1 2>&1
echo {begin}
$b chroot /root /bin/sh -c {command}
echo {end} $?
$b poweroff -f
"""
REQUIRED = "CELL_REQUIRE_DEVICES"  # 1: what is missing is a failure, as in CI


@dataclass(frozen=True, slots=True)
class KernelFiles:
    """Image and module folder of one kernel release."""

    image: Path
    modules: Path


def find_kernel() -> KernelFiles | None:
    """The newest kernel with vivid: where CELL_KERNEL points, in the cache, or of this
    host.
    """
    for root in (unpacked(), Path("/")):
        for vivid in sorted(
            root.glob("lib/modules/*/kernel/drivers/media/**/vivid.ko*")
        ):
            modules = next(p for p in vivid.parents if p.parent.name == "modules")
            image = root / "boot" / f"vmlinuz-{modules.name}"
            if os.access(image, os.R_OK):
                return KernelFiles(image, modules)
    return None


def unpacked() -> Path:
    """Where a downloaded kernel package is unpacked."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return Path(os.environ.get(FOLDER) or cache / "folding-cell" / "kernel")


def module_order(modules: Path) -> list[Path]:
    """Files of the wanted modules and all they need, each after what it needs."""
    by_name = {_name(path): path for path in modules.rglob("*.ko*")}
    order: list[Path] = []

    def add(name: str) -> None:
        path = by_name.get(name)
        if path is None or path in order:
            return  # built in, or already there
        for needed in _needs(read_module(path)):
            add(needed)
        order.append(path)

    for name in WANTED:
        add(name)
    return order


def read_module(path: Path) -> bytes:
    """A module's ELF, unpacked."""
    content = path.read_bytes()
    return lzma.decompress(content) if path.suffix == ".xz" else content


def initial_file_system(busybox: Path, modules: list[Path], script: str) -> bytes:
    """A cpio archive with busybox, the modules as /m/NN.ko in order, and `script` as
    /init.
    """
    entries = [(name, DIRECTORY, b"", 0) for name in ("bin", "m", "dev", "root")]
    entries.append(("dev/console", DEVICE, b"", 5 << 8 | 1))
    entries.append(("bin/busybox", PROGRAM, busybox.read_bytes(), 0))
    entries.append(("init", PROGRAM, script.encode(), 0))
    for number, path in enumerate(modules):
        entries.append((f"m/{number:02}.ko", MODULE, read_module(path), 0))
    entries.append(("TRAILER!!!", 0, b"", 0))
    return b"".join(_entry(number, *entry) for number, entry in enumerate(entries, 1))


def _entry(number: int, name: str, mode: int, content: bytes, device: int) -> bytes:
    fields = [number, mode, 0, 0, 1, 0, len(content), 0, 0, device >> 8, device & 0xFF]
    fields += [len(name) + 1, 0]
    head = (
        b"070701"
        + b"".join(b"%08X" % field for field in fields)
        + name.encode()
        + b"\0"
    )
    return _padded(head) + _padded(content)


def _padded(content: bytes) -> bytes:
    return content + b"\0" * (-len(content) % 4)


def _name(path: Path) -> str:
    return path.name.partition(".")[0].replace("-", "_")


def _needs(module: bytes) -> list[str]:
    found = re.search(rb"\0depends=([^\0]*)\0", b"\0" + module)
    names = found[1].decode().split(",") if found else []
    return [name.replace("-", "_") for name in names if name]


@dataclass(frozen=True, slots=True)
class Machine:
    """What is needed to boot: the emulator, a static busybox, a kernel with vivid."""

    emulator: str
    busybox: str
    kernel: KernelFiles

    def run(
        self, folder: Path, command: Sequence[str], *, seconds: float
    ) -> Iterator[str]:
        """Boot, and give each line that `command` writes; raises OSError when there is
        no boot.

        The boot files are made in `folder`. The command may write to /run alone. After
        `seconds` the machine is switched off.
        """
        files = folder / "initrd"
        modules = module_order(self.kernel.modules)
        files.write_bytes(
            initial_file_system(
                Path(self.busybox), modules, _script(command, len(modules))
            )
        )
        asked = [
            self.emulator,
            *_hardware(folder / "console"),
            "-kernel",
            self.kernel.image,
            "-initrd",
            files,
        ]
        asked += ["-append", "console=ttyS0 quiet panic=-1 mitigations=off"]
        with subprocess.Popen(
            asked,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        ) as machine:
            watchdog = threading.Timer(seconds, machine.kill)
            watchdog.start()
            try:
                yield from _inside(machine, folder)
            finally:
                watchdog.cancel()
                machine.kill()


def _inside(machine: subprocess.Popen[bytes], folder: Path) -> Iterator[str]:
    """Lines of the command; the machine's own come on its console."""
    assert machine.stdout is not None
    lines = (line.decode(errors="replace").rstrip() for line in machine.stdout)
    if not any(BEGIN in line for line in lines):
        console = (folder / "console").read_text(errors="replace")
        raise OSError(f"the machine did not start: {console[-500:]}")
    for line in lines:
        if line.startswith(END):
            return
        yield line


def find_machine() -> Machine | str:
    """What boots here, or a line that says what to install."""
    emulator, busybox = shutil.which("qemu-system-x86_64"), shutil.which("busybox")
    kernel = find_kernel()
    if emulator is None or busybox is None:
        return (
            "no emulator: run .ci/devices, or apt-get install --no-install-recommends"
            f" {PACKAGES}"
        )
    if kernel is None:
        return (
            "no kernel with vivid: run .ci/devices, or download the package that"
            " linux-image-amd64 depends on and unpack it with `dpkg-deb -x FILE.deb"
            f" {unpacked()}`"
        )
    return Machine(emulator, busybox, kernel)


def _hardware(console: Path) -> list[str]:
    share = "local,id=host,path=/,security_model=none,readonly=on,multidevs=remap"
    return [
        *("-machine", "pc,accel=tcg", "-cpu", "max", "-m", "3072"),
        *("-icount", "shift=0,sleep=off"),
        *("-nodefaults", "-no-reboot", "-nographic", "-serial", f"file:{console}"),
        *("-serial", "stdio"),
        *("-fsdev", share, "-device", "virtio-9p-pci,fsdev=host,mount_tag=host"),
    ]


def _script(command: Sequence[str], modules: int) -> str:
    inside = f"cd {shlex.quote(str(CHECKOUT))} && export HOME=/run TMPDIR=/run"
    inside += (
        " PYTHONDONTWRITEBYTECODE=1 OPENBLAS_NUM_THREADS=1 && exec"
        f" {shlex.join(command)}"
    )
    return SCRIPT.format(
        last=f"/m/{modules - 1:02}.ko",
        options=VIVID,
        begin=BEGIN,
        end=END,
        command=shlex.quote(inside),
    )


def beside_vivid(
    folder: Path, module: str, *arguments: str, seconds: float
) -> Iterator[str]:
    """Lines that `module` writes, called with `arguments`; the test is skipped, or fails, where vivid cannot be
    had.

    The host's own vivid is used where it is loaded and may be unbound; `folder` is for
    the boot.
    """
    command = [sys.executable, "-m", module, *arguments]
    if os.access(DRIVER / "unbind", os.W_OK):
        done = subprocess.run(
            command,
            cwd=CHECKOUT,
            stdout=subprocess.PIPE,
            text=True,
            timeout=seconds,
            check=False,
        )
        yield from done.stdout.splitlines()
        return
    machine = find_machine()
    if isinstance(machine, str):
        if os.environ.get(REQUIRED) == "1":
            pytest.fail(machine)
        pytest.skip(machine)
    yield from machine.run(folder, command, seconds=seconds)

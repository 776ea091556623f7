"""An emulated machine that runs a command of this checkout beside the kernel's vivid driver.

The host's files are its root, read-only; there is no disk image and nothing runs as root here.
Its clock counts instructions, a nanosecond each, and skips idle time: a busy host makes it slow and
changes nothing that it measures. KVM is not used where it exists: it may not run a stock kernel.
"""

import shlex
import shutil
import subprocess
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.drivers.camera.kernel_files import (
    KernelFiles,
    find_kernel,
    initial_file_system,
    module_order,
    uncompressed,
    unpacked,
)

CHECKOUT = Path(__file__).parents[3]
BEGIN, END = "the machine begins", "the machine ends with"
VIVID = "n_devs=1 node_types=0x1 num_inputs=2 input_types=0xc"
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


@dataclass(frozen=True, slots=True)
class Machine:
    """What is needed to boot: the emulator, a static busybox, a kernel with vivid."""

    emulator: str
    busybox: str
    kernel: KernelFiles

    def run(
        self, folder: Path, command: Sequence[str], *, seconds: float, processor: str = "Nehalem"
    ) -> Iterator[str]:
        """Boot, and give each line that `command` writes; raises OSError when there is no boot.

        The boot files are made in `folder`. The command may write to /run alone. After `seconds`
        the machine is switched off.
        """
        image, files = folder / "vmlinux", folder / "initrd"
        if not image.exists():
            image.write_bytes(uncompressed(self.kernel.image.read_bytes()))
        modules = module_order(self.kernel.modules)
        files.write_bytes(
            initial_file_system(Path(self.busybox), modules, _script(command, len(modules)))
        )
        asked = [
            self.emulator,
            *_hardware(processor, folder / "console"),
            "-kernel",
            image,
            "-initrd",
            files,
        ]
        asked += ["-append", "console=ttyS0 quiet panic=-1 mitigations=off"]
        with subprocess.Popen(
            asked, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
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
            f"no emulator: run .ci/devices, or apt-get install --no-install-recommends {PACKAGES}"
        )
    if kernel is None:
        return (
            "no kernel with vivid: run .ci/devices, or download the package that "
            f"linux-image-amd64 depends on and unpack it with `dpkg-deb -x FILE.deb {unpacked()}`"
        )
    return Machine(emulator, busybox, kernel)


def _hardware(processor: str, console: Path) -> list[str]:
    share = "local,id=host,path=/,security_model=none,readonly=on,multidevs=remap"
    return [
        *("-machine", "pc,accel=tcg", "-cpu", processor, "-m", "1536"),
        *("-icount", "shift=0,sleep=off"),
        *("-nodefaults", "-no-reboot", "-nographic", "-serial", f"file:{console}"),
        *("-serial", "stdio"),
        *("-fsdev", share, "-device", "virtio-9p-pci,fsdev=host,mount_tag=host"),
    ]


def _script(command: Sequence[str], modules: int) -> str:
    inside = f"cd {shlex.quote(str(CHECKOUT))} && export HOME=/run TMPDIR=/run"
    inside += f" PYTHONDONTWRITEBYTECODE=1 OPENBLAS_NUM_THREADS=1 && exec {shlex.join(command)}"
    return SCRIPT.format(
        last=f"/m/{modules - 1:02}.ko",
        options=VIVID,
        begin=BEGIN,
        end=END,
        command=shlex.quote(inside),
    )

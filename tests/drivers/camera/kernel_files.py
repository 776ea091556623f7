"""A stock kernel with vivid, unpacked on disk: its image, its modules, its initial file system."""

import lzma
import os
import re
import struct
from dataclasses import dataclass
from pathlib import Path

WANTED = ("virtio_pci", "9pnet_virtio", "9p", "vivid")
FOLDER = "CELL_KERNEL"
SETUP_SECTORS, PAYLOAD_OFFSET, PAYLOAD_LENGTH = 0x1F1, 0x248, 0x24C
SECTOR = 512
DIRECTORY, SCRIPT, DEVICE, MODULE = 0o040755, 0o100755, 0o020600, 0o100644


@dataclass(frozen=True, slots=True)
class KernelFiles:
    """Image and module folder of one kernel release."""

    image: Path
    modules: Path


def find_kernel() -> KernelFiles | None:
    """The newest kernel with vivid: where CELL_KERNEL points, in the cache, or of this host."""
    for root in (unpacked(), Path("/")):
        for vivid in sorted(root.glob("lib/modules/*/kernel/drivers/media/**/vivid.ko*")):
            modules = next(p for p in vivid.parents if p.parent.name == "modules")
            image = root / "boot" / f"vmlinuz-{modules.name}"
            if os.access(image, os.R_OK):
                return KernelFiles(image, modules)
    return None


def unpacked() -> Path:
    """Where a downloaded kernel package is unpacked."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return Path(os.environ.get(FOLDER) or cache / "folding-cell" / "kernel")


def uncompressed(image: bytes) -> bytes:
    """The ELF inside a bzImage packed with xz, which boots five times faster; else the image."""
    start = (image[SETUP_SECTORS] + 1) * SECTOR + struct.unpack_from("<I", image, PAYLOAD_OFFSET)[0]
    length = struct.unpack_from("<I", image, PAYLOAD_LENGTH)[0]
    payload = image[start : start + length]
    return lzma.decompress(payload[:-4]) if payload.startswith(b"\xfd7zXZ") else image


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
    """A cpio archive with busybox, the modules as /m/NN.ko in order, and `script` as /init."""
    entries = [(name, DIRECTORY, b"", 0) for name in ("bin", "m", "dev", "root")]
    entries.append(("dev/console", DEVICE, b"", 5 << 8 | 1))
    entries.append(("bin/busybox", SCRIPT, busybox.read_bytes(), 0))
    entries.append(("init", SCRIPT, script.encode(), 0))
    for number, path in enumerate(modules):
        entries.append((f"m/{number:02}.ko", MODULE, read_module(path), 0))
    entries.append(("TRAILER!!!", 0, b"", 0))
    return b"".join(_entry(number, *entry) for number, entry in enumerate(entries, 1))


def _entry(number: int, name: str, mode: int, content: bytes, device: int) -> bytes:
    fields = [number, mode, 0, 0, 1, 0, len(content), 0, 0, device >> 8, device & 0xFF]
    fields += [len(name) + 1, 0]
    head = b"070701" + b"".join(b"%08X" % field for field in fields) + name.encode() + b"\0"
    return _padded(head) + _padded(content)


def _padded(content: bytes) -> bytes:
    return content + b"\0" * (-len(content) % 4)


def _name(path: Path) -> str:
    return path.name.partition(".")[0].replace("-", "_")


def _needs(module: bytes) -> list[str]:
    found = re.search(rb"\0depends=([^\0]*)\0", b"\0" + module)
    names = found[1].decode().split(",") if found else []
    return [name.replace("-", "_") for name in names if name]

"""Writing of files: atomically and without following links; locks on folders."""

import errno
import fcntl
import os
import shutil
import stat
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from io import FileIO
from pathlib import Path

from drivers.base.errors import ConfigurationError
from drivers.base.readers import read_text

LOCK_TIMEOUT = 10.0  # s for another command to finish
POLL_INTERVAL = 0.02  # s between attempts to lock


@contextmanager
def replacing(path: Path, check: Callable[[], None] = lambda: None) -> Iterator[Path]:
    """Context with a new, empty file that replaces the file at `path` once the block
    succeeds.

    For a writer that needs a file name. `check` is called right before; what it raises
    leaves the old file. Readers see the old file or the new one; a link
    at `path` is replaced, not followed. Raises OSError where that is not possible.
    """
    scratch = path.with_name(_scratch_name())
    new_file(scratch).close()
    try:
        yield scratch
        with scratch.open("rb") as written:
            os.fsync(written.fileno())
        check()
        scratch.replace(path)
    finally:  # no scratch file stays behind
        scratch.unlink(missing_ok=True)
    sync_folder(path.parent)


def replace_file(
    path: Path, content: bytes, check: Callable[[], None] = lambda: None
) -> None:
    """Replace the file at `path` by `content` atomically, after a `check`, and flush it
    to disk.
    """
    with replacing(path, check) as scratch, scratch.open("wb") as file:
        file.write(content)


def write_file(path: Path, content: str | bytes, remedy: str = "") -> None:
    """Replace the file at `path` by `content`, text as UTF-8; a missing folder is
    created.

    Raises ConfigurationError, in one line with a `remedy`, where it cannot be written.
    """
    with writing(path, remedy):
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(path, encoded(content))


def encoded(content: str | bytes) -> bytes:
    """`content` as it is written: text as UTF-8, what that cannot encode escaped."""
    if isinstance(content, bytes):
        return content
    return content.encode(errors="backslashreplace")


def change_file(path: Path, change: Callable[[str], str], remedy: str = "") -> None:
    """Replace the text of the file at `path` by `change(text)`; a missing file has text
    "".

    The folder is locked from reading to writing, so that no command undoes another's
    change. Raises ConfigurationError where the file cannot be read or written, and then
    leaves it unchanged.
    """
    with writing(path, remedy):
        path.parent.mkdir(parents=True, exist_ok=True)
        with lock_folders([path.parent]):
            text = read_text(path) if path.exists() else ""
            replace_file(path, encoded(change(text)))


@contextmanager
def scratch_folder(parent: Path) -> Iterator[Path]:
    """Context with a new, hidden folder in `parent`, which is removed with its content
    at the end.

    A `parent` that did not exist before is removed too if it is empty.
    """
    parent_is_new = not os.path.lexists(parent)
    with writing(parent):
        parent.mkdir(parents=True, exist_ok=True)
        scratch = parent / _scratch_name()
        scratch.mkdir()
    try:
        yield scratch
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
        if parent_is_new:
            with suppress(OSError):
                parent.rmdir()


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """Context with an empty folder that becomes the new folder `path` once the block
    succeeds.

    An error in the block leaves nothing behind. Raises ConfigurationError where
    something exists at `path`, before the block or after it.
    """
    check_free(path)
    with scratch_folder(path.parent) as scratch:
        new = scratch / path.name
        with writing(path):
            new.mkdir()
            yield new
        move_folder(new, path)


def move_folder(source: Path, path: Path) -> None:
    """Move the folder `source` to `path`; ConfigurationError where something exists
    there.
    """
    check_free(path)
    with writing(path):
        try:
            source.rename(path)  # which replaces an empty folder at most
        except OSError:
            check_free(path)
            raise
        sync_folder(path.parent)


def check_free(path: Path) -> None:
    """Raise ConfigurationError where something exists at `path`, a broken link
    included.
    """
    if os.path.lexists(path):
        raise ConfigurationError(
            f"{path}: is there already; move it away, or name another --out"
        )


@contextmanager
def writing(place: Path | str, remedy: str = "") -> Iterator[None]:
    """Context that turns an OSError into a one-line ConfigurationError: `place` is not
    writable.
    """
    try:
        yield
    except OSError as error:
        text = f"{place}: cannot be written: {error.strerror or error}"
        raise ConfigurationError(f"{text}; {remedy}" if remedy else text) from None


def new_file(path: Path) -> FileIO:
    """Create a file at `path` for unbuffered writing; OSError where something exists
    there.
    """
    return path.open("xb", buffering=0)


def check_writable(path: Path) -> None:
    """Ensure that a regular file is at `path`, created if missing; OSError for a link
    or a pipe.
    """
    os.close(_open_to_write(path, os.O_WRONLY))


def append_line(path: Path, line: bytes) -> None:
    """Append `line` to the regular file at `path` and flush it to disk.

    Raises OSError for a link or a pipe, and where the line does not fit: it is then
    removed.
    """
    with open(
        _open_to_write(path, os.O_WRONLY | os.O_APPEND), "wb", buffering=0
    ) as file:
        end = os.fstat(file.fileno()).st_size
        try:
            write_all(file, line)
            os.fsync(file.fileno())
        except OSError:
            os.ftruncate(file.fileno(), end)
            raise


def write_all(file: FileIO, content: bytes | memoryview) -> None:
    """Write all of `content` to `file`, repeating partial writes; OSError where that
    fails.
    """
    remainder = memoryview(content)
    while remainder:
        remainder = remainder[file.write(remainder) or 0 :]


def sync_folder(folder: Path) -> None:
    """Flush the directory entries of `folder` to disk."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextmanager
def lock_folders(folders: Iterable[Path]) -> Iterator[None]:
    """Context that locks `folders` against other commands while their files are
    changed.

    The lock leaves no file, and ends with the process. Raises ConfigurationError where
    another command holds it for longer than LOCK_TIMEOUT, or a folder cannot be read.
    """
    with ExitStack() as locks:
        # in one order for all
        for folder in sorted({folder.resolve() for folder in folders}):
            try:
                handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
            except OSError as error:
                raise ConfigurationError(
                    f"{folder}: cannot be read: {error.strerror}"
                ) from None
            locks.callback(os.close, handle)
            _lock(handle, folder)
        yield


def _lock(handle: int, folder: Path) -> None:
    """Lock `folder` by its open `handle`; ConfigurationError after LOCK_TIMEOUT."""
    until = time.monotonic() + LOCK_TIMEOUT
    while True:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        except BlockingIOError:
            if time.monotonic() > until:
                raise ConfigurationError(
                    f"{folder}: another command has been changing files here for"
                    f" {LOCK_TIMEOUT:g} s; let it finish"
                ) from None
            time.sleep(POLL_INTERVAL)


def _open_to_write(path: Path, flags: int) -> int:
    """Descriptor of the regular file at `path`, created if missing; OSError for
    anything else.
    """
    flags |= os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC
    handle = os.open(path, flags, 0o666)
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise OSError(errno.EINVAL, "is not a regular file", str(path))
    return handle


def _scratch_name() -> str:
    return f".{os.urandom(6).hex()}.part"

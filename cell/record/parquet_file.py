"""Reading of Parquet tables: complete, of a known schema, of bounded size."""

from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from drivers.errors import ConfigurationError
from drivers.files import MEGABYTE, read_bytes
from drivers.settings import SCHEMA

PACKED, UNPACKED = 64 * MEGABYTE, 256 * MEGABYTE  # a fold's profile is below one
MOST_ROWS = 1_000_000


class NotWhole(Exception):
    """Raised for bytes that are no Parquet file, or declare more than memory should hold."""


def read_parquet(
    path: Path,
    missing: str = "is missing",
    broken: str = "is not a whole Parquet file",
    newer: str = "; update the cell",
) -> pa.Table:
    """Read a Parquet table; ConfigurationError when it is missing, broken or of a newer schema.

    `missing`, `broken` and `newer` are the messages of that error.
    """
    if not path.exists():
        raise ConfigurationError(f"{path}: {missing}")
    if path.is_dir():
        raise ConfigurationError(f"{path}: {broken}: is a folder")
    content = read_bytes(path, PACKED)
    try:
        table = _table(content)
    except (NotWhole, pa.ArrowException, OSError, ValueError) as error:
        reason = (str(error).splitlines() or ["no reason given"])[0]
        raise ConfigurationError(f"{path}: {broken}: {reason}") from None
    schema = (table.schema.metadata or {}).get(b"schema", b"1")
    if not _is_known(schema):
        raise ConfigurationError(
            f"{path}: schema: is {schema.decode(errors='replace')}, this version reads "
            f"{SCHEMA}{newer}"
        )
    return table


def _table(content: bytes) -> pa.Table:
    file = pq.ParquetFile(pa.BufferReader(content))
    stated: Any = file.metadata
    unpacked = sum(stated.row_group(i).total_byte_size for i in range(stated.num_row_groups))
    if stated.num_rows > MOST_ROWS or unpacked > UNPACKED:
        raise NotWhole(
            f"it states {stated.num_rows} rows and {unpacked / MEGABYTE:.0f} MB, at most "
            f"{MOST_ROWS} and {UNPACKED // MEGABYTE} MB are read"
        )
    table = file.read(use_threads=False)
    table.validate(full=True)
    _ = table.schema.names  # raises ValueError where they are no text
    return table


def _is_known(schema: bytes) -> bool:
    return schema.isdigit() and len(schema) < 9 and 0 < int(schema) <= SCHEMA

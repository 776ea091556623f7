"""Checkpoint files of the critic: arrays, correction and origin, read without
pickles.
"""

import json
import zipfile
from io import BytesIO
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from drivers.base.errors import ConfigurationError
from drivers.base.files import replace_file, writing
from drivers.base.readers import LARGEST_UNPACKED, MEGABYTE, read_bytes
from drivers.base.types import Array
from policies.adaptive.critic import (
    ARRAY_NAMES,
    Critic,
    CriticBias,
    Untrained,
    array_shapes,
)
from policies.adaptive.features import COUNT

COMMITTED = FilePath(__file__).parents[1] / "weights" / "adaptive.npz"
# key of the origin: the correction, and how it was fitted
THROUGH_IMAGES = "through_images"
ABOUT = "about"  # array of JSON: schema, policy, how the weights were trained
LARGEST_FILE = 50_000_000  # bytes, above which a file is not opened
SCHEMA = 1


def load_critic(path: FilePath | None = None) -> Critic:
    """Read the critic in the checkpoint at `path`, or in the committed one.

    Raises ConfigurationError for a file that is missing, broken, or of another policy.
    """
    return Critic(_read_weights(path or COMMITTED))


def about(path: FilePath | None = None) -> dict[str, Any]:
    """Origin of the critic in the checkpoint at `path`: settings and results of its
    training.
    """
    return _read_facts(_read_arrays(path or COMMITTED), path or COMMITTED)


def load_bias(path: FilePath | None = None) -> CriticBias:
    """Read the critic's correction in the checkpoint at `path`, or in the committed
    one.

    A checkpoint without folds through images has no correction, which reads as no bias.
    The spread `untrained` is that of this version's data file. Raises
    ConfigurationError for a file that is missing, broken, or of another policy.
    """
    checkpoint = path or COMMITTED
    found = about(checkpoint).get(THROUGH_IMAGES)
    if found is None:
        return CriticBias()
    try:
        bias = CriticBias.model_validate(found["transfer"]["bias"])
    except (ValueError, KeyError, TypeError):
        raise _broken(checkpoint, f"{THROUGH_IMAGES} holds no transfer") from None
    return bias.model_copy(update={"untrained": Untrained.shipped().added})


def save_critic(path: FilePath, critic: Critic, facts: dict[str, Any]) -> None:
    """Write `critic` and `facts` about its training to `path`; ConfigurationError if
    impossible.
    """
    origin = json.dumps({"schema": SCHEMA, "policy": "adaptive", **facts})
    arrays = {name: array.astype(np.float32) for name, array in critic.weights.items()}
    content = BytesIO()
    np.savez_compressed(content, allow_pickle=False, **arrays, about=np.array(origin))
    with writing(path, "make room or name another folder"):
        replace_file(path, content.getvalue())


def _read_arrays(path: FilePath) -> dict[str, Any]:
    """Arrays in the file at `path`, by name; ConfigurationError where it holds none."""
    try:
        content = read_bytes(path, LARGEST_FILE)
    except ConfigurationError as error:
        raise ConfigurationError(
            f"{error}; name another checkpoint or train one"
        ) from None
    try:
        with np.load(BytesIO(content), allow_pickle=False) as held:
            unpacked = sum(entry.file_size for entry in held.zip.infolist())
            if unpacked > LARGEST_UNPACKED:
                raise _broken(path, f"unpacks to {unpacked / MEGABYTE:.0f} MB")
            return {name: held[name] for name in held.files}
    except (
        OSError,
        ValueError,
        KeyError,
        EOFError,
        AttributeError,
        zipfile.BadZipFile,
        TypeError,
    ):
        raise _broken(path, "not a file of arrays") from None


def _read_facts(arrays: dict[str, Any], path: FilePath) -> dict[str, Any]:
    """Origin in the `arrays` of the checkpoint at `path`; ConfigurationError for other
    files.
    """
    try:
        about = json.loads(str(arrays[ABOUT]))
    except (KeyError, json.JSONDecodeError):
        raise _broken(path, "does not say what it is") from None
    if not isinstance(about, dict) or about.get("policy") != "adaptive":
        raise _broken(path, "is not of the policy adaptive")
    if about.get("schema") != SCHEMA:
        raise _broken(
            path, f"has schema {about.get('schema')}, this version reads {SCHEMA}"
        )
    return about


def _read_weights(path: FilePath) -> dict[str, Array]:
    """Arrays of the critic at `path`, by name; ConfigurationError for missing ones or
    NaN.
    """
    arrays = _read_arrays(path)
    _read_facts(arrays, path)
    missing = [name for name in ARRAY_NAMES if name not in arrays]
    if missing:
        raise _broken(path, f"lacks {', '.join(missing)}")

    weights = {name: np.asarray(arrays[name]) for name in ARRAY_NAMES}
    units = (weights[f"{layer}_bias"].size for layer in ("recall", "first", "second"))
    expected = array_shapes(COUNT, *units)

    for name, array in weights.items():
        if array.dtype.kind != "f" or array.shape != expected[name]:
            raise _broken(path, f"{name} is {array.shape}, expected {expected[name]}")
        if not np.isfinite(array).all():
            raise _broken(path, f"{name} holds what is not a number")

    return weights


def _broken(path: FilePath, reason: str) -> ConfigurationError:
    return ConfigurationError(
        f"{path}: checkpoint is corrupt: {reason}; restore the file or train one"
    )

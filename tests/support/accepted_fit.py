"""A folder as a fit writes it, beside the files that it would change."""

import hashlib
import json
import shutil
from pathlib import Path

import yaml

from cell.config.places import find_configs
from cell.gap.subject.strip.subject import patch_file
from drivers.strip.describe import load_strip

EFFECT = {"bending_hysteresis": {"yield_curvature": 20.0, "stiffness_ratio": 8.0}}


class Fitted:
    """A folder that a fit wrote, its strip file and cell file."""

    def __init__(self, root: Path) -> None:
        self.out, self.file, self.cell = root / "out", root / "denim.yaml", root / "cell.yaml"
        self.out.mkdir()
        shutil.copy(find_configs(None).strip_path("denim"), self.file)
        shutil.copy(find_configs(None).folder / "cell.yaml", self.cell)
        digest = hashlib.sha256(self.file.read_bytes()).hexdigest()
        record = {"schema": 1, "file_sha256": digest, "effects": ["bending_hysteresis"]}
        (self.out / "fit.json").write_text(json.dumps(record))
        patch, _ = patch_file(load_strip(self.file), {"bending_length": 0.0168}, EFFECT, "fit")
        (self.out / "patch.yaml").write_text(yaml.safe_dump(patch))

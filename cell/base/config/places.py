"""Folders of configuration, runs and cache: `--configs`, ./configs, or the package's
own.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING

from drivers.base.errors import ConfigurationError, suggestion

# names are found before the libraries that read the files are imported
if TYPE_CHECKING:
    from cell.base.config.cell import CellFile
    from drivers.strip.file import StripFile

PACKAGED = Path(__file__).resolve().parents[2] / "_configs"
CHECKOUT_CONFIGS = Path(__file__).resolve().parents[3] / "configs"


@dataclass(frozen=True, slots=True)
class Configs:
    """Folder of configuration, which holds cell.yaml, strips/NAME.yaml,
    plants/NAME.yaml and mechanisms.
    """

    folder: Path

    @property
    def cell_path(self) -> Path:
        """Path of the file cell.yaml."""
        return self.folder / "cell.yaml"

    def cell(self) -> "CellFile":
        """Contents of cell.yaml, with its effects checked and the path of its
        calibration resolved against the folder of configuration.
        """
        from cell.base.config.cell import CellFile
        from drivers.base.settings import load
        from drivers.strip.effects import check_effects

        path = self.cell_path
        cell = load(path, CellFile)
        check_effects(cell.effects, origin=str(path), of=["cell"])
        if cell.calibration is None:
            return cell
        return cell.model_copy(
            update={"calibration": str(self.folder / cell.calibration)}
        )

    def strip_path(self, name: str) -> Path:
        """Path of the strip file `name`, which may also be a path itself;
        ConfigurationError for an unknown name.
        """
        remedy = "make one with `cell strips new`, or give a path to a .yaml file"
        return self._file("strip", name, remedy)

    def plant_path(self, name: str) -> Path:
        """Path of the plant file `name`, which may also be a path itself;
        ConfigurationError for an unknown name.
        """
        remedy = (
            "name one, or give the path to a strip file that lies on the twin's desk"
        )
        return self._file("plant", name, remedy)

    def mechanism_path(self, name: str) -> Path:
        """Path of the file of the mechanism called `name`; raises ConfigurationError
        for an unknown name.
        """
        remedy = "name one, or give the path to any by --model"
        return self._file("mechanism", name, remedy, "*/mechanism.yaml")

    def _file(self, kind: str, name: str, remedy: str, pattern: str = "*.yaml") -> Path:
        """Path of the file of the strip, plant or mechanism (`kind`) called `name`, or
        of the file at the path `name`.

        Raises ConfigurationError for an unknown name.
        """
        if Path(name).is_file() or Path(name).is_fifo():
            return Path(name)
        folder = self.folder / f"{kind}s"
        paths = sorted(folder.glob(pattern))
        known = {
            path.relative_to(folder).parts[0].removesuffix(".yaml"): path
            for path in paths
        }
        if name not in known:
            raise ConfigurationError(
                f"{name}: is neither a {kind} in {folder} nor a"
                f" file{suggestion(name, list(known))}; known:"
                f" {', '.join(known) or 'none'}; {remedy}"
            )
        return known[name]

    def strip(self, name: str) -> "StripFile":
        """Strip called `name`, read and checked; the name `unknown:LENGTH` stands for a
        strip without a file.
        """
        from cell.base.config.unmeasured_strip import MARK, unmeasured_strip
        from drivers.strip.describe import load_strip

        if name.startswith(MARK):
            return unmeasured_strip(name.removeprefix(MARK))
        return load_strip(self.strip_path(name))

    def strip_names(self) -> tuple[str, ...]:
        """Names of all strips of this configuration, sorted."""
        return tuple(
            sorted(path.stem for path in (self.folder / "strips").glob("*.yaml"))
        )


def find_configs(given: str | Path | None) -> Configs:
    """Folder of configuration: the one `given`, else ./configs, else the one of the
    package.

    Raises ConfigurationError where it holds no cell.yaml.
    """
    if given is not None:
        if not (Path(given) / "cell.yaml").is_file():
            raise ConfigurationError(
                f"{given}: holds no cell.yaml; name a folder of configuration that"
                " holds one"
            )
        return Configs(Path(given))
    for folder in (Path("configs"), PACKAGED, CHECKOUT_CONFIGS):
        if (folder / "cell.yaml").is_file():
            return Configs(folder)
    raise ConfigurationError(
        "no folder of configuration was found; name one that holds cell.yaml"
    )


def check_recordable(runs: Path) -> None:
    """Raise ConfigurationError where the folder `runs` cannot be made or written."""
    folder = next(
        path for path in (runs, *runs.absolute().parents) if os.access(path, os.F_OK)
    )
    try:
        with TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise ConfigurationError(
            f"{runs}: runs cannot be recorded here: {error.strerror}; "
            "name another folder with --runs or make room"
        ) from None


def cache_folder() -> Path:
    """Path of the user's folder for files that can be computed again."""
    return (
        Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        / "folding-cell"
    )

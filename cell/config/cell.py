"""The cell file: the settings of the controller, and those of the twin that stands in for it."""

from cell.config.settings import CellSettings
from drivers.twin.settings import TwinSettings


class CellFile(CellSettings):
    """configs/cell.yaml."""

    twin: TwinSettings

    @property
    def controller(self) -> CellSettings:
        """What the controller may know of this cell: all but the twin."""
        return CellSettings.model_validate(self.model_dump(by_alias=True, exclude={"twin"}))
